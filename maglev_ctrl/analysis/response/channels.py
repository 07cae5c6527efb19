"""From a vehicle and its law to what the guideway moves: outputs, passengers, commands and forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from maglev_ctrl.analysis.minimal import minimal_part
from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.errors import NotStable
from maglev_ctrl.guideway.correlation import TrackInputs
from maglev_ctrl.guideway.shaping import ShapingFilter
from maglev_ctrl.systems import SecondOrderSystem
from maglev_ctrl.systems.feedback import Controller
from maglev_ctrl.systems.plant import Plant, closed_channel


@dataclass(frozen=True, eq=False, slots=True)
class Signal:
    """A weighted sum of outputs, states, or inputs (then the whole command, the law's own included) of a system.

    `terms` are (name, weight). A single output is `Signal.of(name)`.
    """

    name: str
    terms: tuple[tuple[str, float], ...]
    unit: str = ""

    @classmethod
    def of(cls, name: str, *, unit: str = "") -> Signal:
        """One output under its own name.

        Examples
        --------
        >>> Signal.of("magnet.gap", unit="m").terms
        (('magnet.gap', 1.0),)
        """
        return cls(name, ((name, 1.0),), unit)


@dataclass(frozen=True, eq=False, slots=True)
class Noise:
    """White noise of a sensor: the measured output and its one-sided density, its unit per sqrt(Hz)."""

    measured: str
    density: float


@dataclass(frozen=True, eq=False, slots=True)
class RideChannel:
    """A stable closed loop from guideway displacements w, their rates and white noises n to outputs.

        x' = A x + E_p w + E_v w' + E_n n
        y  = C x + D_p w + D_v w' + D_n n

    n are of unit two-sided intensity; `guideway` names w, `outputs` names y, `noises` names n.
    """

    A: FloatArray
    E_p: FloatArray
    E_v: FloatArray
    E_n: FloatArray
    C: FloatArray
    D_p: FloatArray
    D_v: FloatArray
    D_n: FloatArray
    guideway: tuple[str, ...]
    outputs: tuple[str, ...]
    noises: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, slots=True)
class Process:
    """One random process of the guideway: guideway input i meets weights[i] times its displacement, delays[i] s late.

    `shaping` gives its displacement and rate from white noise; `delays`, `weights` (k,) belong to `names`.
    """

    name: str
    shaping: ShapingFilter
    names: tuple[str, ...]
    delays: FloatArray
    weights: FloatArray


def track_processes(
    track: TrackInputs,
    *,
    vertical: ShapingFilter | None = None,
    cross_level: ShapingFilter | None = None,
    lateral: ShapingFilter | None = None,
) -> tuple[Process, ...]:
    """The independent processes of a track, those left out being none.

    Examples
    --------
    >>> from maglev_ctrl.guideway.correlation import track_inputs
    >>> from maglev_ctrl.guideway.shaping import shaping_filter
    >>> from maglev_ctrl.guideway.spectra import inverse_square
    >>> inputs = track_inputs(["heave@front", "heave@rear"], [[5.0, 0.0], [-5.0, 0.0]], speed=100.0)
    >>> found = track_processes(inputs, vertical=shaping_filter(inverse_square(1e-6), speed=100.0))
    >>> found[0].name, found[0].delays.tolist()
    ('vertical', [0.0, 0.1])
    """
    parts = (
        ("vertical", vertical, track.vertical),
        ("cross level", cross_level, track.cross_level),
        ("lateral", lateral, track.lateral),
    )
    return tuple(
        Process(name, shaping, track.names, track.delays, weights)
        for name, shaping, weights in parts
        if shaping is not None
    )


def ride_channel(
    system: SecondOrderSystem,
    controller: Controller | None,
    signals: Sequence[Signal],
    *,
    noises: Sequence[Noise] = (),
) -> RideChannel:
    """The closed loop from the guideway and the sensors' noises to signals.

    Noise enters where a controller measures. A neutral mode that neither the guideway moves nor the signals see is
    left out.

    Parameters
    ----------
    controller : None for a vehicle without a law, or one whose loop is closed already
    signals : sums of outputs and states of `system`, and of its inputs

    Raises
    ------
    ValueError : unknown names, a sampled controller, noise of what is not measured, or a density that is not positive
    NotStable : the closed loop is not stable

    Examples
    --------
    >>> system = SecondOrderSystem.from_matrices([[1.0]], [[0.4]], [[4.0]], guideway=("heave@magnet",), K_w=[[4.0]],
    ...                                          C_w=[[0.4]])
    >>> channel = ride_channel(system, None, [Signal.of("q1")])
    >>> channel.A.shape, channel.E_v.ravel().tolist()
    ((2, 2), [0.0, 0.4])
    """
    law = controller or Controller.static(np.zeros((0, 0)), measured=(), commands=())
    if law.dt is not None:
        raise ValueError(f"controller: {law.name!r} is sampled; expected a law in continuous time")
    unknown = [name for name in law.commands if name not in system.inputs]
    if unknown:
        raise ValueError(f"controller: {unknown[0]!r} is not an input; they are {', '.join(system.inputs)}")
    for noise in noises:
        if noise.measured not in law.measured:
            raise ValueError(f"noises: the controller does not measure {noise.measured!r}; got {law.measured}")
        if not (np.isfinite(noise.density) and noise.density > 0.0):
            raise ValueError(f"noises: expected a positive density of {noise.measured!r}, got {noise.density!r}")
    columns = [system.inputs.index(name) for name in law.commands]
    n_w, n_n = len(system.guideway), len(noises)
    C2, D22, D2w = system.output_rows(law.measured)
    hiss = np.zeros((len(law.measured), n_n))
    for column, noise in enumerate(noises):
        hiss[law.measured.index(noise.measured), column] = noise.density * np.sqrt(0.5)
    C1, D12, D11 = _signal_rows(system, law.commands, signals)
    B2 = system.input_matrix()[:, columns]
    plant = Plant.from_matrices(
        system.state_matrix(),
        np.hstack([system.guideway_matrix(), np.zeros((len(system.states), n_n))]),
        B2, C1, C2,
        D11=np.hstack([D11, np.zeros((len(signals), n_n))]), D12=D12, D21=np.hstack([D2w, hiss]),
        D22=D22[:, columns], commands=law.commands, measured=law.measured,
    )  # fmt: skip
    A, B, C, D = closed_channel(plant, law)
    A, B, C = _stable_part(A, B, C)
    E_p, E_v, E_n = np.split(B, [n_w, 2 * n_w], axis=1)
    D_p, D_v, D_n = np.split(D, [n_w, 2 * n_w], axis=1)
    return RideChannel(
        A=read_only(A, name="A"),
        E_p=read_only(E_p, name="E_p"),
        E_v=read_only(E_v, name="E_v"),
        E_n=read_only(E_n, name="E_n"),
        C=read_only(C, name="C"),
        D_p=read_only(D_p, name="D_p"),
        D_v=read_only(D_v, name="D_v"),
        D_n=read_only(D_n, name="D_n"),
        guideway=system.guideway,
        outputs=tuple(signal.name for signal in signals),
        noises=tuple(f"{noise.measured}.noise" for noise in noises),
    )


def passenger_signals(
    system: SecondOrderSystem, body: str, *, x: float, y: float, z: float, name: str
) -> tuple[tuple[str, Signal], ...]:
    """Vertical and lateral acceleration of a point of a body, as far as the body has the freedoms; (axis, signal).

    With the pitch nose down positive, vertical is heave'' - x pitch'' + y roll'', lateral sway'' + x yaw'' - z roll''.

    Parameters
    ----------
    x, y, z : of the point from the body's centre of mass, m

    Raises
    ------
    ValueError : the body has neither heave, pitch and roll nor sway and yaw

    Examples
    --------
    >>> system = SecondOrderSystem.from_matrices(np.eye(2), np.eye(2), np.eye(2), dofs=("car.heave", "car.pitch"),
    ...     outputs=("car.heave.acceleration", "car.pitch.acceleration"), H_a=np.eye(2))
    >>> passenger_signals(system, "car", x=10.0, y=0.0, z=0.0, name="nose")[0][1].terms
    (('car.heave.acceleration', 1.0), ('car.pitch.acceleration', -10.0))
    """
    axes = (
        ("vertical", (("heave", 1.0), ("pitch", -x), ("roll", y))),
        ("lateral", (("sway", 1.0), ("yaw", x), ("roll", -z))),
    )
    found: list[tuple[str, Signal]] = []
    for axis, parts in axes:
        terms = tuple(
            (f"{body}.{dof}.acceleration", weight)
            for dof, weight in parts
            if f"{body}.{dof}.acceleration" in system.outputs and weight != 0.0
        )
        if terms:
            found.append((axis, Signal(f"{name}.{axis}", terms, "m/s^2")))
    if not found:
        raise ValueError(f"body: expected one with accelerations that a passenger feels, got {body!r}")
    return tuple(found)


def _signal_rows(
    system: SecondOrderSystem, commands: tuple[str, ...], signals: Sequence[Signal]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Rows over states, the law's commands and [w; w']."""
    if not signals:
        raise ValueError("signals: expected at least one")
    readable = (*system.outputs, *system.states)
    names = tuple(dict.fromkeys(name for signal in signals for name, _ in signal.terms))
    read = tuple(name for name in names if name in readable)
    asked = tuple(name for name in names if name not in readable)
    for name in asked:
        if name not in system.inputs:
            raise ValueError(f"signals: {name!r} is neither an output, a state nor an input of the system")
    mix_read = np.array([[sum(w for key, w in s.terms if key == name) for name in read] for s in signals])
    mix_asked = np.array(
        [[sum(w for key, w in s.terms if key == name) for name in commands if name in asked] for s in signals]
    )
    columns = [system.inputs.index(name) for name in commands]
    C, D, E = system.output_rows(read)
    mix_read = mix_read.reshape(len(signals), len(read))
    through = mix_read @ D[:, columns]
    through[:, [commands.index(name) for name in commands if name in asked]] += mix_asked.reshape(len(signals), -1)
    return mix_read @ C, through, mix_read @ E


def _stable_part(A: FloatArray, B: FloatArray, C: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    if not len(A):
        return A, B, C
    for attempt in range(2):
        poles = np.linalg.eigvals(A) if len(A) else np.zeros(0)
        worst = poles[np.argmax(poles.real)] if len(A) else -1.0 + 0.0j
        # A pole within rounding of the axis counts as on it: no variance can be told from it.
        if worst.real < -1e-13 * float(np.linalg.norm(A)) or not len(A):
            return A, B, C
        if attempt == 0 and worst.real <= 1e-9 * float(np.linalg.norm(A)):
            balanced, scale = scipy.linalg.matrix_balance(A, permute=False)
            size = np.diag(scale)
            A, B, C = minimal_part(np.asarray(balanced, dtype=np.float64), B / size[:, None], C * size)
        else:
            break
    raise NotStable(
        f"the closed loop has a pole at {worst.real:.4g} {worst.imag:+.4g}j rad/s; a response to a random guideway "
        "exists only where every pole lies in the left half-plane"
    )
