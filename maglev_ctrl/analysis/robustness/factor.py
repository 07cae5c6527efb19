"""By what factor the spreads may grow: proven from below, found from above, the gap between the two told.

Where the two stay apart the parameter box is split and every part proven on its own: the bound by scales is exact in
the limit of small boxes (branch and bound).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import monotonic

import numpy as np

from maglev_ctrl.analysis.hamiltonian import response
from maglev_ctrl.analysis.robustness.certificate import Proof, prove
from maglev_ctrl.analysis.robustness.records import FactorBounds
from maglev_ctrl.analysis.robustness.scalings import real_mu_upper
from maglev_ctrl.analysis.robustness.search import Crossing, corners, growth_rates, smallest_crossing
from maglev_ctrl.analysis.robustness.uncertain_loop import UncertainLoop
from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.errors import Agreement

AGREEMENT = 0.05
REPLAY = 1e-6
_NEAR_LIMIT = 0.999
_MOST_BOXES = 4000
_LOOKS = 128
StateMatrix = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, eq=False, slots=True)
class BoxProof:
    """Outcome of a proof by parts: `stable` True (proven), False (an unstable centre was met, `point`), None (time)."""

    stable: bool | None
    boxes: int
    point: FloatArray | None


def factor_bounds(
    loop: UncertainLoop,
    *,
    limit: float | None = None,
    time_limit: float = 5.0,
    assembled: StateMatrix | None = None,
) -> FactorBounds:
    """Bounds on the factor by which all spreads may grow together before stability is lost.

    Parameters
    ----------
    limit : how far to look; left out, where the first parameter would fall to zero (one over the largest spread)
    time_limit : s, for splitting the box; the first bounds from both sides are always found
    assembled : state matrix of the model assembled again at changes (p,), for the replay; left out, the loop's own

    Raises
    ------
    ValueError : the nominal loop is not stable, or a limit is not positive

    Examples
    --------
    >>> pair = UncertainLoop.from_affine([[0.0, 1.0], [-4.0, -0.1]], [[[0.0, 0.0], [0.0, -0.1]]])
    >>> bounds = factor_bounds(pair, limit=10.0)
    >>> round(bounds.found, 6), bounds.proven > 0.95
    (1.0, True)
    """
    reach = _NEAR_LIMIT / float(np.max(loop.spreads)) if limit is None else float(limit)
    if not (np.isfinite(reach) and reach > 0.0 and time_limit > 0.0):
        raise ValueError(f"limit, time_limit: expected positive numbers, got {limit!r}, {time_limit!r}")
    deadline = monotonic() + time_limit
    level = 1.0 / reach
    for share in (0.6, 0.5, 0.5, 1.0):  # a tight level takes time; a generous one is proven at a glance
        proof = prove(loop, level=level, rising=True, deadline=monotonic() + share * max(deadline - monotonic(), 0.1))
        if proof.complete:
            break
        level = 2.0 * proof.level
    proven = min(1.0 / proof.level, reach) if proof.complete else 0.0
    boxes = 1
    found: Crossing | None = None
    if proven < reach * (1.0 - 1e-9):
        found = smallest_crossing(loop, limit=reach, safe=proven, deadline=deadline)
        proven, found, more = _tightened(loop, proven, found, proof, reach, deadline)
        boxes += more
    if _refuted(loop, proven):
        return _told(loop, 0.0, found, reach, boxes, assembled)
    return _told(loop, proven, found, reach, boxes, assembled)


def prove_box(loop: UncertainLoop, *, factor: float, deadline: float, frequency: float | None = None) -> BoxProof:
    """Prove the box of half width `factor` stable part by part, splitting what cannot be proven whole.

    Examples
    --------
    >>> loop = UncertainLoop.from_affine([[-1.0]], [[[1.0]]])
    >>> prove_box(loop, factor=0.9, deadline=float("inf")).stable, prove_box(loop, factor=3.0, deadline=1e9).stable
    (True, False)
    """
    p = len(loop.blocks)
    waiting = [(np.zeros(p), np.full(p, factor), frequency)]
    done = 0
    while waiting:
        centre, half, hint = waiting.pop()
        done += 1
        if done > _MOST_BOXES or monotonic() > deadline:
            return BoxProof(None, done, None)
        if growth_rates(loop, centre[None])[0] >= 0.0:
            return BoxProof(False, done, centre)
        part = loop.recentred(centre, half)
        seeds = () if hint is None else (hint,)
        proof = prove(part, level=1.0, deadline=deadline, seeds=seeds)
        if proof.complete:
            continue
        if monotonic() > deadline:
            return BoxProof(None, done, None)
        k = _tellingest(part, proof.frequency)
        narrow = half.copy()
        narrow[k] *= 0.5
        for side in (-1.0, 1.0):
            moved = centre.copy()
            moved[k] += side * narrow[k]
            waiting.append((moved, narrow, proof.frequency))
    return BoxProof(True, done, None)


def _refuted(loop: UncertainLoop, proven: float) -> bool:
    """Whether eigenvalues at corners and at points inside contradict the proof: the second method."""
    p = len(loop.blocks)
    inside = np.random.default_rng(5).uniform(-1.0, 1.0, (_LOOKS, p))
    points = proven * (1.0 - 1e-9) * np.vstack([corners(p), inside])
    return bool(proven > 0.0 and np.any(growth_rates(loop, points) >= 0.0))


def _tellingest(loop: UncertainLoop, frequency: float) -> int:
    """The parameter whose halving lowers the bound at the frequency most."""
    value = response(loop.A, loop.B, loop.C, loop.D, np.array([frequency]))[0]
    bounds = []
    for k in range(len(loop.blocks)):
        weights = np.ones(len(loop.blocks))
        weights[k] = 0.5
        bounds.append(real_mu_upper(loop.diagonal(weights)[:, None] * value, loop.blocks).value)
    return int(np.argmin(bounds))


def _tightened(
    loop: UncertainLoop, proven: float, found: Crossing | None, proof: Proof, reach: float, deadline: float
) -> tuple[float, Crossing | None, int]:
    """Split the box while the two bounds are apart and there is time."""
    boxes = 0
    aim = 0.5 * AGREEMENT
    while monotonic() < deadline:
        top = found.size if found is not None else reach
        if proven >= top * (1.0 - 0.9 * AGREEMENT) or (found is None and proven >= reach * (1.0 - 1e-9)):
            break
        # The end of the gap first: with a good point from the search one proof settles everything.
        factor = (1.0 - aim) * top if found is not None else top
        share = monotonic() + 0.6 * (deadline - monotonic())
        outcome = prove_box(loop, factor=factor, deadline=share, frequency=proof.frequency)
        boxes += outcome.boxes
        if outcome.stable:
            proven = factor
        elif outcome.point is not None:
            better = smallest_crossing(loop, limit=float(np.max(np.abs(outcome.point))) or factor, safe=proven,
                                       deadline=deadline, also=outcome.point)  # fmt: skip
            if better is None or (found is not None and better.size >= found.size):
                break
            found = better
        else:
            middle = float(np.sqrt(max(proven, 1e-3 * factor) * factor))
            outcome = prove_box(loop, factor=middle, deadline=deadline, frequency=proof.frequency)
            boxes += outcome.boxes
            if outcome.stable:
                proven = middle
            break
    return proven, found, boxes


def _told(
    loop: UncertainLoop, proven: float, found: Crossing | None, reach: float, boxes: int, assembled: StateMatrix | None
) -> FactorBounds:
    p = len(loop.blocks)
    if found is None:
        whole = proven >= reach * (1.0 - 1e-6)
        return FactorBounds(
            proven=float(proven), found=np.inf, changes=read_only_any(np.full(p, np.nan)), frequency=np.nan,
            pole_distance=np.nan, limit=reach, boxes=boxes,
            agreement=Agreement.AGREED if whole else Agreement.UNRESOLVED,
            reason=f"stable up to the limit {reach:.4g}" if whole
            else f"no unstable combination found up to {reach:.4g}, stability proven up to {proven:.4g} only",
        )  # fmt: skip
    matrix = loop.state_matrix(found.changes) if assembled is None else assembled(found.changes)
    poles = np.linalg.eigvals(matrix)
    top = poles[int(np.argmax(poles.real))]
    scale = abs(top) if abs(top.imag) > 1e-6 * np.max(np.abs(poles)) else float(np.max(np.abs(poles)))
    distance = float(abs(top.real) / scale) if scale > 0.0 else 0.0
    replayed = distance <= REPLAY
    agreed = replayed and found.size <= proven * (1.0 + AGREEMENT)
    reason = "" if agreed else f"UNRESOLVED: proven stable up to {proven:.4g}, unstable found at {found.size:.4g}"
    if not replayed:
        reason = f"UNRESOLVED: the model assembled again has its pole {distance:.2g} away from the axis"
    return FactorBounds(
        proven=float(proven), found=float(found.size) if replayed else np.nan, changes=read_only_any(found.changes),
        frequency=found.frequency, pole_distance=distance, limit=reach, boxes=boxes,
        agreement=Agreement.AGREED if agreed else Agreement.UNRESOLVED, reason=reason,
    )  # fmt: skip
