"""Linear-quadratic gains at the nodes of a parameter, interpolated, with the rate of change that is proved safe."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import ROUND_FLOOR, Context, Decimal

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray, read_only, read_only_any
from maglev_ctrl.errors import ModelError, Status
from maglev_ctrl.proofs.claims import DecayClaim, SegmentClaim
from maglev_ctrl.proofs.makers import lyapunov_claim
from maglev_ctrl.proofs.prove import prove
from maglev_ctrl.synthesis.channels import require_reachable
from maglev_ctrl.synthesis.lmi.session import Clock
from maglev_ctrl.synthesis.result import Performance, proven, refused
from maglev_ctrl.synthesis.riccati_batch import riccati_batch
from maglev_ctrl.synthesis.scheduling.records import BetweenCheck, ScheduledDesign, no_design
from maglev_ctrl.synthesis.scheduling.segments import (
    LARGEST,
    bernstein_loops,
    best_lyapunov,
    node_lyapunov,
    segment_limit,
)
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant
from maglev_ctrl.systems.scheduled import ScheduledController

LAW = "scheduled linear-quadratic regulator"
IN_HAND = 1e-3
"""Share of the largest rate that is not claimed, so that the inequality is strict."""


@dataclass(frozen=True, eq=False, slots=True)
class _Grid:
    """Nodes with their plants and gains u = K x."""

    nodes: FloatArray
    plants: tuple[Plant, ...]
    K: FloatArray

    def segments(self) -> list[list[FloatArray]]:
        A, B = (np.stack([getattr(p, key) for p in self.plants]) for key in ("A", "B2"))
        return [bernstein_loops(A[i : i + 2], B[i : i + 2], self.K[i : i + 2]) for i in range(len(self.nodes) - 1)]


def scheduled_lqr(
    plants: Sequence[Plant],
    nodes: ArrayLike,
    *,
    parameter: str = "speed",
    unit: str = "m/s",
    between: Sequence[tuple[float, Plant]] = (),
    plant_at: Callable[[float], Plant] | None = None,
    refinements: int = 4,
    wanted_rate: float | None = None,
    time_limit: float = 60.0,
) -> ScheduledDesign:
    """State feedback of least x'C1'C1 x + ... at every node, interpolated, proved for slow variation.

    The weights are those of each plant's performance: z = C1 x + D12 u, with D12 of full column rank. Between
    neighbouring nodes plant and law are blended linearly in the proof; the plants of `between` are closed with the
    interpolated law and proved one by one. First P from Lyapunov equations, then P by one inequality for all nodes;
    the one that carries the faster parameter is kept.

    Parameters
    ----------
    plants, nodes : continuous, all states measured; rising values of the parameter
    between : (value, plant) to check between the nodes
    plant_at : makes a plant at any value; used to add nodes where a segment or a check fails, or is too slow
    refinements : rounds in which nodes may be added
    wanted_rate : parameter unit per s; more is tried (refinement) until it is proved
    time_limit : s, for the inequalities

    Raises
    ------
    ValueError : numbers of plants and nodes differ, nodes do not rise, a plant is sampled, hides states, or D12 lacks
        rank
    ModelError : a mode that is not stable cannot be moved (it is named)

    Examples
    --------
    >>> plants = [Plant.from_matrices([[0.0, 1.0], [k, 0.0]], [[0.0], [1.0]], [[0.0], [1.0]],
    ...                               [[1.0, 0.0], [0.0, 0.0]], D12=[[0.0], [1.0]]) for k in (1.0, 2.0)]
    >>> design = scheduled_lqr(plants, [20.0, 40.0])
    >>> design.guarantee, design.rate_limit
    ('interpolated: any variation', inf)
    """
    places = read_only(nodes, name="nodes")
    _check(plants, places, between)
    clock = Clock(time_limit)
    grid = _Grid(places, tuple(plants), np.zeros(0))
    for round_left in range(refinements, -1, -1):
        grid = _with_gains(grid)
        matrices, limits = _matrices(grid, wanted_rate, clock)
        law = _schedule(grid, parameter, unit)
        checks = tuple(_check_between(value, plant, law) for value, plant in between)
        more = _new_nodes(grid, limits, checks, wanted_rate)
        if not more or plant_at is None or round_left == 0:
            break
        grid = _joined(grid, more, plant_at)
    corners = read_only(grid.nodes[:, None], name="corners")
    reason = _failure(grid, limits, checks, parameter, unit, refined=plant_at is not None)
    if reason or matrices is None:
        return no_design(refused(LAW, grid.plants, Status.NOT_VERIFIED, reason), corners)
    any_rate = all(np.array_equal(one, matrices[0]) for one in matrices)  # then P does not move with the parameter
    claimed = np.minimum(limits, LARGEST * (grid.nodes[-1] - grid.nodes[0])) * (1.0 - IN_HAND)
    fastest = np.inf if any_rate else float(np.min(claimed))
    claims = [
        SegmentClaim((i, i + 1), (i, i + 1), matrices[i : i + 2], float(width), float(limit))
        for i, (width, limit) in enumerate(zip(np.diff(grid.nodes), claimed, strict=True))
    ]
    slowest = float(np.max([np.max(np.linalg.eigvals(one[0]).real) for one in [*grid.segments(), _last(grid)]]))
    synthesis = proven(
        LAW, grid.plants, law.controllers, claims=claims,
        performance=[Performance("least decay rate at the nodes", np.nan, -slowest, "1/s")],
        notes=_notes(fastest, (len(between), len(plants), len(grid.nodes)), parameter, unit, wanted_rate),
    )  # fmt: skip
    if not synthesis.controllers:
        return no_design(synthesis, corners)
    if any_rate:
        claimed = np.full(len(claimed), np.inf)
    return ScheduledDesign(
        synthesis, law, "interpolated: any variation" if any_rate else "interpolated: slow variation",
        fastest, read_only_any(claimed), corners, checks,
    )  # fmt: skip


def _check(plants: Sequence[Plant], nodes: FloatArray, between: Sequence[tuple[float, Plant]]) -> None:
    if nodes.ndim != 1 or len(nodes) != len(plants) or len(nodes) < 2 or np.any(np.diff(nodes) <= 0.0):
        raise ValueError(f"nodes: expected {len(plants)} rising values, at least two, got {nodes.tolist()}")
    for value, _ in between:
        if not nodes[0] <= value <= nodes[-1]:
            raise ValueError(f"between: expected values from {nodes[0]:g} to {nodes[-1]:g}, got {value:g}")
    for plant in (*plants, *(one for _, one in between)):
        _check_plant(plant, plants[0])


def _check_plant(plant: Plant, first: Plant) -> None:
    if plant.dt is not None or not plant.measures_states:
        raise ValueError(f"plants: {plant.name!r}: expected a continuous plant that measures every state")
    if (plant.states, plant.commands) != (first.states, first.commands):
        raise ValueError(f"plants: {plant.name!r} has other states or commands than the first")
    if np.linalg.matrix_rank(plant.D12) < len(plant.commands):
        raise ValueError(f"plants: {plant.name!r}: D12: every command must be weighed in the performance")
    require_reachable(plant)


def _with_gains(grid: _Grid) -> _Grid:
    A, B, C, D = (np.stack([getattr(p, key) for p in grid.plants]) for key in ("A", "B2", "C1", "D12"))
    C_t, D_t = np.swapaxes(C, -1, -2), np.swapaxes(D, -1, -2)
    batch = riccati_batch(A, B, C_t @ C, D_t @ D, C_t @ D)
    K = np.where(batch.solved[:, None, None], -batch.gain, 0.0)
    return _Grid(grid.nodes, grid.plants, K)


def _matrices(grid: _Grid, wanted: float | None, clock: Clock) -> tuple[FloatArray | None, FloatArray]:
    """P of the nodes and the rate each segment bears; from Lyapunov equations or, where better, from inequalities."""
    segments, widths = grid.segments(), np.diff(grid.nodes)
    ends = np.stack([*(one[0] for one in segments), segments[-1][-1]])
    if np.max(np.linalg.eigvals(ends).real) >= 0.0:
        return None, np.zeros(len(widths))
    best, limits = node_lyapunov(ends), np.zeros(len(widths))
    if best is not None:
        limits = _limits(segments, best, widths)
        if wanted is not None and np.min(limits) * (1.0 - IN_HAND) >= wanted:
            return best, limits
    found, _ = best_lyapunov(segments, grid.nodes, start=float(np.min(limits)), clock=clock)
    if found is not None:
        other = _limits(segments, found, widths)
        if np.min(other) > np.min(limits):
            return found, other
    return best, limits


def _limits(segments: list[list[FloatArray]], P: FloatArray, widths: FloatArray) -> FloatArray:
    return np.array([
        segment_limit(one, P[i], P[i + 1], float(width)) for i, (one, width) in enumerate(zip(segments, widths,
                                                                                              strict=True))
    ])  # fmt: skip


def _schedule(grid: _Grid, parameter: str, unit: str) -> ScheduledController:
    first = grid.plants[0]
    laws = tuple(
        Controller.static(K, measured=first.measured, commands=first.commands, name=f"{parameter} {node:g} {unit}")
        for K, node in zip(grid.K, grid.nodes, strict=True)
    )
    return ScheduledController.from_nodes(parameter, unit, grid.nodes, laws)


def _check_between(value: float, plant: Plant, law: ScheduledController) -> BetweenCheck:
    here = law.at(value)
    loop = plant.A + plant.B2 @ here.D
    try:
        claim = lyapunov_claim([plant], [here])
    except ModelError:
        claim = DecayClaim((0,), (0,), 0.0, np.zeros((1, *loop.shape)))  # told as a proof that does not hold
    proof = prove(claim, [plant], [here])
    return BetweenCheck(value, float(np.max(np.linalg.eigvals(loop).real)), proof)


def _new_nodes(grid: _Grid, limits: FloatArray, checks: tuple[BetweenCheck, ...], wanted: float | None) -> list[float]:
    """Where nodes are missing: the middle of a segment that fails or is too slow, and plants that are not stable."""
    level = 0.0 if wanted is None else wanted / (1.0 - IN_HAND)
    middles = 0.5 * (grid.nodes[:-1] + grid.nodes[1:])
    weak = [float(x) for x, limit in zip(middles, limits, strict=True) if limit <= 0.0 or limit < level]
    return sorted({*weak, *(check.value for check in checks if not check.proof.holds)} - set(grid.nodes.tolist()))


def _joined(grid: _Grid, more: list[float], plant_at: Callable[[float], Plant]) -> _Grid:
    known = dict(zip(grid.nodes.tolist(), grid.plants, strict=True))
    for value in more:
        known[value] = plant_at(value)
        _check_plant(known[value], grid.plants[0])
    places = sorted(known)
    return _Grid(read_only(places, name="nodes"), tuple(known[x] for x in places), np.zeros(0))


def _failure(
    grid: _Grid, limits: FloatArray, checks: tuple[BetweenCheck, ...], parameter: str, unit: str, *, refined: bool
) -> str:
    help_text = "more refinements or a denser grid" if refined else "give a denser grid, or plant_at to refine it"
    for check in checks:
        if not check.proof.holds:
            where = f"{parameter} {check.value:g} {unit}, between the nodes"
            return f"UNRESOLVED at {where}: {check.proof.reason}; {help_text}"
    for node, plant, K in zip(grid.nodes, grid.plants, grid.K, strict=True):
        if np.max(np.linalg.eigvals(plant.A + plant.B2 @ K).real) >= 0.0:
            return f"UNRESOLVED at {parameter} {node:g} {unit}: the Riccati equation was not solved there"
    for i, limit in enumerate(limits):
        if limit <= 0.0:
            low, high = grid.nodes[i], grid.nodes[i + 1]
            return f"UNRESOLVED between {parameter} {low:g} and {high:g} {unit}: no P was found; {help_text}"
    return ""


def _last(grid: _Grid) -> list[FloatArray]:
    return [grid.plants[-1].A + grid.plants[-1].B2 @ grid.K[-1]]


def _notes(
    fastest: float, counts: tuple[int, int, int], parameter: str, unit: str, wanted: float | None
) -> tuple[str, ...]:
    checked, given, nodes = counts
    held = f"however fast {parameter} changes"
    if np.isfinite(fastest):
        known = float(Context(prec=4, rounding=ROUND_FLOOR).create_decimal(Decimal(fastest)))  # never more than proved
        held = f"while {parameter} changes by less than {known:g} {unit} per s"
    told = [f"proved {held}; plants are blended linearly between the nodes"]
    if nodes > given:
        told.append(f"{nodes - given} nodes were added to {given}")
    told.append(f"{checked} plants between the nodes were closed and proved" if checked else
                "no plant between the nodes was checked: the proof rests on their linear blend")  # fmt: skip
    if wanted is not None and fastest < wanted:
        told.append(f"the wanted {wanted:g} {unit} per s is not proved")
    return tuple(told)
