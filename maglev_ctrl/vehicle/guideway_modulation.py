"""Stiffness modulation made by a guideway's own sources: girders, joints, segment profiles, coil and pole pitch.

Each magnet's stiffness share K_i is found as a function of where the magnet stands along the guideway, by its own force
model, and taken apart into harmonics of the period. The magnet at x_i meets the guideway at s = v t + x_i:

    K_i(t) = K_i + sum over k of Re[ K_ik exp(i k (W t + 2 pi x_i / p)) ]
    K_ik = (2/p) Int_0^p K_i(s) exp(-2 pi i k s / p) ds

The vehicle is taken to fly straight, at its mean height over the guideway's mean. First order in the sources: their
contributions are added, and products of two sources, the change of the mean stiffness (second order in a displacement)
and the modulation of damping, drag and static turning forces are left out. Also left out: the forced response (the
vehicle follows the guideway and changes its heights itself), the guideway's own dynamics (a girder's deflection is
static and does not depend on the speed), and what the sampling of a digital controller makes periodic.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only, read_only_any
from maglev_ctrl.errors import ModelError, OutOfDomain
from maglev_ctrl.guideway import common_period
from maglev_ctrl.vehicle.assembly import ElementModulation
from maglev_ctrl.vehicle.guideway_sources import DisplacedGuideway, GuidewaySource, StiffnessRipple
from maglev_ctrl.vehicle.kinematics import Stance, stance
from maglev_ctrl.vehicle.loads import magnet_field, position_slopes
from maglev_ctrl.vehicle.operating import Equilibrium, OperatingPoint
from maglev_ctrl.vehicle.shares import coefficient_share, magnet_stiffness
from maglev_ctrl.vehicle.statics import equilibrium
from maglev_ctrl.vehicle.vehicle import Vehicle

CONVERGED: Final = 1e-9  # relative change of the harmonics when the positions are doubled
ROUNDING: Final = 1e-13  # of the mean stiffness: no change below it is more than rounding
FIRST_POSITIONS, PER_PIECE = 16, 256
"""Positions along a period to begin with, and at most in each smooth piece of a profile."""
HARMONICS_AT_MOST = 60
"""Harmonics of the common period: what integrating over one period can still afford."""

OnIncommensurate = Literal["refuse", "slower"]


@dataclass(frozen=True, eq=False, slots=True)
class GuidewayPattern:
    """Sources of a guideway with one period in common.

    `wavelength` m of the common period; `sources` with as many `cycles` each in it; `left_out`: sources without a
    common period with the slower ones, and `reasons` why. `harmonics` are kept of each source, averaged over the
    `magnet_length` m.
    """

    wavelength: float
    _: KW_ONLY
    sources: tuple[GuidewaySource, ...]
    cycles: tuple[int, ...]
    harmonics: int
    left_out: tuple[GuidewaySource, ...] = ()
    reasons: tuple[str, ...] = ()
    magnet_length: float = 0.0

    @property
    def orders(self) -> int:
        """Number H of harmonics of the common period."""
        return self.harmonics * max(self.cycles)


@dataclass(frozen=True, eq=False, slots=True)
class HeaveShare:
    """What one source does to the total heave stiffness of magnets that all meet it in phase.

    `coefficients` (H,) complex harmonics of its own period over the mean stiffness; `mean_change`: change of the mean
    over the mean (left out of the modulation); `rest`: share of the mean square that the harmonics kept do not hold;
    `positions` along a period, and the relative `change` of the harmonics when their number was doubled last.
    """

    source: GuidewaySource
    cycles: int
    coefficients: ComplexArray
    mean_change: float
    rest: float
    positions: int
    change: float

    @property
    def amplitude(self) -> float:
        """Largest harmonic over the mean stiffness."""
        return float(np.max(np.abs(self.coefficients)))


def guideway_pattern(
    sources: Sequence[GuidewaySource],
    *,
    harmonics: int = 4,
    magnet_length: float = 0.0,
    on_incommensurate: OnIncommensurate = "refuse",
) -> GuidewayPattern:
    """Sources put together over their common period.

    Parameters
    ----------
    sources : at least one
    harmonics : kept of every source, of its own period
    magnet_length : length of one magnet along the track; every harmonic is averaged over it, m
    on_incommensurate : "slower" leaves out a source whose period has no small whole-number ratio to the longest one

    Raises
    ------
    ValueError : no source, periods without a common one, or more than `HARMONICS_AT_MOST` harmonics in it

    Examples
    --------
    >>> from maglev_ctrl.vehicle.guideway_sources import girder_bow, open_joints
    >>> joints = open_joints("joint", spacing=10.0, opening=0.1, harmonics=2)
    >>> both = guideway_pattern([girder_bow("girder", span=25.0, rise=-0.004), joints], harmonics=2)
    >>> both.wavelength, both.cycles, both.orders
    (50.0, (2, 5), 10)
    """
    if not sources or harmonics < 1:
        raise ValueError(f"sources, harmonics: expected at least one of each, got {len(sources)} and {harmonics}")
    if not (np.isfinite(magnet_length) and magnet_length >= 0.0):
        raise ValueError(f"magnet_length: expected a length that is not negative, got {magnet_length}")
    ordered = sorted(sources, key=lambda one: -one.period)
    total, kept = ordered[0].period, [(ordered[0], 1)]
    left_out: list[GuidewaySource] = []
    reasons: list[str] = []
    for source in ordered[1:]:
        try:
            found = common_period(total, source.period)
            cycles = [(one, number * found.cycles[0]) for one, number in kept] + [(source, found.cycles[1])]
            if harmonics * max(number for _, number in cycles) > HARMONICS_AT_MOST:
                raise ValueError(
                    f"the common period of {found.wavelength:g} m takes {harmonics * max(n for _, n in cycles)} "
                    f"harmonics, above {HARMONICS_AT_MOST}; keep fewer harmonics, or treat the slower source alone"
                )
        except ValueError as fault:
            if on_incommensurate == "refuse":
                raise ValueError(f"{ordered[0].name} and {source.name}: {fault}") from None
            left_out.append(source)
            reasons.append(str(fault))
            continue
        # The longest source fixes the common length: what a tolerated mismatch rounds is the faster one.
        total, kept = kept[0][0].period * cycles[0][1], cycles
    order = {id(one): rank for rank, one in enumerate(sources)}
    kept.sort(key=lambda pair: order[id(pair[0])])
    return GuidewayPattern(
        total, sources=tuple(one for one, _ in kept), cycles=tuple(number for _, number in kept),
        harmonics=harmonics, left_out=tuple(left_out), reasons=tuple(reasons), magnet_length=magnet_length,
    )  # fmt: skip


def guideway_modulation(
    vehicle: Vehicle, at: Equilibrium | OperatingPoint, pattern: GuidewayPattern
) -> tuple[FloatArray, FloatArray]:
    """K_cos, K_sin (H, n, n) N/m that the sources make as they are, H = `pattern.orders`.

    Raises
    ------
    OutOfDomain : a source brings a magnet outside its force model's data, or into contact
    ModelError : a displaced guideway under measured coefficients, which know no height

    Examples
    --------
    >>> from maglev_ctrl.forces import ImageForce
    >>> from maglev_ctrl.vehicle import models
    >>> from maglev_ctrl.vehicle.guideway_sources import pitch_ripple
    >>> coil = ImageForce(1e5, 1.0, 2.5e7, 0.02, 1.0)
    >>> car = models.heave_pitch_surge(20e3, pitch_inertia=1e5, spacing=6.0, force=coil, reference_height=0.1)
    >>> ripple = guideway_pattern([pitch_ripple("coils", pitch=12.0, ripple=0.02)], harmonics=1)
    >>> K_cos, K_sin = guideway_modulation(car, OperatingPoint(40.0, 0.1), ripple)
    >>> K_cos.shape, np.abs(K_cos).max() < 1e-9 * np.abs(K_sin).max()         # a quarter wave before and behind
    ((1, 3, 3), np.True_)
    """
    each = guideway_elements(vehicle, at, pattern)
    K_cos, K_sin = (np.sum(part, axis=0) for part in (each.K_cos, each.K_sin))
    return read_only(K_cos, name="K_cos"), read_only(K_sin, name="K_sin")


def guideway_elements(
    vehicle: Vehicle, at: Equilibrium | OperatingPoint, pattern: GuidewayPattern
) -> ElementModulation:  # fmt: skip
    """The share of each magnet and coefficient element in `guideway_modulation`.

    Raises
    ------
    OutOfDomain : a source brings a magnet outside its force model's data, or into contact
    ModelError : a displaced guideway under measured coefficients, which know no height
    """
    here = _Here.of(vehicle, at)
    names = tuple(e.name for e in vehicle.magnets) + tuple(e.name for e in vehicle.coefficient_elements)
    K = np.zeros((len(names), pattern.orders, *here.K.shape[1:]), dtype=np.complex128)
    for source, cycles in zip(pattern.sources, pattern.cycles, strict=True):
        found = _harmonics(here, source, pattern.harmonics).K
        order = np.arange(1, found.shape[1] + 1)
        # A support or joint at s0 is met where v t + x = s0.
        phase = 2.0 * np.pi * order * (here.stations[:, None] - source.offset) / source.period
        turned = found * (np.exp(1j * phase) * _average(order, source, pattern))[:, :, None, None]
        K[:, order * cycles - 1] += turned
    return ElementModulation(names, read_only(K.real, name="K_cos"), read_only(-K.imag, name="K_sin"))


def heave_shares(
    vehicle: Vehicle, at: Equilibrium | OperatingPoint, pattern: GuidewayPattern
) -> tuple[HeaveShare, ...]:  # fmt: skip
    """What every source of the pattern does to the total heave stiffness, all magnets in phase.

    Raises
    ------
    OutOfDomain : a source brings a magnet outside its force model's data, or into contact
    ModelError : no magnet lifts, or a displaced guideway under measured coefficients
    """
    here = _Here.of(vehicle, at)
    if not here.heave > 0.0:
        raise ModelError(
            f"the magnets' heave stiffness is {here.heave:.6g} N/m: a depth of modulation needs one above zero"
        )
    shares = []
    for source, cycles in zip(pattern.sources, pattern.cycles, strict=True):
        found = _harmonics(here, source, pattern.harmonics)
        order = np.arange(1, len(found.heave) + 1)
        felt = found.heave * np.exp(-2j * np.pi * order * source.offset / source.period)
        kept = 0.5 * float(np.sum(np.abs(found.heave) ** 2))
        rest = 0.0 if found.square <= 0.0 else min(max(1.0 - kept / found.square, 0.0), 1.0)
        shares.append(
            HeaveShare(
                source, cycles, read_only_any(felt * _average(order, source, pattern)), found.mean_change,
                rest if rest > 1e-9 else 0.0, found.positions, found.change,
            )
        )  # fmt: skip
    return tuple(shares)


def total_depth(shares: Sequence[HeaveShare]) -> float:
    """Largest harmonic of the total heave stiffness over its mean, all sources together."""
    total = np.zeros(max(len(one.coefficients) * one.cycles for one in shares), dtype=np.complex128)
    for one in shares:
        total[np.arange(1, len(one.coefficients) + 1) * one.cycles - 1] += one.coefficients
    return float(np.max(np.abs(total)))


@dataclass(frozen=True, eq=False, slots=True)
class _Here:
    """A vehicle at its equilibrium: stiffness (E, n, n) and stations (E,) of its elements, total heave stiffness."""

    vehicle: Vehicle
    state: Equilibrium
    stance: Stance
    jacobian: FloatArray
    motion: FloatArray
    K: FloatArray
    stations: FloatArray
    heave: float

    @classmethod
    def of(cls, vehicle: Vehicle, at: Equilibrium | OperatingPoint) -> _Here:
        state = at if isinstance(at, Equilibrium) else equilibrium(vehicle, at)
        now = stance(vehicle, state.displacement)
        fields = magnet_field(vehicle, state.posture, now)
        elements = vehicle.coefficient_elements
        measured = [coefficient_share(e, vehicle, speed=state.at.speed).K for e in elements]
        K = np.concatenate([magnet_stiffness(fields), np.array(measured).reshape(-1, *fields.motion.shape[2:] * 2)])
        stations = [magnet.position[0] for magnet in vehicle.magnets]
        stations += [vehicle.body(element.body).position[0] for element in elements]
        heave = -float(np.sum(fields.by_position[:, 2, 2]))
        heave += sum(float(element.table.at(state.at.speed).stiffness[2, 2]) for element in elements)
        return cls(vehicle, state, now, fields.jacobian, fields.motion, K, np.array(stations), heave)


@dataclass(frozen=True, eq=False, slots=True)
class _Harmonics:
    """Complex harmonics of one source about its own origin: `K` (E, H, n, n), `heave` (H,) over the mean."""

    K: ComplexArray
    heave: ComplexArray
    square: float
    mean_change: float
    positions: int
    change: float


def _harmonics(here: _Here, source: GuidewaySource, count: int) -> _Harmonics:
    if isinstance(source, StiffnessRipple):
        c = source.coefficients[:count]
        square = 0.5 * float(np.sum(np.abs(source.coefficients) ** 2))
        square = square if source.mean_square is None else source.mean_square
        return _Harmonics(c[None, :, None, None] * here.K[:, None], c, square, 0.0, 0, 0.0)
    if here.vehicle.coefficient_elements:
        raise ModelError(
            f"{source.name}: measured coefficients do not tell how the stiffness changes with the height; give the "
            "source as a relative change of stiffness, or the forces by a model of heights"
        )
    _require_reached(here, source)
    pieces = len(source.breaks) - 1
    per_piece = max(2, -(-FIRST_POSITIONS // pieces))
    S, mean, square = _displaced(here, source, count, per_piece)
    while True:
        last = S
        per_piece *= 2
        S, mean, square = _displaced(here, source, count, per_piece)
        size = float(np.max(np.abs(S)))
        moved = float(np.max(np.abs(S - last)))
        change = moved / size if size > 0.0 else 0.0
        if change <= CONVERGED or moved <= ROUNDING * abs(mean) or per_piece * 2 > PER_PIECE:
            break
    K = -np.einsum("mai,hmab,mbj->mhij", here.jacobian, S, here.motion)
    heave = -np.sum(S[:, :, 2, 2], axis=1) / here.heave
    return _Harmonics(
        np.asarray(K), heave, square / here.heave**2, mean / here.heave - 1.0, per_piece * pieces, change
    )  # fmt: skip


def _displaced(
    here: _Here, source: DisplacedGuideway, count: int, per_piece: int
) -> tuple[ComplexArray, float, float]:  # fmt: skip
    """Harmonics of S (H, m, 3, 3) over the displaced guideway; mean and variance of the total heave stiffness."""
    at, weight = source.stations(per_piece)
    rise, narrowing = source.displaced(at)
    S = position_slopes(here.vehicle, here.state.posture, here.stance, rise=rise, narrowing=narrowing)
    order = np.arange(1, count + 1)
    wave = 2.0 * weight * np.exp(-2j * np.pi * order[:, None] * at / source.period)
    heave = -np.sum(S[:, :, 2, 2], axis=1)
    mean = float(weight @ heave)
    return np.tensordot(wave, S, axes=1), mean, float(weight @ (heave - mean) ** 2)


def _require_reached(here: _Here, source: DisplacedGuideway) -> None:
    """Refuse a profile whose extremes, which lie between the positions of a rule, are contact or outside the data."""
    (low, high), (far, near) = source.range_of_rise(), source.range_of_narrowing()
    rise, narrowing = np.array([low, high]), np.array([far, near])
    try:
        position_slopes(here.vehicle, here.state.posture, here.stance, rise=rise, narrowing=narrowing)
    except OutOfDomain as fault:
        walls = "" if source.narrowing is None else f", its walls {1e3 * far:.4g} to {1e3 * near:.4g} mm"
        raise OutOfDomain(
            f"{source.name}: the guideway stands {1e3 * low:.4g} to {1e3 * high:.4g} mm about its mean{walls}; there "
            f"the {fault}"
        ) from None


def _average(order: NDArray[np.int64], source: GuidewaySource, pattern: GuidewayPattern) -> FloatArray:
    """What is left of each harmonic when it is averaged over a magnet's length."""
    return np.asarray(np.sinc(order * pattern.magnet_length / source.period))
