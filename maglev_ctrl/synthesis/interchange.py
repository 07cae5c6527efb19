"""Laws, plants and loops as systems of python-control, and back; the library is loaded when a function is called.

Out go controllers, plants, vehicles (`SecondOrderSystem`) and return ratios (`Loop`). Back come controllers, plants and
return ratios, whatever python-control calls them: state spaces and transfer functions. A state space has no mass,
damping and stiffness, so it never comes back as a `SecondOrderSystem`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from maglev_ctrl.analysis.loops import Loop
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.systems import Controller, SecondOrderSystem
from maglev_ctrl.systems.plant import Plant
from maglev_ctrl.vehicle.pade import pade_delay

_Space = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


def to_python_control(system: Controller | Plant | SecondOrderSystem | Loop, *, pade_order: int | None = None) -> Any:
    """A control.StateSpace with the names of inputs, outputs and states; dots in names become "_".

    A law goes from y to u (the sign of the feedback is inside), a plant from (w, u) to (z, y), a vehicle from its
    inputs and the guideway (displacements, then their rates) to its outputs, or to its states where it names no output;
    a loop from its channels to its channels (the return ratio L of 1 + L).

    Parameters
    ----------
    pade_order : of the form that delays of a continuous loop take; sampled loops keep theirs exactly, as states

    Raises
    ------
    ValueError : a continuous loop with delays and no `pade_order`, or a vehicle that carries batch axes
    TypeError : a record python-control has no word for, such as a periodic system

    Examples
    --------
    >>> law = Controller.static([[-3.0]], measured=("gap.rate",), commands=("force",), dt=0.001)
    >>> to_python_control(law).input_labels
    ['gap_rate']
    >>> car = SecondOrderSystem.from_matrices([[1.0]], [[0.2]], [[4.0]], dofs=("heave",), inputs=("force",), B=[[1.0]])
    >>> to_python_control(car).state_labels
    ['heave', 'heave_velocity']
    """
    import control

    states: tuple[str, ...] = ()
    match system:
        case Controller():
            matrices: _Space = (system.A, system.B, system.C, system.D)
            inputs, outputs, dt, states = system.measured, system.commands, system.dt, system.states
        case Plant():
            D = np.block([[system.D11, system.D12], [system.D21, system.D22]])
            matrices = (system.A, np.hstack([system.B1, system.B2]), np.vstack([system.C1, system.C2]), D)
            inputs, outputs = system.disturbances + system.commands, system.performance + system.measured
            dt, states = system.dt, system.states
        case SecondOrderSystem():
            matrices, outputs = _vehicle(system), system.outputs or system.states
            inputs = (*system.inputs, *system.guideway, *(f"{name}.rate" for name in system.guideway))
            dt, states = None, system.states
        case Loop():
            matrices, inputs, outputs, dt = _delayed(system, pade_order), system.channels, system.channels, system.dt
        case _:
            raise TypeError(
                f"system: expected a controller, a plant, a second-order system or a loop, got {type(system).__name__}"
            )
    names = {"inputs": allowed_names(inputs), "outputs": allowed_names(outputs)}
    if len(states) == len(matrices[0]) > 0:
        names["states"] = allowed_names(states)
    return control.ss(*matrices, 0 if dt is None else dt, **names)


def from_python_control(
    system: Any,
    *,
    measured: tuple[str, ...] | None = None,
    commands: tuple[str, ...] | None = None,
    name: str = "controller",
) -> Controller:
    """A law from a control.StateSpace or transfer function; names from its labels unless given.

    Raises
    ------
    ValueError : the number of names does not fit, or a sampled system does not say its period
    TypeError : neither a state space nor a transfer function that can become one

    Examples
    --------
    >>> import control
    >>> from_python_control(control.ss([[-1.0]], [[1.0]], [[2.0]], [[0.0]], 0.1), measured=("gap",)).dt
    0.1
    """
    (A, B, C, D), dt, found = _state_space(system)
    names = measured if measured is not None else tuple(found.input_labels)
    outputs = commands if commands is not None else tuple(found.output_labels)
    return Controller.from_matrices(A, B, C, D, measured=names, commands=outputs, name=name, dt=dt)


def loop_from_python_control(
    system: Any, *, channels: tuple[str, ...] | None = None, delays: Sequence[float] | None = None
) -> Loop:
    """A return ratio L from a square control.StateSpace or transfer function, negative feedback, for `loop_margins`.

    Parameters
    ----------
    channels : names of the broken signals; the system's input labels when left out
    delays : s, exact delay of each channel, on top of what the system holds

    Raises
    ------
    ValueError : as many inputs as outputs are needed, or a sampled system does not say its period
    TypeError : neither a state space nor a transfer function that can become one

    Examples
    --------
    >>> import control
    >>> loop_from_python_control(control.tf([25.0], [1.0, 10.0, 10.0, 10.0]), channels=("force",)).A.shape
    (3, 3)
    """
    matrices, dt, found = _state_space(system)
    if found.ninputs != found.noutputs:
        raise ValueError(f"system: a loop has as many inputs as outputs, got {found.ninputs} and {found.noutputs}")
    return Loop(*matrices, channels if channels is not None else tuple(found.input_labels), delays, dt)


def plant_from_python_control(system: Any, *, commands: tuple[str, ...], measured: tuple[str, ...]) -> Plant:
    """A plant from a control.StateSpace; what is no command disturbs, what is not measured is performance.

    Parameters
    ----------
    commands, measured : labels of the system's inputs and outputs

    Raises
    ------
    ValueError : a label the system does not have, or a sampled system that does not say its period
    TypeError : neither a state space nor a transfer function that can become one

    Examples
    --------
    >>> import control
    >>> mass = control.ss([[0, 1], [4, 0]], [[0, 0], [1, 1]], np.eye(2), 0, inputs=["w", "u"], outputs=["z", "y"])
    >>> plant_from_python_control(mass, commands=("u",), measured=("y",)).disturbances
    ('w',)
    """
    (A, B, C, D), dt, found = _state_space(system)
    inputs, outputs = list(found.input_labels), list(found.output_labels)
    for asked, known, word in ((commands, inputs, "commands"), (measured, outputs, "measured")):
        for one in asked:
            if one not in known:
                raise ValueError(f"{word}: {one!r} is not among {', '.join(known)}")
    u, y = [inputs.index(one) for one in commands], [outputs.index(one) for one in measured]
    w = [k for k in range(len(inputs)) if k not in u]
    z = [k for k in range(len(outputs)) if k not in y]
    return Plant.from_matrices(
        A, B[:, w], B[:, u], C[z], C[y], D11=D[np.ix_(z, w)], D12=D[np.ix_(z, u)], D21=D[np.ix_(y, w)],
        D22=D[np.ix_(y, u)], states=tuple(found.state_labels), disturbances=tuple(inputs[k] for k in w),
        commands=commands, performance=tuple(outputs[k] for k in z), measured=measured, dt=dt,
    )  # fmt: skip


def allowed_names(names: Sequence[str]) -> list[str]:
    """Names as python-control takes them: no dots, all different.

    Examples
    --------
    >>> allowed_names(["gap.rate", "gap_rate"])
    ['gap_rate', 'gap_rate_']
    """
    found: list[str] = []
    for name in names:
        one = name.replace(".", "_")
        while one in found:
            one += "_"
        found.append(one)
    return found


def _vehicle(system: SecondOrderSystem) -> _Space:
    """From inputs and guideway to outputs, or to states where there are none."""
    A = system.state_matrix()
    if A.ndim != 2:
        raise ValueError(f"system: expected one system without batch axes, got state matrices of shape {A.shape}")
    C, D, E = system.output_rows(system.outputs or system.states)
    return A, np.hstack([system.input_matrix(), system.guideway_matrix()]), C, np.hstack([D, E])


def _delayed(loop: Loop, pade_order: int | None) -> _Space:
    """The return ratio with its input delays as states: registers in discrete time, Pade forms in continuous time."""
    if not np.any(loop.delays > 0.0):
        return loop.A, loop.B, loop.C, loop.D
    if loop.dt is None and (pade_order is None or pade_order < 1):
        raise ValueError(
            f"system: the loop has exact delays ({', '.join(f'{d:g} s' for d in loop.delays)}), which python-control "
            "cannot hold; give pade_order to approximate them"
        )
    lines = [
        _register(round(delay / loop.dt)) if loop.dt is not None else _pade(float(delay), pade_order or 0)
        for delay in loop.delays
    ]
    A_d = block_diag(*(A for A, _, _, _ in lines))
    B_d = block_diag(*(b[:, None] for _, b, _, _ in lines))
    C_d = block_diag(*(c[None, :] for _, _, c, _ in lines))
    D_d = np.diag([d for _, _, _, d in lines])
    n, n_d = len(loop.A), len(A_d)
    A = np.block([[loop.A, loop.B @ C_d], [np.zeros((n_d, n)), A_d]])
    return A, np.vstack([loop.B @ D_d, B_d]), np.hstack([loop.C, loop.D @ C_d]), loop.D @ D_d


def _pade(delay: float, order: int) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    return pade_delay(delay, order if delay > 0.0 else 0)


def _register(steps: int) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """A delay of whole samples."""
    if steps == 0:
        return np.zeros((0, 0)), np.zeros(0), np.zeros(0), 1.0
    first, last = np.zeros(steps), np.zeros(steps)
    first[0], last[-1] = 1.0, 1.0
    return np.eye(steps, k=-1), first, last, 0.0


def _state_space(system: Any) -> tuple[_Space, float | None, Any]:
    """Matrices, sampling period (None: continuous) and the python-control system itself as a state space."""
    import control

    if not isinstance(system, control.StateSpace | control.TransferFunction):
        raise TypeError(f"system: expected a control.StateSpace or TransferFunction, got {type(system).__name__}")
    if system.dt is True:
        raise ValueError("system: it is sampled, but its period is not given; set its dt to seconds")
    found = system
    if isinstance(system, control.TransferFunction):
        try:
            found = control.ss(system, inputs=list(system.input_labels), outputs=list(system.output_labels))
        except control.ControlMIMONotImplemented:
            raise TypeError(
                "system: a transfer function with several inputs or outputs needs slycot to become a state space; give "
                "a control.StateSpace"
            ) from None
    A, B, C, D = (np.asarray(matrix, dtype=np.float64) for matrix in (found.A, found.B, found.C, found.D))
    return (A, B, C, D), None if found.dt in (None, 0) else float(found.dt), found
