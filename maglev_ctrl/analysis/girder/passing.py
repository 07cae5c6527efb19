"""The steady response of a stable loop to spans that all have one shape: every harmonic exactly, peaks not only r.m.s.

An element at x_i meets the place v t + x_i. With w = mean + Re sum of c_k exp(2 pi i k s / L) and W = 2 pi v / L each
harmonic meets the loop at the frequency k W with the phase of every element,

    x(t) = x_mean + Re sum over k of (i k W - A)^-1 sum over i of (E_w + i k W E_v)_i c_k exp(i k (W t + 2 pi x_i / L)).

What decays slowly in k is taken in closed form: (s - A)^-1 (E_w + s E_v) = E_v + B/s + A B/s^2 + (s - A)^-1 A^2 B/s^2
with B = E_w + A E_v, where 1/s and 1/s^2 are periodic integrals of the shape. The rest falls like the fourth power of k
at a step and the fifth at a kink, and what the harmonics left out can add is bounded. An independent solution by
exponentials (`drive`) must agree.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import pi
from typing import Final

import numpy as np
from scipy import linalg
from scipy.optimize import minimize_scalar

from maglev_ctrl.analysis.girder.drive import DrivenSystem, PeriodicSolution, periodic_solution
from maglev_ctrl.analysis.girder.shapes import PieceShape, shifted_breaks
from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only
from maglev_ctrl.errors import Agreement, NotStable
from maglev_ctrl.kernels import balance, rescale
from maglev_ctrl.systems import SecondOrderSystem

SAME: Final = 1e-8
"""Two methods agree where outputs differ by less than this share of their peak."""
TAIL: Final = 1e-9  # of an output's peak: what the harmonics left out may add
FEWEST, MOST = 128, 1 << 15
_GROWTH = 1e4  # (|A|/W)^m: digits that closed terms may cost
_PER_PIECE = 33


@dataclass(frozen=True, eq=False, slots=True)
class PassingPeak:
    """One output over one period of the steady response.

    `peak` is the largest modulus, `highest` and `lowest` the extremes, `rms` the root of the mean square about zero, in
    the output's unit; `time` (s) of the peak from the moment at which the vehicle's origin is at position zero.
    `tail` bounds what the harmonics left out can add, `difference` is the largest one between the two methods, both
    over the peak. `peak` is infinite where a step is felt as a rate, NaN where the methods do not agree.
    """

    name: str
    peak: float
    highest: float
    lowest: float
    rms: float
    time: float
    tail: float
    difference: float
    agreement: Agreement
    reason: str


@dataclass(frozen=True, eq=False, slots=True)
class PassingResponse:
    """Steady response to a periodic guideway at one speed (m/s).

    `period` s; `harmonics` were summed; `times` (k,) s and `values` (outputs, k) show one period (by exponentials,
    both sides of every break).
    """

    speed: float
    period: float
    harmonics: int
    peaks: tuple[PassingPeak, ...]
    times: FloatArray
    values: FloatArray

    def of(self, name: str) -> PassingPeak:
        """The peak of one output.

        Raises
        ------
        ValueError : no such output was asked for
        """
        for one in self.peaks:
            if one.name == name:
                return one
        raise ValueError(f"name: expected one of {', '.join(p.name for p in self.peaks)}, got {name!r}")


def passing_response(
    closed: SecondOrderSystem,
    shape: PieceShape,
    *,
    speed: float,
    places: Mapping[str, float],
    outputs: Sequence[str],
    lateral: PieceShape | None = None,
) -> PassingResponse:
    """The steady response of a stable loop to a periodic guideway, peaks of every output by two methods.

    Parameters
    ----------
    shape : under every input "heave@<element>"
    speed : m/s
    places : x (m, forward) of every element with a guideway input
    outputs : names of outputs or states
    lateral : under every input "sway@<element>", of the same span; level when left out

    Raises
    ------
    NotStable : the loop has a root that does not decay
    ValueError : a speed that is not positive, an element without a place, shapes that do not fit, an unknown output

    Examples
    --------
    >>> from maglev_ctrl.vehicle.guideway_sources import girder_bow
    >>> car = SecondOrderSystem.from_matrices([[1e3]], [[4e3]], [[4e4]], dofs=("z",), guideway=("heave@m",),
    ...                                       K_w=[[4e4]], C_w=[[4e3]])
    >>> sag = PieceShape.from_source(girder_bow("girder", span=25.0, rise=-0.004))
    >>> slow = passing_response(car, sag, speed=0.5, places={"m": 0.0}, outputs=["z"]).of("z")
    >>> round(1e3 * slow.peak, 3), slow.agreement.value          # creeping over spans of +-2.546 mm, overshoot at kinks
    (2.56, 'AGREED')
    """
    names = tuple(outputs)
    system = driven_system(closed, shape, speed=speed, places=places, outputs=names, lateral=lateral)
    series = _series(system)
    times = shifted_breaks(system.shapes, system.places, speed=speed) if system.shapes else np.array(
        [0.0, shape.span / speed]
    )  # fmt: skip
    steady = periodic_solution(system, times)
    per_piece = max(_PER_PIECE, 2 * (1024 // (2 * (len(times) - 1))) + 1)
    at, values, weight = steady.sampled(per_piece)
    peaks = tuple(
        _peak(i, name, system, series=series, steady=steady, breaks=times, sampled=(at, values, weight))
        for i, name in enumerate(names)
    )
    return PassingResponse(
        speed, float(times[-1]), series.count, peaks, read_only(at, name="times"), read_only(values, name="values")
    )


def driven_system(
    closed: SecondOrderSystem,
    shape: PieceShape,
    *,
    speed: float,
    places: Mapping[str, float],
    outputs: Sequence[str],
    lateral: PieceShape | None = None,
) -> DrivenSystem:
    """The loop with the shapes its guideway inputs meet; inputs of a level guideway are left out.

    Raises
    ------
    NotStable : the loop has a root that does not decay
    ValueError : see `passing_response`
    """
    if not (np.isfinite(speed) and speed > 0.0):
        raise ValueError(f"speed: expected a positive speed in m/s, got {speed}")
    if lateral is not None and (lateral.span != shape.span or lateral.periodic != shape.periodic):
        raise ValueError(f"lateral: expected a span of {shape.span:g} m like the shape's, got {lateral.span:g} m")
    kept: list[tuple[int, PieceShape, float]] = []
    for i, name in enumerate(closed.guideway):
        direction, _, element = name.partition("@")
        if element not in places:
            raise ValueError(f"places: expected the position of {element!r}, which feels the guideway")
        if direction == "heave":
            kept.append((i, shape, float(places[element])))
        elif lateral is not None:
            kept.append((i, lateral, float(places[element])))
    A = closed.state_matrix()
    if A.ndim != 2:
        raise ValueError(f"closed: expected one system, got batch axes {A.shape[:-2]}")
    slowest = float(np.max(linalg.eigvals(A).real, initial=-np.inf))
    if slowest >= 0.0:
        raise NotStable(f"no steady response: the loop has a root with the real part {slowest:.6g} 1/s")
    columns = [i for i, _, _ in kept]
    n_w = len(closed.guideway)
    E = closed.guideway_matrix()
    C, _, D = closed.output_rows(tuple(outputs))
    return DrivenSystem(
        A, E[:, columns], E[:, [n_w + i for i in columns]], C, D[:, columns], D[:, [n_w + i for i in columns]],
        tuple(one for _, one, _ in kept), np.array([x for _, _, x in kept]), float(speed),
    )  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class HarmonicSeries:
    """Outputs as harmonics and closed terms: `amplitudes` (p, H) of exp(i k W t), `mean` (p,), `tail` (p,) bounds.

    `closed` are the closed terms' output matrices (p, m) for the shape, its rate and its periodic integrals, with the
    integrated shapes of every element.
    """

    system: DrivenSystem
    frequency: float
    mean: FloatArray
    amplitudes: ComplexArray
    tail: FloatArray
    through: FloatArray
    closed: tuple[tuple[FloatArray, tuple[PieceShape, ...]], ...]

    @property
    def count(self) -> int:
        """Number of harmonics summed."""
        return int(self.amplitudes.shape[1])

    def values(self, output: int, times: FloatArray) -> FloatArray:
        """One output (k,) at times (k,) s."""
        w, rate = self.system.met(times)
        means = np.array([one.mean for one in self.system.shapes])
        total = self.mean[output] + self.through[output] @ (w - means[:, None]) + self.system.D_v[output] @ rate
        for matrix, shapes in self.closed:
            where = self.system.speed * times + self.system.places[:, None]
            total = total + matrix[output] @ np.array([one.at(s) for one, s in zip(shapes, where, strict=True)])
        order = np.arange(1, self.count + 1)
        for start in range(0, len(times), 256):
            part = slice(start, start + 256)
            waves = np.exp(1j * self.frequency * order[:, None] * times[part])
            total[part] += (self.amplitudes[output] @ waves).real
        return np.asarray(total)


def _series(system: DrivenSystem) -> HarmonicSeries:
    """The harmonics, as many as the bound on their tail asks for."""
    span = system.shapes[0].span if system.shapes else 1.0
    frequency = 2.0 * pi * system.speed / span
    A, means = system.A, np.array([one.mean for one in system.shapes])
    mean = -system.C @ np.linalg.solve(A, system.E_w @ means) + system.D_w @ means
    scale = balance(np.abs(A))
    A_b = rescale(A, scale)
    size = float(np.linalg.norm(A_b, 2))
    peeled = 2
    while peeled and (size / frequency) ** peeled > _GROWTH:
        peeled -= 1
    B = system.E_w + A @ system.E_v
    closed: list[tuple[FloatArray, tuple[PieceShape, ...]]] = []
    shapes, power = system.shapes, B
    known: dict[int, PieceShape] = {}
    for order in range(1, peeled + 1):
        known = {id(one): one.integral() for one in shapes}
        shapes = tuple(known[id(one)] for one in shapes)
        closed.append((system.C @ power / system.speed**order, shapes))
        power = A @ power
    through = system.D_w + system.C @ system.E_v
    rows = np.linalg.norm(system.C * scale, axis=1)
    columns = np.linalg.norm(power / scale[:, None], axis=0)
    tails = np.array([one.tail() for one in system.shapes]).reshape(-1, 2)
    guess = _typical(system)
    count = FEWEST
    while True:
        bound = _tail_bound(count, frequency, size, peeled=peeled, tails=tails, columns=columns) * rows
        if count >= MOST or np.all(bound <= TAIL * guess):
            break
        count *= 2
    amplitudes = _amplitudes(system, power, count, frequency, peeled=peeled)
    return HarmonicSeries(system, frequency, mean, amplitudes, bound, through, tuple(closed))


def _amplitudes(
    system: DrivenSystem, power: FloatArray, count: int, frequency: float, *, peeled: int
) -> ComplexArray:  # fmt: skip
    order = np.arange(1, count + 1)
    s = 1j * frequency * order
    found = {id(one): one.harmonics(count) for one in system.shapes}
    push = np.zeros((count, len(system.A)), dtype=np.complex128)
    for i, (one, x) in enumerate(zip(system.shapes, system.places, strict=True)):
        turned = found[id(one)] * np.exp(2j * pi * order * x / one.span) / s**peeled
        push += turned[:, None] * power[:, i]
    amplitudes = np.empty((len(system.C), count), dtype=np.complex128)
    for start in range(0, count, 1024):
        part = slice(start, min(start + 1024, count))
        matrices = s[part, None, None] * np.eye(len(system.A)) - system.A
        amplitudes[:, part] = system.C @ np.linalg.solve(matrices, push[part, :, None])[..., 0].T
    return amplitudes


def _typical(system: DrivenSystem) -> FloatArray:
    """A lower estimate of every output's peak, by which a tail counts as small: that of the first harmonics."""
    if not system.shapes:
        return np.ones(len(system.C))
    frequency = 2.0 * pi * system.speed / system.shapes[0].span
    order = np.arange(1, 9)
    s = 1j * frequency * order
    total = np.zeros((8, len(system.C)))
    for k in range(8):
        drive = np.zeros(len(system.shapes), dtype=np.complex128)
        for i, (one, x) in enumerate(zip(system.shapes, system.places, strict=True)):
            drive[i] = one.harmonics(8)[k] * np.exp(2j * pi * order[k] * x / one.span)
        state = np.linalg.solve(s[k] * np.eye(len(system.A)) - system.A, (system.E_w + s[k] * system.E_v) @ drive)
        total[k] = np.abs(system.C @ state + (system.D_w + s[k] * system.D_v) @ drive)
    return np.asarray(np.max(total, axis=0))


def _tail_bound(
    count: int, frequency: float, size: float, *, peeled: int, tails: FloatArray, columns: FloatArray
) -> float:
    """Bound on |sum beyond `count`| over the norm of the output row: |(i w - A)^-1| <= 1/(w - |A|) beyond |A|."""
    reach = count * frequency
    if reach <= 1.25 * size:
        return np.inf if columns.size else 0.0
    gain = 1.0 / (frequency ** (peeled + 1) * (1.0 - size / reach))
    p = peeled + 1.0
    sums = tails[:, 0] * count**-p / p + tails[:, 1] * count ** -(p + 1.0) / (p + 1.0)
    return float(gain * np.sum(sums * columns))


def _peak(
    i: int, name: str, system: DrivenSystem, *, series: HarmonicSeries, steady: PeriodicSolution, breaks: FloatArray,
    sampled: tuple[FloatArray, FloatArray, FloatArray],
) -> PassingPeak:  # fmt: skip
    """Extremes by the harmonics, found near those of the samples; both methods compared there and all over."""
    at, values, weight = sampled
    stepped = [one for one, through in zip(system.shapes, system.D_v[i], strict=True) if through and np.any(one.jumps)]
    if stepped:
        reason = "the output feels the rate of a step, which is infinite; draw the step out over a length"
        return PassingPeak(name, np.inf, np.inf, -np.inf, np.inf, np.nan, np.nan, np.nan, Agreement.AGREED, reason)
    period = float(breaks[-1])
    row = values[i]
    extremes: list[tuple[float, float]] = []
    for sign in (1.0, -1.0):
        extremes.append(_extreme(sign, at, row, series=series, output=i, breaks=breaks, period=period))
    (t_high, high), (t_low, low) = extremes
    peak, time = (high, t_high) if abs(high) >= abs(low) else (abs(low), t_low)
    inner = np.concatenate([0.5 * (breaks[1:] + breaks[:-1]), np.linspace(0.0, period, 48) + 0.37 * period / 48])
    inner = inner[inner < period]
    apart = np.abs(series.values(i, inner) - steady.outputs_at(inner)[i])
    scale = max(peak, float(np.max(np.abs(row))))
    # What is no more than rounding of its parts is zero.
    floor = 1e-13 * float(np.sum(np.abs(system.C[i]) @ np.abs(steady.states.T))) / max(len(steady.states), 1)
    missed = max(float(np.max(row)) - high, low - float(np.min(row)), 0.0)
    worst = max(float(np.max(apart)), missed)
    difference = worst / scale if scale > floor else 0.0
    tail = float(series.tail[i]) / scale if scale > floor else 0.0
    rms = float(np.sqrt(max(float(weight @ row**2), 0.0)))
    if difference <= SAME:
        noted = "" if tail <= SAME else f"the harmonics left out are bounded by {tail:.2g} of the peak only"
        return PassingPeak(name, peak, high, low, rms, time, tail, difference, Agreement.AGREED, noted)
    reason = f"harmonics and exponentials differ by {difference:.2g} of the peak"
    return PassingPeak(
        name, np.nan, np.nan, np.nan, np.nan, np.nan, tail, difference, Agreement.UNRESOLVED, reason
    )  # fmt: skip


def _extreme(
    sign: float, at: FloatArray, row: FloatArray, *, series: HarmonicSeries, output: int, breaks: FloatArray,
    period: float,
) -> tuple[float, float]:  # fmt: skip
    """Time and value of the highest (sign 1) or lowest (-1) place of an output."""
    signed = sign * row
    top, spread = float(np.max(signed)), float(np.max(signed) - np.min(signed))
    local = np.flatnonzero(
        (signed >= np.roll(signed, 1)) & (signed >= np.roll(signed, -1)) & (signed >= top - 0.01 * spread)
    )
    best = int(np.argmax(signed))
    candidates = sorted({best, *local.tolist()}, key=lambda k: -signed[k])[:6]
    found = (float(at[best]), top)
    for k in candidates:
        # The samples carry both sides of a break; a search stays on one side.
        piece = int(np.clip(np.searchsorted(breaks, at[k], side="right") - 1, 0, len(breaks) - 2))
        if at[k] == breaks[piece] and k and at[k - 1] == at[k]:
            low, high = at[k], at[min(k + 1, len(at) - 1)]
        elif k + 1 < len(at) and at[k + 1] == at[k]:
            low, high = at[k - 1], at[k]
        else:
            low, high = at[max(k - 1, 0)], at[min(k + 1, len(at) - 1)]
        edge = 1e-12 * period

        def lower(t: float) -> float:
            return -sign * float(series.values(output, np.array([t]))[0])

        if high - low <= 4.0 * edge:
            continue
        search = minimize_scalar(
            lower, bounds=(low + edge, high - edge), method="bounded", options={"xatol": 1e-9 * period}
        )
        for t, value in (
            (float(search.x), -float(search.fun)),
            (low + edge, -lower(low + edge)),
            (high - edge, -lower(high - edge)),
        ):
            if value > found[1]:
                found = (t, value)
    return found[0], sign * found[1]
