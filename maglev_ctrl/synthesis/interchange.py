"""Laws and plants as systems of python-control, and back; the library is loaded when a function is called."""

from __future__ import annotations

from typing import Any

import numpy as np

from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant


def to_python_control(system: Controller | Plant) -> Any:
    """A control.StateSpace: a law from y to u (sign inside), a plant from (w, u) to (z, y); dots in names become "_".

    Examples
    --------
    >>> law = Controller.static([[-3.0]], measured=("gap.rate",), commands=("force",), dt=0.001)
    >>> to_python_control(law).input_labels
    ['gap_rate']
    """
    import control

    dt = 0 if system.dt is None else system.dt
    if isinstance(system, Controller):
        A, B, C, D = system.A, system.B, system.C, system.D
        inputs, outputs = system.measured, system.commands
    else:
        A, B, C = system.A, np.hstack([system.B1, system.B2]), np.vstack([system.C1, system.C2])
        D = np.block([[system.D11, system.D12], [system.D21, system.D22]])
        inputs, outputs = system.disturbances + system.commands, system.performance + system.measured
    names = [[name.replace(".", "_") for name in group] for group in (inputs, outputs)]
    return control.ss(A, B, C, D, dt, inputs=_different(names[0]), outputs=_different(names[1]))


def from_python_control(
    system: Any, *, measured: tuple[str, ...] | None = None, commands: tuple[str, ...] | None = None
) -> Controller:
    """A law from a control.StateSpace or transfer function; names from its labels unless given.

    Raises
    ------
    ValueError : the number of names does not fit

    Examples
    --------
    >>> import control
    >>> from_python_control(control.ss([[-1.0]], [[1.0]], [[2.0]], [[0.0]], 0.1), measured=("gap",)).dt
    0.1
    """
    import control

    found = control.ss(system)
    names = tuple(measured if measured is not None else found.input_labels)
    outputs = tuple(commands if commands is not None else found.output_labels)
    dt = None if found.dt in (None, 0) else float(found.dt)
    return Controller.from_matrices(found.A, found.B, found.C, found.D, measured=names, commands=outputs, dt=dt)


def _different(names: list[str]) -> list[str]:
    """Names made different; a plant may have the same signal among z and y."""
    found: list[str] = []
    for name in names:
        one = name
        while one in found:
            one += "_"
        found.append(one)
    return found
