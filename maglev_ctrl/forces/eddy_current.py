"""Forces of coils over a moving conducting guideway, from first principles: lift, guidance, drag and roll torque.

The guideway (any cross-section uniform along the track, isotropic metal of finite thickness) is solved once, by finite
elements for each wavenumber along the track; coils, positions, speeds and frequencies then cost milliseconds. At a
fixed speed lift, guidance and roll torque are the gradient of one energy W (reciprocity), and the drag times the speed
is what the currents dissipate.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only
from maglev_ctrl.errors import OutOfDomain
from maglev_ctrl.fields.coil import CoilGroup, RectangularCoil, coil_groups, dipole_potential, line_points
from maglev_ctrl.fields.response import GuidewayResponse, Region
from maglev_ctrl.fields.section import CrossSection
from maglev_ctrl.fields.solve import Fineness, refined_patterns, solve_guideway
from maglev_ctrl.fields.spread import Spread, one_by_one
from maglev_ctrl.fields.wavenumbers import product_weights
from maglev_ctrl.forces.base import (
    AbstractForceModel,
    Domain,
    MagnetDerivatives,
    MagnetForces,
    checked_factor,
    no_forces,
)
from maglev_ctrl.forces.force_map import ForceMap

Accuracy = Literal["draft", "standard", "reference"]
FINENESS: dict[Accuracy, Fineness] = {
    "draft": Fineness(0.6, 0.65, 3, points=3, tolerance=1e-4, rates_per_decade=1.0),
    "standard": Fineness(0.3, 0.45, 3, points=4, tolerance=1e-6, rates_per_decade=1.5),
    "reference": Fineness(0.2, 0.3, 3, points=6, tolerance=1e-7, rates_per_decade=2.0),
}
"""How finely a guideway is solved. Largest errors found at the very corners of a map from 3 mm of gap and 5 mm of
height: draft 0.1 % of a force (0.25 % at the ends of the speed range) and 0.7 % of a stiffness, standard 0.015 % and
0.03 %."""

_SECOND = {(1, 1): 4, (1, 2): 5, (1, 3): 6, (2, 2): 7, (2, 3): 8, (3, 3): 9}


@dataclass(frozen=True, eq=False, slots=True)
class EddyCurrentForce(AbstractForceModel):
    """Forces of one magnet's coils over a conducting guideway. Build it with `solve`.

    Examples
    --------
    >>> guideway = CrossSection.l_shape(leg=76.2e-3, thickness=6.35e-3, conductivity=2.5e7)
    >>> coil = RectangularCoil(length=50.8e-3, width=25.4e-3, current=6000.0, lateral=12.7e-3, height=3.175e-3)
    >>> magnet = EddyCurrentForce.solve(guideway, (coil,), height=(12e-3, 14e-3), gap=(12e-3, 14e-3),
    ...                                 speed=(30.0, 40.0), accuracy="draft")
    >>> found = magnet.forces(12.7e-3, 12.7e-3, 36.1)
    >>> abs(float(found.lift) - 4.142) < 0.04
    True
    """

    section: CrossSection
    coils: tuple[RectangularCoil, ...]
    response: GuidewayResponse
    fineness: Fineness
    domain: Domain = field()  # field() hides the property of the base, which would count as a default
    strength: FloatArray = field(default_factory=lambda: read_only(1.0, name="strength"))
    _groups: tuple[CoilGroup, ...] = field(init=False)
    _shares: tuple[tuple[int, int, FloatArray], ...] = field(init=False)

    def __post_init__(self) -> None:
        groups = coil_groups(self.coils)
        object.__setattr__(self, "_groups", groups)
        object.__setattr__(self, "_shares", _track_shares(groups, self.response))

    @classmethod
    def solve(
        cls,
        section: CrossSection,
        coils: Sequence[RectangularCoil],
        *,
        height: tuple[float, float],
        gap: tuple[float, float] | None,
        speed: tuple[float, float],
        frequency: float = 0.0,
        accuracy: Accuracy | Fineness = "standard",
        spread: Spread = one_by_one,
        progress: Callable[[float], None] | None = None,
    ) -> EddyCurrentForce:
        """Solve a guideway for coils that move through a range of heights and gaps.

        Parameters
        ----------
        height, gap, speed : ranges, m, m, m/s; gap None for a guideway without a wall: the coil stays at `lateral`
        frequency : largest angular frequency of the magnet's own motion, rad/s, for `motion_stiffness`
        accuracy : "draft", "standard" or "reference", see `FINENESS`; or a `Fineness`
        spread : shares the wavenumbers out over processes; by default they are solved one by one
        progress : told the fraction done

        Raises
        ------
        ValueError : no coil, coils without fore-aft symmetry, a range that is not increasing or not positive, a coil
            that would touch the guideway
        """
        _require_ranges(height=height, gap=gap, speed=speed)
        groups = coil_groups(coils)
        chosen = accuracy if isinstance(accuracy, Fineness) else FINENESS[accuracy]
        response = solve_guideway(
            section,
            regions=[_region(group, height=height, gap=gap) for group in groups],
            speeds=speed,
            frequency=frequency,
            fineness=chosen,
            spread=spread,
            progress=progress,
        )
        return cls(section, tuple(coils), response, chosen, domain=Domain(height=height, gap=gap, speed=speed))

    def forces(self, height: ArrayLike, gap: ArrayLike | None, speed: ArrayLike) -> MagnetForces:
        """Lift, guidance and drag of one magnet.

        Raises
        ------
        OutOfDomain : a point outside `domain`
        """
        found = self._each(height, gap, speed, self._steady, order=1)
        guidance, lift, drag = (found[..., i] for i in (1, 2, 0))
        return MagnetForces(lift=lift, guidance=guidance, drag=drag).scaled(self.strength)

    def roll_torque(self, height: ArrayLike, gap: ArrayLike | None, speed: ArrayLike) -> FloatArray:
        """Torque about x on one magnet, y towards z, about the middle of its first coil; (...) N m."""
        return np.asarray(self.strength * self._each(height, gap, speed, self._steady, order=1)[..., 3])

    def derivatives(self, height: ArrayLike, gap: ArrayLike | None, speed: ArrayLike) -> MagnetDerivatives:
        """Analytic partials; quasi-static, so none by vertical or lateral velocity (see `motion_stiffness`)."""
        slopes = self._each(height, gap, speed, self._slopes, order=2)

        def part(column: int) -> MagnetForces:
            drag, guidance, lift = (slopes[..., row, column] for row in range(3))
            return MagnetForces(lift=lift, guidance=guidance, drag=drag)

        nothing = no_forces(slopes.shape[:-2])
        return MagnetDerivatives(
            by_height=part(2),
            by_gap=nothing if self.domain.gap is None else part(1),
            by_speed=part(0),
            by_vertical_velocity=nothing,
            by_lateral_velocity=nothing,
        ).scaled(self.strength)

    def energy(self, height: ArrayLike, gap: ArrayLike | None, speed: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """W (J), whose gradient is lift and guidance, and the drag (N); both (...)."""
        found = self._each(height, gap, speed, self._energy_and_drag, order=0)
        return np.asarray(self.strength * found[..., 0]), np.asarray(self.strength * found[..., 1])

    def motion_stiffness(self, height: float, gap: float | None, speed: float, frequency: ArrayLike) -> ComplexArray:
        """Dynamic stiffness Q: forces = Q u for u e^{iwt} in the order of `forces.dynamic.MOTIONS`; force ON
        the magnet. Roll is about the middle of the first coil; the coils of a magnet move as one body.

        Re Q(0) = k, Im Q = w c, Re Q = k - w^2 m (Eqs. 6-9); c > 0 is negative damping. Exact for every frequency, not
        only slow motion. Complex frequencies w = -i s continue it to growing and decaying motion.

        Parameters
        ----------
        height, gap, speed : m, m, m/s
        frequency : (f,) angular frequency w, rad/s

        Returns
        -------
        (f, 4, 4) N/m, N, N m/rad

        Raises
        ------
        OutOfDomain : a point outside `domain`, or |w| above the frequency the guideway was solved for
        """
        self.domain.require(height, gap, speed)
        w = np.atleast_1d(np.asarray(frequency))
        if np.max(np.abs(w), initial=0.0) > self.response.frequency * (1.0 + 1e-9):
            raise OutOfDomain(
                f"frequency {np.max(np.abs(w)):.6g} rad/s is above the {self.response.frequency:.6g} rad/s "
                "the guideway was solved for"
            )
        weights = self._weights(height, gap, order=2)
        still = self.response.transfer(speed)
        ahead, behind = self.response.transfer(speed, w), self.response.transfer(-speed, w)
        k = self.response.wavenumbers[:, None]
        Q = np.zeros((len(w), 4, 4), dtype=np.complex128)
        for a, b, share in self._pairs(weights):
            for i in range(1, 4):
                for j in range(1, 4):
                    second = np.sum(share * 2.0 * still.real * a[0] * b[_SECOND[min(i, j), max(i, j)]])
                    Q[:, i, j] += 0.5 * (second + np.sum(share * (ahead + behind) * a[i] * b[j], axis=(1, 2)))
                # Surge forwards is motion against the guideway's own: -x.
                both = 1j * k * (still + ahead), -1j * k * (np.conj(still) + behind)
                Q[:, 0, i] -= 0.5 * np.sum(share * (both[0] + both[1]) * a[0] * b[i], axis=(1, 2))
                both = 1j * k * (still - ahead), -1j * k * (np.conj(still) - behind)
                Q[:, i, 0] -= 0.5 * np.sum(share * (both[0] + both[1]) * a[i] * b[0], axis=(1, 2))
            change = (ahead - still) + (behind - np.conj(still))
            Q[:, 0, 0] += 0.5 * np.sum(share * k**2 * change * a[0] * b[0], axis=(1, 2))
        return np.asarray(self.strength * Q)

    def coefficients(
        self, height: float, gap: float | None, speed: float, frequency: ArrayLike
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Magnetic mass m (kg), damping c (N s/m) and stiffness k (N/m) of Eq. 3 at each frequency; (f, 4, 4) each.

        Raises
        ------
        ValueError : a frequency that is not positive: c and m are what one oscillation shows
        """
        w = np.atleast_1d(np.asarray(frequency, dtype=np.float64))
        if np.any(w <= 0.0):
            raise ValueError(f"frequency: expected positive frequencies in rad/s, got {np.min(w):.6g}")
        Q = self.motion_stiffness(height, gap, speed, np.concatenate([[0.0], w]))
        k = np.broadcast_to(Q[0].real, Q[1:].shape)
        rate = w[:, None, None]
        return (k - Q[1:].real) / rate**2, Q[1:].imag / rate, k

    def refinement(self, *, wavenumbers: int = 3, spread: Spread = one_by_one) -> float:
        """Relative change of energy and drag when the wavenumbers that matter most are solved again, finer.

        Elements of one order more, twice the rates, a finer basis of sources; at the nearest and the middle position
        and the ends of the speed range. An estimate of the error, and usually above it.

        Parameters
        ----------
        wavenumbers : how many, spread over those that carry the force
        spread : shares them out over processes
        """
        (low, high), gap = self.domain.height, self.domain.gap or (0.0, 0.0)
        places = ((low, gap[0]), (0.5 * (low + high), 0.5 * (gap[0] + gap[1])))
        speeds = np.array(self.response.speeds)
        samples = [self._potentials(h, g if self.domain.gap else None, order=0) for h, g in places]
        shares = np.array([self._spectrum(self.response, one, speeds) for one in samples])  # (place, 2, speed, n)
        carried = np.max(np.abs(shares) / np.sum(np.abs(shares), axis=-1, keepdims=True), axis=(0, 1, 2))
        ranks = (np.arange(wavenumbers) + 0.5) / wavenumbers
        chosen = np.unique(np.searchsorted(np.cumsum(carried) / np.sum(carried), ranks))
        finer = refined_patterns(self.section, self.response, chosen.tolist(), fineness=self.fineness, spread=spread)
        worst = 0.0
        for index, pattern in zip(chosen.tolist(), finer, strict=True):
            alone = replace(
                self.response,
                wavenumbers=self.response.wavenumbers[[index]],
                projections=pattern.projection.T[None],
                time_constants=pattern.time_constants[None],
            )
            for place, one in enumerate(samples):
                again = self._spectrum(alone, [potential[:, [index]] for potential in one], speeds, at=index)
                change = np.abs(again[..., 0] / shares[place, ..., index] - 1.0)
                worst = max(worst, float(np.max(change * carried[index] / np.max(carried))))
        return worst

    def _spectrum(
        self, response: GuidewayResponse, potentials: list[FloatArray], speeds: FloatArray, at: int | None = None
    ) -> FloatArray:
        """What each wavenumber adds to the energy and to the drag; (2, speeds, n)."""
        weights = tuple(response.weights(one)[0] for one in potentials)
        transfer = response.transfer(speeds)
        total = np.zeros((2, len(speeds), len(response.wavenumbers)))
        for i, j, share in self._shares:
            product = (share if at is None else share[[at]]) * weights[i] * weights[j]
            total[0] += np.sum(product * transfer.real, axis=-1)
            total[1] -= np.sum(product * transfer.imag, axis=-1) * response.wavenumbers
        return total

    def map(
        self,
        *,
        tolerance: float = 1e-2,
        spread: Spread = one_by_one,
        progress: Callable[[float], None] | None = None,
    ) -> ForceMap:
        """The same forces as a map over the whole domain, for studies that ask often; its residual is on record.

        Parameters
        ----------
        tolerance : relative, for forces and stiffnesses
        spread : shares the positions out over processes
        progress : told the fraction done
        """
        return ForceMap.of(self, tolerance=tolerance, spread=spread, progress=progress)

    def scaled(self, factor: ArrayLike) -> EddyCurrentForce:
        """The same magnet with every force times `factor` (its current times the square root)."""
        return replace(self, strength=read_only(self.strength * checked_factor(factor), name="strength"))

    def _weights(self, height: float, gap: float | None, *, order: int) -> tuple[FloatArray, ...]:
        """Pattern weights and their derivatives of every coil group; (1, 4 or 10, n, modes) each."""
        return tuple(self.response.weights(one) for one in self._potentials(height, gap, order=order))

    def _potentials(self, height: float, gap: float | None, *, order: int) -> list[FloatArray]:
        """Potentials of every coil group at the samples; (1, 4 or 10, n, m) each."""
        found, beside, first = [], 0.0 if gap is None else gap, self.coils[0]
        pivot = np.array([beside + first.lateral, height + first.height])
        for group in self._groups:
            line = group.line(beside, height, line_points(group, beside, height, self.response.samples), pivot=pivot)
            found.append(dipole_potential(self.response.wavenumbers, self.response.samples, line, order=order))
        return found

    def _pairs(self, weights: tuple[FloatArray, ...]) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
        return [(weights[i], weights[j], share) for i, j, share in self._shares]

    def _steady(self, weights: tuple[FloatArray, ...], transfer: ComplexArray) -> FloatArray:
        """Drag, then the forces by sway, heave and roll."""
        k, total = self.response.wavenumbers[:, None], np.zeros(4)
        for a, b, share in self._pairs(weights):
            total[0] -= np.sum(share * k * transfer.imag * a[0] * b[0])
            product = share * transfer.real * a[0]
            total[1:] += np.sum(product * b[1:4], axis=(1, 2))
        return total

    def _slopes(self, weights: tuple[FloatArray, ...], transfer: ComplexArray, slope: ComplexArray) -> FloatArray:
        """Drag, guidance, lift (rows) by speed, gap, height (columns)."""
        k, total = self.response.wavenumbers[:, None], np.zeros((3, 3))
        for a, b, share in self._pairs(weights):
            total[0, 0] -= np.sum(share * k**2 * slope.imag * a[0] * b[0])
            for i in (1, 2):
                total[0, i] -= np.sum(share * k * transfer.imag * (a[i] * b[0] + a[0] * b[i]))
                total[i, 0] += np.sum(share * k * slope.real * a[0] * b[i])
                for j in (1, 2):
                    second = _SECOND[min(i, j), max(i, j)]
                    total[i, j] += np.sum(share * transfer.real * (a[0] * b[second] + a[i] * b[j]))
        return total

    def _energy_and_drag(self, weights: tuple[FloatArray, ...], transfer: ComplexArray) -> FloatArray:
        k, total = self.response.wavenumbers[:, None], np.zeros(2)
        for a, b, share in self._pairs(weights):
            product = share * a[0] * b[0]
            total[0] += 0.5 * np.sum(product * transfer.real)
            total[1] -= np.sum(product * k * transfer.imag)
        return total

    def _each(
        self, height: ArrayLike, gap: ArrayLike | None, speed: ArrayLike, find: Callable[..., FloatArray], *, order: int
    ) -> FloatArray:
        """`find` at every point; what depends on the position alone is found once for all its speeds."""
        self.domain.require(height, gap, speed)
        gaps = np.zeros(()) if gap is None else np.asarray(gap, dtype=np.float64)
        h, g, v = np.broadcast_arrays(np.asarray(height, dtype=np.float64), gaps, np.asarray(speed, dtype=np.float64))
        places, where = np.unique(np.stack([h.ravel(), g.ravel()]), axis=1, return_inverse=True)
        speeds, which = np.unique(v.ravel(), return_inverse=True)
        transfer, slope = self.response.transfer(speeds), None
        if order == 2:
            slope = self.response.transfer_slope(speeds)
        found: list[FloatArray] = [np.empty(0)] * h.size
        for place in range(places.shape[1]):
            weights = self._weights(float(places[0, place]), float(places[1, place]), order=order)
            for point in np.flatnonzero(where == place):
                at = which[point]
                extra = () if slope is None else (slope[at],)
                found[point] = find(weights, transfer[at], *extra)
        return np.asarray(found).reshape(*h.shape, *np.shape(found[0]))


def _track_shares(groups: tuple[CoilGroup, ...], response: GuidewayResponse) -> tuple[tuple[int, int, FloatArray], ...]:
    """Pairs of coil groups with their weights over wavenumbers (n, 1): Int X_a X_b f dk / pi."""
    points = len(response.wavenumbers) // (len(response.panels) - 1)
    found = []
    for i, a in enumerate(groups):
        for j, b in enumerate(groups):

            def factor(k: FloatArray, a: CoilGroup = a, b: CoilGroup = b) -> FloatArray:
                return a.transform(k) * b.transform(k)

            weights = product_weights(response.panels, points, factor, extent=max(a.extent, b.extent))
            found.append((i, j, read_only(weights[:, None] / np.pi, name="weights")))
    return tuple(found)


def _require_ranges(**ranges: tuple[float, float] | None) -> None:
    for name, span in ranges.items():
        if span is None:
            continue
        low, high = span
        if not (np.isfinite(low) and np.isfinite(high) and 0.0 < low <= high):
            why = "; at rest there are no currents and no forces" if name == "speed" and low == 0.0 else ""
            raise ValueError(f"{name}: expected a range of positive numbers, the least first, got {span}{why}")


def _region(group: CoilGroup, *, height: tuple[float, float], gap: tuple[float, float] | None) -> Region:
    """The box through which a group's line moves."""
    ends = np.concatenate([group.coils[0].sides(g, h) for g in (gap or (0.0,)) for h in height])
    (left, low), (right, high) = ends.min(axis=0), ends.max(axis=0)
    return (float(left), float(right)), (float(low), float(high))
