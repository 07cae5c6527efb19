"""Plants that are singular for H2 and H-infinity synthesis: what is wrong with them, and the smallest cure in the open.

The Riccati equations need every command weighed (D12 of full column rank), every measurement noisy (D21 of full row
rank), and no invariant zero of either channel on the imaginary axis. A plant without this is enlarged by small outputs
and disturbances, `share` times its own scale. They only ever add to a gain, so what is found for the enlarged plant is
an upper bound for the plant itself, and the infimum of the plant is the limit as the share goes to zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maglev_ctrl.analysis.hamiltonian import continuous_equivalent
from maglev_ctrl.analysis.loops import state_scales
from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.errors import ModelError
from maglev_ctrl.synthesis.neutral import hidden_modes
from maglev_ctrl.systems.plant import Plant

RANK = 1e-9
"""Singular values of D12 and D21 below this share of the largest count as zero."""
ON_AXIS = 1e-7
"""An invariant zero nearer to the axis than this share of the state matrix counts as on it."""


@dataclass(frozen=True, eq=False, slots=True)
class Defects:
    """What a plant lacks: directions of command and measurement without D12 or D21, and zeros on the axis (rad/s).

    `unclear` where nothing was found but the equations were not solved: all is enlarged.
    """

    commands: FloatArray
    measurements: FloatArray
    control_zeros: ComplexArray
    estimation_zeros: ComplexArray
    unclear: bool = False

    @property
    def any(self) -> bool:
        """Whether the plant is singular."""
        return bool(
            self.unclear
            or self.commands.size
            or self.measurements.size
            or self.control_zeros.size
            or self.estimation_zeros.size
        )

    @property
    def sentences(self) -> tuple[str, ...]:
        """The defects in words."""
        told: list[str] = ["its Riccati equations are too close to singular"] if self.unclear else []
        if self.commands.size:
            told.append(f"{_count(len(self.commands), 'command')} not weighed at once (D12 lacks column rank)")
        if self.control_zeros.size:
            told.append(f"from commands to performance the plant has {_zeros(self.control_zeros)}")
        if self.measurements.size:
            told.append(f"{_count(self.measurements.shape[1], 'measurement')} without noise (D21 lacks row rank)")
        if self.estimation_zeros.size:
            told.append(f"from disturbances to measurements the plant has {_zeros(self.estimation_zeros)}")
        return tuple(told)


def require_movable(plant: Plant, *, output: bool) -> None:
    """Refuse plants that no law can stabilise; the modes are named.

    Raises
    ------
    ModelError : a mode that does not decay is out of reach of the commands or, for output feedback, unseen

    Examples
    --------
    >>> require_movable(Plant.from_matrices([[1.0]], [[1.0]], [[0.0]], [[1.0]], states=("gap",)), output=False)
    Traceback (most recent call last):
        ...
    maglev_ctrl.errors.ModelError: the commands u1 cannot move the mode at 1 rad/s (gap): no law stabilises the plant
    """
    A, B, C = plant.A, plant.B2, plant.C2
    if plant.dt is not None:
        A, B, C, _ = continuous_equivalent(A, B, C, plant.D22, plant.dt)
    for mode in hidden_modes(A.T, B.T, plant.states):
        raise ModelError(
            f"the commands {', '.join(plant.commands)} cannot move {_label(mode.pole, mode.states, plant)}: "
            "no law stabilises the plant"
        )
    if not output:
        return
    for mode in hidden_modes(A, C, plant.states):
        raise ModelError(
            f"the measurements {', '.join(plant.measured)} do not see {_label(mode.pole, mode.states, plant)}: "
            "no law stabilises the plant"
        )


def defects(plant: Plant, *, output: bool) -> Defects:
    """Look for singular D12 (and D21) and for invariant zeros on the axis; a sampled plant is looked at as continuous.

    Examples
    --------
    >>> plant = Plant.from_matrices([[0.0]], [[1.0]], [[1.0]], [[0.0]], D12=[[1.0]])
    >>> defects(plant, output=False).sentences
    ('from commands to performance the plant has an invariant zero at 0 on the axis',)
    """
    commands, control_zeros = _channel(plant.A, plant.B2, plant.C1, plant.D12)
    measurements, estimation_zeros = np.zeros((0, len(plant.measured))), np.zeros(0, dtype=complex)
    if output:
        measurements, estimation_zeros = _channel(plant.A.T, plant.C2.T, plant.B1.T, plant.D21.T)
    return Defects(commands, measurements.T, control_zeros, estimation_zeros)


def enlarged(plant: Plant, found: Defects, share: float) -> Plant:
    """The plant with small outputs and disturbances that remove its defects; w and z get more entries, u and y none.

    Examples
    --------
    >>> plant = Plant.from_matrices([[-1.0]], [[1.0]], [[1.0]], [[1.0]])
    >>> enlarged(plant, defects(plant, output=False), 1e-3).D12.tolist()  # z, the state, the command
    [[0.0], [0.0], [0.001]]
    """
    scale = state_scales(plant.A, np.hstack([plant.B1, plant.B2]), np.vstack([plant.C1, plant.C2]))
    pace = float(np.linalg.norm(plant.A * scale / scale[:, None], 2)) or 1.0
    rows = _share(plant.C1 * scale, plant.D12, plant.B2 / scale[:, None], pace)
    columns = _share((plant.B1 / scale[:, None]).T, plant.D21.T, (plant.C2 * scale).T, pace)
    n = len(plant.states)
    C1, D11, D12, B1, D21 = plant.C1, plant.D11, plant.D12, plant.B1, plant.D21
    outputs, inputs = list(plant.performance), list(plant.disturbances)
    if found.unclear or found.control_zeros.size or found.commands.size:
        extra = np.vstack([share * rows[0] * np.diag(1.0 / scale), np.zeros((len(found.commands), n))])
        prices = np.vstack([np.zeros((n, D12.shape[1])), share * rows[1] * found.commands])
        C1, D12 = np.vstack([C1, extra]), np.vstack([D12, prices])
        D11 = np.vstack([D11, np.zeros((len(extra), D11.shape[1]))])
        outputs += [f"added output {k + 1}" for k in range(len(extra))]
    if found.unclear or found.estimation_zeros.size or found.measurements.size:
        count = found.measurements.shape[1]
        extra = np.hstack([share * columns[0] * np.diag(scale), np.zeros((n, count))])
        noise = np.hstack([np.zeros((D21.shape[0], n)), share * columns[1] * found.measurements])
        B1, D21 = np.hstack([B1, extra]), np.hstack([D21, noise])
        D11 = np.hstack([D11, np.zeros((D11.shape[0], extra.shape[1]))])
        inputs += [f"added disturbance {k + 1}" for k in range(extra.shape[1])]
    return Plant.from_matrices(
        plant.A, B1, plant.B2, C1, plant.C2, D11=D11, D12=D12, D21=D21, D22=plant.D22, states=plant.states,
        disturbances=tuple(inputs), commands=plant.commands, performance=tuple(outputs), measured=plant.measured,
        dt=plant.dt, name=plant.name,
    )  # fmt: skip


def _channel(A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray) -> tuple[FloatArray, ComplexArray]:
    """Null directions of D (rows), and where D has full column rank the zeros of (A, B, C, D) on the axis."""
    unit = _units(B, D)
    D, B = D / unit, B / unit
    left, size, right = np.linalg.svd(D) if D.size else (np.eye(D.shape[0]), np.zeros(0), np.eye(D.shape[1]))
    rank = int(np.sum(size > RANK * max(float(np.max(size, initial=0.0)), 1e-300)))
    if rank < D.shape[1]:
        return right[rank:] * unit, np.zeros(0, dtype=complex)
    solved = right.T[:, :rank] @ (left[:, :rank].T @ C / size[:rank, None])
    unseen = left[:, rank:].T @ C
    bare = A - B @ solved
    # in balanced states, or their units would tell how near is near
    scale = state_scales(bare, np.zeros((len(A), 0)), unseen)
    bare, unseen = bare * scale / scale[:, None], unseen * scale
    size_of = float(np.linalg.norm(bare, 2))
    # Modes right of the axis are harmless: the game turns them.
    zeros = [m.pole for m in hidden_modes(bare, unseen, ("",) * len(A)) if abs(m.pole.real) <= ON_AXIS * size_of]
    return np.zeros((0, D.shape[1])), np.array(zeros, dtype=complex)


def _units(B: FloatArray, D: FloatArray) -> FloatArray:
    """Units of the commands in which their prices are alike, or where they have none, their effects."""
    price, effect = np.linalg.norm(D, axis=0), np.linalg.norm(B, axis=0)
    dearest, strongest = float(np.max(price, initial=0.0)), float(np.max(effect, initial=0.0))
    unit = np.ones(D.shape[1])
    for j in range(unit.size):
        if price[j] > 0.0:
            unit[j] = price[j] / dearest
        elif effect[j] > 0.0:
            unit[j] = effect[j] / strongest
    return unit


def _share(C: FloatArray, D: FloatArray, B: FloatArray, pace: float) -> tuple[float, float]:
    """Scale of an output in balanced states and of a command's price: gains of the plant's own size."""
    output = float(np.linalg.norm(C, 2)) if np.any(C) else 1.0
    price = float(np.linalg.norm(D, 2)) if np.any(D) else output * max(float(np.linalg.norm(B, 2)), 1e-300) / pace
    return output, price


def _label(pole: complex, states: tuple[str, ...], plant: Plant) -> str:
    if plant.dt is not None:
        pole = (2.0 / plant.dt + pole) / (2.0 / plant.dt - pole)
    value = f"{pole.real:.3g}" if pole.imag == 0.0 else f"{pole.real:.3g} +- {abs(pole.imag):.3g}j"
    return f"the mode at {value}{' rad/s' if plant.dt is None else ''} ({', '.join(states)})"


def _count(number: int, noun: str) -> str:
    return f"one {noun} is" if number == 1 else f"{number} {noun}s are"


def _zeros(zeros: ComplexArray) -> str:
    told = list(dict.fromkeys(f"{z.imag:.3g}j" if z.imag != 0.0 else "0" for z in zeros))
    at = ", ".join(told)
    return f"an invariant zero at {at} on the axis" if len(told) == 1 else f"invariant zeros at {at} on the axis"
