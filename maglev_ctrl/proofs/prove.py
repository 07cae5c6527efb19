"""Re-check claims about closed loops with arithmetic whose rounding is bounded, or exactly."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from maglev_ctrl.proofs.claims import (
    Claim,
    DecayClaim,
    EllipsoidClaim,
    EnergyClaim,
    GainClaim,
    ParameterClaim,
    Proof,
    RegionClaim,
    SegmentClaim,
)
from maglev_ctrl.proofs.enclosure import Enclosure, NotDecided, definite
from maglev_ctrl.proofs.exact import Exact, exactly_definite
from maglev_ctrl.proofs.inequalities import conditions
from maglev_ctrl.proofs.loops import Blend, Loop, M, Mismatch, blend_of, check_fit, closed_loop, control_points
from maglev_ctrl.proofs.statements import between, statement
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant

ROUNDED = "rounding bounds"
RATIONAL = "rational arithmetic"
UNDECIDED = "undecided"
"""The reason given where an arithmetic can tell neither that a claim holds nor that it does not."""


def prove(claim: Claim, plants: Sequence[Plant], controllers: Sequence[Controller], *, exactly: bool = True) -> Proof:
    """Re-check one claim; no solver is trusted.

    The closed loops are formed here, from the stored numbers of plants and laws. First with rounding bounds; what
    these cannot tell is decided in rational arithmetic. What neither decides does not hold.

    Parameters
    ----------
    plants, controllers : of the design; the claim's indices count in them
    exactly : whether rational arithmetic may be asked; without it the answer is quick

    Raises
    ------
    ValueError : an index is outside `plants` or `controllers`, or their numbers differ

    Examples
    --------
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]])
    >>> law = Controller.static([[-3.0]], measured=("x1",), commands=("u1",))
    >>> proof = prove(DecayClaim((0,), (0,), 1.5, np.ones((1, 1, 1))), [plant], [law])
    >>> proof.statement, proof.holds
    ('every pole of the closed loop decays at 1.5 1/s or faster', True)
    >>> prove(DecayClaim((0,), (0,), 2.0, np.ones((1, 1, 1))), [plant], [law]).holds
    False
    """
    _check_indices(claim, plants, controllers)
    chosen = [plants[i] for i in claim.plants]
    laws = [controllers[i] for i in claim.controllers]
    try:
        dt = check_fit(chosen, laws)
        blend, covered = _coverage(claim, chosen, laws)
        told = statement(claim, chosen, covered)
        _check_claim(claim, chosen, laws, dt, blend)
    except Mismatch as fault:
        return Proof(statement(claim, chosen, ""), False, np.nan, ROUNDED, str(fault))
    with np.errstate(all="ignore"):
        rounded = _decided(claim, Enclosure, chosen, laws, dt, blend, told)
        if rounded is not None:
            return rounded
        if not exactly:
            return Proof(told, False, np.nan, ROUNDED, UNDECIDED)
        exact = _decided(claim, Exact, chosen, laws, dt, blend, told)
    return exact if exact is not None else Proof(told, False, np.nan, RATIONAL, UNDECIDED)


def _check_indices(claim: Claim, plants: Sequence[Plant], controllers: Sequence[Controller]) -> None:
    if not claim.plants or len(claim.plants) != len(claim.controllers):
        raise ValueError(
            f"claim: expected as many plants as controllers, at least one, got {claim.plants} and {claim.controllers}"
        )
    for key, indices, count in (
        ("plants", claim.plants, len(plants)),
        ("controllers", claim.controllers, len(controllers)),
    ):
        if not all(0 <= i < count for i in indices):
            raise ValueError(f"claim.{key}: expected indices below {count}, got {indices}")


def _coverage(claim: Claim, plants: Sequence[Plant], laws: Sequence[Controller]) -> tuple[Blend | None, str]:
    """How the loops between the given ones are covered (None: they are not), and the words for it."""
    if isinstance(claim, SegmentClaim | ParameterClaim):
        return blend_of(plants, laws), ""
    shared = claim.X if isinstance(claim, RegionClaim) else claim.P
    if len(plants) == 1 or len(shared) != 1:
        return None, ""
    blend = blend_of(plants, laws)
    common_law = len(set(claim.controllers)) == 1
    if blend.degree == 0 and common_law:
        raise Mismatch("a loop between these plants is no polynomial of their matrices (D22 is not zero)")
    if not common_law and (blend.degree == 0 or (blend.degree > 1 and not getattr(claim, "cross", False))):
        return None, ""
    return blend, between(claim)


def _check_claim(
    claim: Claim, plants: Sequence[Plant], laws: Sequence[Controller], dt: float | None, blend: Blend | None
) -> None:
    """Sizes and numbers of a claim.

    Raises
    ------
    Mismatch : the claim cannot be about these loops
    """
    n, count = plants[0].A.shape[0] + laws[0].A.shape[0], len(plants)
    P = claim.X if isinstance(claim, RegionClaim) else claim.P
    several = isinstance(claim, ParameterClaim | SegmentClaim)
    if P.shape[1:] != (n, n) or len(P) not in ((count,) if several else (1, count)):
        raise Mismatch(f"{count} loops with {n} states need a certificate matrix of that size, got shape {P.shape}")
    numbers = [np.asarray(P)]
    match claim:
        case DecayClaim(rate=rate):
            numbers.append(np.asarray(float(rate) + float(rate)))  # the inequality holds it doubled
        case RegionClaim(L=L, M=matrix):
            numbers += [L, matrix]
            if L.ndim != 2 or not L.size or L.shape != matrix.shape or not np.array_equal(L, L.T):
                raise Mismatch("the region needs square matrices L (symmetric) and M of one size")
        case GainClaim(gamma=bound) | EnergyClaim(level=bound):
            numbers.append(np.asarray(bound))
            if not bound > 0.0:
                raise Mismatch(f"the bound {bound} is not positive")
        case EllipsoidClaim(limits=limits):
            numbers.append(np.asarray(limits))
            if len(limits) != len(plants[0].commands) or not all(x > 0.0 for x in limits):
                raise Mismatch(f"{len(plants[0].commands)} commands need as many positive limits, got {limits}")
        case ParameterClaim(rate=rate, V=V, time=time):
            numbers += [np.asarray(rate), np.asarray(time), V]
            if not time > 0.0:
                raise Mismatch(f"the unit of time {time} is not positive")
            if V.shape != (n, n):
                raise Mismatch(f"the slack matrix has shape {V.shape}, the loops have {n} states")
        case SegmentClaim(width=width, speed_limit=speed):
            numbers += [np.asarray(width), np.asarray(speed)]
            if count != 2 or not width > 0.0 or not speed >= 0.0:
                raise Mismatch("a segment needs two loops, a positive width and a speed limit that is not negative")
    if not all(np.isfinite(x).all() for x in numbers):
        raise Mismatch("the claim holds a number that is not finite")
    if several and dt is not None:
        raise Mismatch("this claim is made for continuous loops only")
    if blend is not None and several and blend.degree != 1:
        if isinstance(claim, ParameterClaim):
            raise Mismatch("the loops between these are no blends of their matrices; this inequality needs that")
        if blend.degree == 0:
            raise Mismatch("a loop between these plants is no polynomial of their matrices (D22 is not zero)")


def _decided(
    claim: Claim,
    kind: type[M],
    plants: Sequence[Plant],
    laws: Sequence[Controller],
    dt: float | None,
    blend: Blend | None,
    told: str,
) -> Proof | None:
    """The outcome in one arithmetic; None where it cannot tell."""  # fmt: skip
    method = ROUNDED if kind is Enclosure else RATIONAL
    margin = np.inf
    try:
        loops: list[Loop[M]] = (
            [closed_loop(kind, p, k, p, p) for p, k in zip(plants, laws, strict=True)]
            if blend is None
            else control_points(kind, plants, laws, blend)
        )
        selected = _selection(claim, plants[0])
        for where, matrix in conditions(claim, kind, loops, dt, *selected):
            if isinstance(matrix, Enclosure):
                proved, value, hopeless = definite(matrix)
                margin = min(margin, value)
                if hopeless:
                    return Proof(told, False, margin, method, f"{where} is violated")
                if not proved:
                    return None
            elif isinstance(matrix, Exact):
                sign, value = exactly_definite(matrix)
                margin = float(np.fmin(margin, value))
                if sign is not True:
                    why = f"{where} is violated" if sign is False else f"{where}: undecided"
                    return Proof(told, False, margin, method, why)
    except ZeroDivisionError:
        return Proof(told, False, np.nan, method, "the algebraic loop I - D22 D is singular")
    except NotDecided:
        return None
    except Mismatch as fault:
        if kind is Enclosure:  # D is only zero in exact arithmetic, perhaps
            return None
        return Proof(told, False, np.nan, method, str(fault))
    return Proof(told, True, margin, method)


def _selection(claim: Claim, plant: Plant) -> tuple[list[int], list[int]]:
    """Columns and rows of the channel a claim is about.

    Raises
    ------
    Mismatch : a name is unknown
    """
    if not isinstance(claim, GainClaim | EnergyClaim):
        return [], []
    found = []
    for wanted, names in ((claim.disturbances, plant.disturbances), (claim.performance, plant.performance)):
        unknown = [name for name in wanted if name not in names]
        if unknown:
            raise Mismatch(f"{unknown[0]!r} is not a signal of {plant.name!r}")
        found.append([names.index(name) for name in wanted] if wanted else list(range(len(names))))
    return found[0], found[1]
