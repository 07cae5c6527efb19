"""By what factor the spreads may grow: proven from below, found from above, the gap between the two told.

Where the two stay apart the parameter box is split and every part proven on its own: the bound by scales is exact in
the limit of small boxes (branch and bound).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from maglev_ctrl.analysis.hamiltonian import response
from maglev_ctrl.analysis.robustness.certificate import prove
from maglev_ctrl.analysis.robustness.records import FactorBounds
from maglev_ctrl.analysis.robustness.scalings import real_mu_upper, scaled_response
from maglev_ctrl.analysis.robustness.search import SEED, Crossing, corners, growth_rates, smallest_crossing
from maglev_ctrl.analysis.robustness.uncertain_loop import UncertainLoop
from maglev_ctrl.analysis.robustness.work import Work, matrix_cost
from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.errors import Agreement

AGREEMENT = 0.05
REPLAY = 1e-6
_NEAR_LIMIT = 0.999
_MOST_BOXES = 4000
_LOOKS = 128
_SHARES = (0.25, 0.25, 0.5, 1.0)
_FIRST = 0.35
_NEXT = 0.6
_CLOSE = 1.02
_NEARLY_TOP = 30.0
EFFORT = 2.5e6
LATE = "the emergency stop by the clock struck: without it the search goes further"
StateMatrix = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, eq=False, slots=True)
class BoxProof:
    """Outcome of a proof by parts: `stable` True, False (an unstable centre was met, `point`), None (no work left)."""

    stable: bool | None
    boxes: int
    point: FloatArray | None


def factor_bounds(
    loop: UncertainLoop,
    *,
    limit: float | None = None,
    effort: float = EFFORT,
    time_limit: float | None = None,
    assembled: StateMatrix | None = None,
    seed: int = SEED,
) -> FactorBounds:
    """Bounds on the factor by which all spreads may grow together before stability is lost.

    Parameters
    ----------
    limit : how far to look; left out, where the first parameter would fall to zero (one over the largest spread)
    effort : units of `Work` for the proof, about a microsecond each; the result depends on nothing else
    time_limit : s, an emergency stop; None: the clock is never looked at. Where it strikes, `reason` says so
    assembled : state matrix of the model assembled again at changes (p,), for the replay; left out, the loop's own
    seed : of the starts of the search from above

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
    return bounded(loop, Work(effort, time_limit=time_limit), limit=limit, assembled=assembled, seed=seed)


def bounded(
    loop: UncertainLoop,
    work: Work,
    *,
    limit: float | None = None,
    assembled: StateMatrix | None = None,
    seed: int = SEED,
) -> FactorBounds:
    """`factor_bounds` with a budget that is shared with other searches.

    Examples
    --------
    >>> pair = UncertainLoop.from_affine([[0.0, 1.0], [-4.0, -0.1]], [[[0.0, 0.0], [0.0, -0.1]]])
    >>> round(bounded(pair, Work(1e6), limit=10.0).found, 6)
    1.0
    """
    reach = _NEAR_LIMIT / float(np.max(loop.spreads)) if limit is None else float(limit)
    if not (np.isfinite(reach) and reach > 0.0):
        raise ValueError(f"limit: expected a positive number, got {limit!r}")
    if growth_rates(loop, np.zeros((1, len(loop.blocks))))[0] >= 0.0:
        raise ValueError("loop: expected a stable nominal loop")
    found = smallest_crossing(loop, limit=reach, work=work, seed=seed)
    proven, found, boxes = _proven(loop, found, reach, work, seed)
    if _refuted(loop, proven):
        proven = 0.0
    return _told(loop, proven, found, reach, boxes, assembled, late=work.late())


def prove_box(
    loop: UncertainLoop, *, factor: float, work: Work | None = None, frequency: float | None = None
) -> BoxProof:
    """Prove the box of half width `factor` stable part by part, splitting what cannot be proven whole.

    Examples
    --------
    >>> loop = UncertainLoop.from_affine([[-1.0]], [[[1.0]]])
    >>> prove_box(loop, factor=0.9).stable, prove_box(loop, factor=3.0).stable
    (True, False)
    """
    p = len(loop.blocks)
    budget = Work() if work is None else work
    waiting = [(np.zeros(p), np.full(p, factor), frequency)]
    done = 0
    while waiting:
        centre, half, hint = waiting.pop()
        done += 1
        if done > _MOST_BOXES or budget.ended():
            return BoxProof(None, done, None)
        if growth_rates(loop, centre[None])[0] >= 0.0:
            return BoxProof(False, done, centre)
        part = loop.recentred(centre, half)
        seeds = () if hint is None else (hint,)
        proof = prove(part, level=1.0, work=budget, seeds=seeds)
        if proof.complete:
            continue
        if budget.ended():
            return BoxProof(None, done, None)
        k = _tellingest(part, proof.frequency, budget)
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


def _tellingest(loop: UncertainLoop, frequency: float, work: Work) -> int:
    """The parameter whose box, made smaller, lowers the bound at the frequency fastest, with its scales held."""
    value = response(loop.A, loop.B, loop.C, loop.D, np.array([frequency]))[0]
    bound = real_mu_upper(value, loop.blocks)
    work.spend(bound.work + matrix_cost(loop.A.shape[0]))
    N, G = scaled_response(value, bound.scales), bound.scales.G
    cross = 1j * (G @ N)
    values, vectors = np.linalg.eigh(N.conj().T @ N + cross + cross.conj().T)
    # The best scales make several eigenvalues meet: all of them count.
    weights = np.exp(_NEARLY_TOP * (values / max(float(values[-1]), 1e-300) - 1.0))
    out, back = N @ vectors, G @ vectors
    slopes = np.sum(weights * (np.abs(out) ** 2 + np.real(1j * back.conj() * out)), axis=1)
    starts = np.concatenate([[0], np.cumsum(loop.blocks)[:-1]]).astype(int)
    return int(np.argmax(np.add.reduceat(slopes, starts)))


def _proven(
    loop: UncertainLoop, found: Crossing | None, reach: float, work: Work, seed: int
) -> tuple[float, Crossing | None, int]:
    """The largest box proven for the work there is: whole first, then in parts while the two bounds are apart."""
    top = found.size * (1.0 - 0.5 * AGREEMENT) if found is not None else reach
    level, proven, boxes = 1.0 / top, 0.0, 1
    frequency: float | None = None
    for share in _SHARES:  # a tight level takes work; a generous one is proven at a glance
        proof = prove(loop, level=level, rising=True, work=work.part(share))
        frequency = proof.frequency
        if proof.complete:
            proven = min(1.0 / proof.level, top)
            break
        level = 2.0 * proof.level
    # The end of the gap first: with a good point from the search one proof settles everything. Then the gap in halves.
    aim, failed, share = top, np.inf, _FIRST
    while proven < top * (1.0 - 1e-9) and not work.ended():
        outcome = prove_box(loop, factor=aim, work=work.part(share), frequency=frequency)
        boxes += outcome.boxes
        if outcome.stable:
            proven = aim
        elif outcome.point is None:
            failed = aim
        else:
            better = smallest_crossing(
                loop, limit=float(np.max(np.abs(outcome.point))), safe=proven, work=work, also=outcome.point, seed=seed
            )
            if better is None or (found is not None and better.size >= found.size):
                break
            found, top = better, better.size * (1.0 - 0.5 * AGREEMENT)
        ceiling = min(top, failed)
        if ceiling <= proven * _CLOSE:
            break
        aim = top if np.isinf(failed) else float(np.sqrt(max(proven, 1e-2 * ceiling) * ceiling))
        share = _NEXT
    return proven, found, boxes


def _told(
    loop: UncertainLoop,
    proven: float,
    found: Crossing | None,
    reach: float,
    boxes: int,
    assembled: StateMatrix | None,
    *,
    late: bool,
) -> FactorBounds:
    p = len(loop.blocks)
    stopped = f"; {LATE}" if late else ""
    if found is None:
        whole = proven >= reach * (1.0 - 1e-6)
        return FactorBounds(
            proven=float(proven), found=np.inf, changes=read_only_any(np.full(p, np.nan)), frequency=np.nan,
            pole_distance=np.nan, limit=reach, boxes=boxes,
            agreement=Agreement.AGREED if whole else Agreement.UNRESOLVED,
            reason=f"stable up to the limit {reach:.4g}" if whole
            else f"UNRESOLVED: no unstable combination found up to the limit {reach:.4g}, "
            f"stability proven up to {proven:.4g} only{stopped}",
        )  # fmt: skip
    matrix = loop.state_matrix(found.changes) if assembled is None else assembled(found.changes)
    poles = np.linalg.eigvals(matrix)
    top = poles[int(np.argmax(poles.real))]
    scale = abs(top) if abs(top.imag) > 1e-6 * np.max(np.abs(poles)) else float(np.max(np.abs(poles)))
    distance = float(abs(top.real) / scale) if scale > 0.0 else 0.0
    replayed = distance <= REPLAY
    agreed = replayed and found.size <= proven * (1.0 + AGREEMENT)
    reason = "" if agreed else (
        f"UNRESOLVED: proven stable up to {proven:.4g}, unstable found at {found.size:.4g}: "
        f"where between the two stability is lost is not known{stopped}"
    )  # fmt: skip
    if not replayed:
        reason = f"UNRESOLVED: the model assembled again has its pole {distance:.2g} away from the axis{stopped}"
    return FactorBounds(
        proven=float(proven), found=float(found.size) if replayed else np.nan, changes=read_only_any(found.changes),
        frequency=found.frequency, pole_distance=distance, limit=reach, boxes=boxes,
        agreement=Agreement.AGREED if agreed else Agreement.UNRESOLVED, reason=reason,
    )  # fmt: skip
