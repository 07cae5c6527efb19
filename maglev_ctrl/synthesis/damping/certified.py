"""What can be proved of chosen dampings: decay at every vertex, for every blend of vertices, and under more damping."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import ModelError
from maglev_ctrl.proofs.claims import Claim, DecayClaim, ParameterClaim, RegionClaim
from maglev_ctrl.proofs.makers import lyapunov_claim
from maglev_ctrl.proofs.prove import prove
from maglev_ctrl.synthesis.damping.lyapunov import common_lyapunov, parameter_lyapunov, region_matrix
from maglev_ctrl.synthesis.damping.places import DampedFamily
from maglev_ctrl.synthesis.lmi.regions import damping as damping_sector

Guarantee = Literal["each vertex", "every constant blend", "any variation"]
GUARANTEES: tuple[Guarantee, ...] = ("each vertex", "every constant blend", "any variation")
FACTORS = (1.05, 1.1, 1.2, 1.5, 2.0, 3.0, 5.0, 10.0)


@dataclass(frozen=True, eq=False, slots=True)
class Assurance:
    """Claims about dampings, the strongest guarantee among those that hold, and why stronger ones are not carried."""

    claims: tuple[Claim, ...]
    carried: Guarantee | None
    reasons: tuple[str, ...]


@dataclass(frozen=True, eq=False, slots=True)
class MoreDamping:
    """What multiplying the damping at `place` ("every place" for all) by 1.2 does, and how far it may be raised.

    `proved` the decay rate is proved again at 1.2 times; `lost_at` the least factor out of `FACTORS` at which a vertex
    no longer decays at the rate or ratio (infinite where none does); `unstable_at` likewise for stability.
    """

    place: str
    proved: bool
    lost_at: float
    unstable_at: float

    @property
    def warning(self) -> str:
        """What more damping spoils, in a sentence; empty where 20 % more is proved and 10 times loses nothing."""
        if np.isfinite(self.unstable_at):
            return f"{self.unstable_at:g} times the damping at {self.place} destabilises"
        if np.isfinite(self.lost_at):
            return f"{self.lost_at:g} times the damping at {self.place} loses the margin"
        return "" if self.proved else f"20 % more damping at {self.place} is not proved to keep the margin"


def assurance(
    family: DampedFamily,
    c: FloatArray,
    rate: float,
    T: FloatArray,
    *,
    wanted: Guarantee = "every constant blend",
    ratio: float = 0.0,
) -> Assurance:
    """Claims of decay at `rate` that hold for dampings c, up to the guarantee `wanted` (and beyond where it is free).

    Parameters
    ----------
    family : unscaled
    T : (n,) scaling of the states
    ratio : least damping ratio claimed at every vertex too; 0 claims none

    Examples
    --------
    >>> from maglev_ctrl.synthesis.damping.places import DampingPlace, damped_family
    >>> from maglev_ctrl.systems import SecondOrderSystem
    >>> mass = SecondOrderSystem.from_matrices([[2.0]], [[0.0]], [[8.0]])
    >>> family = damped_family([mass], [DampingPlace("leg", [1.0])])
    >>> assurance(family, np.array([2.1]), 0.5, np.ones(2)).carried
    'any variation'
    """
    loops, laws = family.loops(c), [family.law(c)]
    every = tuple(range(len(loops)))
    alone = (0,) * len(loops)
    try:
        own = lyapunov_claim(family.plants, laws, rate=rate)
    except ModelError as fault:
        return Assurance((), None, (str(fault),))
    claims: list[Claim] = [replace(own, plants=(i,), controllers=(0,), P=own.P[i : i + 1]) for i in every]
    if ratio > 0.0:
        sector = damping_sector(ratio)
        for i in every:
            X = region_matrix(loops[i], sector.L, sector.M, T)
            if X is None:
                return Assurance((), None, (f"no proof of a damping ratio of {ratio:g} at vertex {i + 1}",))
            claims.append(RegionClaim((i,), (0,), sector.label, sector.L, sector.M, X[None]))
    failed = [proof.reason for proof in (prove(claim, family.plants, laws) for claim in claims) if not proof.holds]
    if failed:
        return Assurance((), None, tuple(failed))
    if len(loops) == 1:
        return Assurance(tuple(claims), "any variation", ())
    reasons: list[str] = []
    if wanted != "each vertex":
        common, margin = common_lyapunov(loops, rate, T)
        if common is not None:
            claim = DecayClaim(every, alone, rate, common[None])
            proof = prove(claim, family.plants, laws)
            if proof.holds:
                return Assurance((*claims, claim), "any variation", ())
            reasons.append(f"any variation: {proof.reason}")
        else:
            reasons.append(f"any variation: no common P was found (largest scaled margin {margin:.1e})")
        pair = parameter_lyapunov(loops, rate, T)
        if pair is not None:
            blends = ParameterClaim(every, alone, rate, *pair)
            proof = prove(blends, family.plants, laws)
            if proof.holds:
                return Assurance((*claims, blends), "every constant blend", tuple(reasons))
            reasons.append(f"every constant blend: {proof.reason}")
        else:
            reasons.append("every constant blend: no P that follows the blend was found")
    return Assurance(tuple(claims), "each vertex", tuple(reasons))


def more_damping(
    family: DampedFamily, c: FloatArray, rate: float, T: FloatArray, *, ratio: float = 0.0
) -> tuple[MoreDamping, ...]:
    """Whether more damping keeps what was certified: at every place together, and at each place alone.

    Stabilising dampings need not be an upward closed set: unequal damping of two coupled freedoms can destabilise.

    Examples
    --------
    >>> from maglev_ctrl.synthesis.damping.places import DampingPlace, damped_family
    >>> from maglev_ctrl.systems import SecondOrderSystem
    >>> mass = SecondOrderSystem.from_matrices([[2.0]], [[0.0]], [[8.0]])
    >>> family = damped_family([mass], [DampingPlace("leg", [1.0])])
    >>> more_damping(family, np.array([2.1]), 0.5, np.ones(2))[0].lost_at  # an overdamped mass creeps
    10.0
    """
    k = len(c)
    raised: list[tuple[str, FloatArray]] = [("every place", np.ones(k))]
    if k > 1:
        raised += [(family.places[j], np.eye(k)[j]) for j in range(k) if c[j] > 0.0]
    return tuple(_raised(family, c, rate, T, place, which, ratio) for place, which in raised)


def _raised(
    family: DampedFamily, c: FloatArray, rate: float, T: FloatArray, place: str, which: FloatArray, ratio: float
) -> MoreDamping:
    poles = [np.linalg.eigvals(family.loops(c * (1.0 + (factor - 1.0) * which))) for factor in FACTORS]
    worst = [float(np.max(s.real)) for s in poles]
    lost = [
        max(right + rate, float(np.max(s.real * np.sqrt(1.0 - ratio**2) + ratio * np.abs(s.imag))) if ratio else -1.0)
        for s, right in zip(poles, worst, strict=True)
    ]
    more = c * (1.0 + 0.2 * which)
    proved = assurance(family, more, rate, T, wanted="each vertex", ratio=ratio).carried is not None
    return MoreDamping(place, proved, _first(lost), _first(worst))


def _first(excess: Sequence[float]) -> float:
    return next((factor for factor, value in zip(FACTORS, excess, strict=True) if value >= 0.0), float("inf"))
