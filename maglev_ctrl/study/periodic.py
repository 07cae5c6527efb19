"""Periodic forcing of one option: multipliers at the design point, the resonance map, the depth it survives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from maglev_ctrl.analysis.floquet import Floquet, floquet
from maglev_ctrl.analysis.resonance_map import CriticalDepth, ResonanceMap, critical_depth, resonance_map
from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.errors import ModelError, OutOfDomain
from maglev_ctrl.scenario.requirement_schema import FLOQUET_MARGINS
from maglev_ctrl.scenario.scenario_schema import Periodic
from maglev_ctrl.study.floquet_margins import NOT_ASKED, option_margins
from maglev_ctrl.study.forcing import Forcing
from maglev_ctrl.study.modulation import modulation_of
from maglev_ctrl.study.records import FloquetStudy
from maglev_ctrl.study.situation import OptionModel
from maglev_ctrl.systems import Controller, PeriodicSystem, at_depth

BRACKET = 1e-3  # the deciding depth is checked this far (relative) on either side
UNRESOLVED = "UNRESOLVED: the two engines disagree"
COARSE_STEPS, FINE_STEPS = 6, 12  # of the search for the bottom of a valley
VALLEYS = 4  # this many of the lowest valleys of the critical depth are followed to their bottom
PROBES = 2  # where a map shows no instability, this many of its least stable speeds are checked on the full model


def floquet_study(model: OptionModel, controller: Controller | None) -> FloquetStudy:
    """Floquet analysis of one option over the scenario's map.

    Raises
    ------
    ModelError : the scenario has no periodic forcing, or no speed of the map has an equilibrium
    """
    periodic = model.scenario.periodic
    if periodic is None:
        raise ModelError("the scenario describes no periodic forcing")
    forcing = Forcing.of(model, controller, periodic)
    bare = Forcing.of(OptionModel(model.scenario, None), None, periodic)
    speeds, systems = _over_speed(forcing)
    modulation = modulation_of(model.scenario)
    depths = _depths(periodic, modulation.depth)
    atlas = resonance_map(
        np.stack([s.A_0 for s in systems]), np.stack([s.A_cos for s in systems]),
        np.stack([s.A_sin for s in systems]), np.array([float(s.frequency) for s in systems]), depths,
        parameter=speeds, parameter_name="speed", states=systems[0].states,
    )  # fmt: skip
    if forcing.merged:
        note = "; delay and bandwidth of each actuator merged into one lag, the deciding depth on the full model"
        atlas = replace(atlas, method=atlas.method + note)
    curve = critical_depths(atlas)
    worst = _worst(forcing, atlas, curve)
    design_speed = model.scenario.operating.speed
    go, no_go = speed_ranges(atlas, curve, modulation.depth)
    asked = any(requirement.quantity in FLOQUET_MARGINS for requirement in model.scenario.judged)
    margins, reason = option_margins(model, controller, periodic) if asked else (None, NOT_ASKED)
    return FloquetStudy(
        wavelength=modulation.wavelength,
        expected_depth=modulation.depth,
        at_design=floquet(at_depth(forcing.at(design_speed), modulation.depth)),
        open_loop=_floquet_or_none(bare, design_speed, modulation.depth),
        map=atlas,
        critical_depth=read_only_any(curve),
        largest_depth=float(depths[-1]),
        worst_depth=worst[0],
        worst_speed=worst[1],
        worst_resonance=worst[2],
        go_ranges=go,
        no_go_ranges=no_go,
        margins=margins,
        margins_reason=reason,
    )


def critical_depths(atlas: ResonanceMap) -> FloatArray:
    """Smallest unstable depth of each column of a map, interpolated between grid depths; inf where there is none."""
    found = np.full(len(atlas.parameter), np.inf)
    for column in range(len(found)):
        unstable = np.flatnonzero(atlas.unstable[column])
        if not unstable.size:
            continue
        first = int(unstable[0])
        if first == 0:
            found[column] = atlas.depths[0]
            continue
        below, above = atlas.growth_rate[column, first - 1], atlas.growth_rate[column, first]
        share = 1.0 if above <= below else float(np.clip(-below / (above - below), 0.0, 1.0))
        found[column] = atlas.depths[first - 1] + share * (atlas.depths[first] - atlas.depths[first - 1])
    return found


def speed_ranges(
    atlas: ResonanceMap, curve: FloatArray, depth: float
) -> tuple[tuple[tuple[float, float], ...], tuple[tuple[float, float, str], ...]]:
    """Speed ranges that are stable at a depth, and those that are not with their resonance.

    An unstable column closes the whole interval to its stable neighbours; tongues found between columns close the
    interval they lie in.
    """
    speeds = atlas.parameter
    unresolved = np.any(atlas.unresolved, axis=1)
    blocked = (curve <= depth) | unresolved
    names = [_name_at(atlas, k) if blocked[k] else "" for k in range(len(speeds))]
    names = [UNRESOLVED if doubt else name for doubt, name in zip(unresolved, names, strict=True)]
    for seed in atlas.seeded:
        # A tongue that the grid shows at greater depth may still be between its columns at this one.
        if seed.threshold <= depth:
            k = int(np.argmin(np.abs(speeds - seed.parameter)))
            if not blocked[k]:
                blocked[k], names[k] = True, seed.name
    go: list[tuple[float, float]] = []
    no_go: list[tuple[float, float, str]] = []
    start = 0
    for k in range(1, len(speeds) + 1):
        if k < len(speeds) and blocked[k] == blocked[start] and names[k] == names[start]:
            continue
        if blocked[start]:
            low = speeds[max(start - 1, 0)] if start and not blocked[start - 1] else speeds[start]
            high = speeds[min(k, len(speeds) - 1)]
            no_go.append((float(low), float(high), names[start]))
        elif k - 1 > start:
            go.append((float(speeds[start]), float(speeds[k - 1])))
        start = k
    return tuple(go), tuple(no_go)


def _over_speed(forcing: Forcing) -> tuple[FloatArray, list[PeriodicSystem]]:
    """The periodic system at every speed of the map that has an equilibrium."""
    grid = forcing.periodic.map.speed
    speeds: list[float] = []
    systems: list[PeriodicSystem] = []
    reason = ""
    for speed in np.linspace(grid.first, grid.last, grid.count):
        try:
            systems.append(forcing.at(float(speed), full=False))
        except (ModelError, OutOfDomain) as fault:
            reason = str(fault)
            continue
        speeds.append(float(speed))
    if len(systems) < 2:
        raise ModelError(f"resonance map: no speed of the map has an equilibrium: {reason}")
    return np.array(speeds), systems


def _worst(forcing: Forcing, atlas: ResonanceMap, curve: FloatArray) -> tuple[float, float, str]:
    """Smallest critical depth, its speed and its resonance; NaN where the two engines do not confirm it.

    The lowest valleys of the critical depth over speed, and the tongues found between columns, are followed to their
    bottom between the columns; the deepest of them is decided on the full model.
    """
    largest = float(atlas.depths[-1])
    if np.any(atlas.unstable[:, 0]):
        column = int(np.argmax(atlas.growth_rate[:, 0]))
        speed = float(atlas.parameter[column])
        grows = np.max(np.linalg.eigvals(forcing.at(speed).A_0).real) > 0.0
        return (0.0 if grows else float("nan")), speed, "unstable without modulation"
    valleys = _valleys(atlas, curve)
    bottoms = [_bottom(forcing, valley, largest) for valley in valleys]
    found = [bottom for bottom in bottoms if np.isfinite(bottom[0])]
    if not found and valleys:
        # Something was seen and its bottom was not found: that is not calm.
        return float("nan"), valleys[0][1], ""
    if not found:
        calm = not np.any(atlas.unresolved) and _calm(forcing, atlas)
        return (float("inf") if calm else float("nan")), float(atlas.parameter[0]), ""
    _, speed = min(found)
    decided = critical_depth(forcing.at(speed), depth_max=largest)
    name = decided.resonance.name if np.isfinite(decided.depth) else ""
    return (decided.depth if _confirmed(forcing, speed, decided) else float("nan")), speed, name


def _valleys(atlas: ResonanceMap, curve: FloatArray) -> list[tuple[float, float, float]]:
    """Speeds (low, at, high) around the lowest local minima of the critical depth and the lowest seeded tongues."""
    speeds, last = atlas.parameter, len(atlas.parameter) - 1
    places = [
        (float(curve[k]), float(speeds[max(k - 1, 0)]), float(speeds[k]), float(speeds[min(k + 1, last)]))
        for k in range(last + 1)
        if np.isfinite(curve[k]) and curve[k] <= curve[max(k - 1, 0)] and curve[k] <= curve[min(k + 1, last)]
    ]
    step = float(np.max(np.diff(speeds)))
    for seed in atlas.seeded:
        if seed.threshold <= atlas.depths[-1] and speeds[0] <= seed.parameter <= speeds[last]:
            low, high = np.clip([seed.parameter - 0.5 * step, seed.parameter + 0.5 * step], speeds[0], speeds[last])
            places.append((seed.threshold, float(low), float(seed.parameter), float(high)))
    return [(low, at, high) for _, low, at, high in sorted(places)[:VALLEYS]]


def _bottom(forcing: Forcing, valley: tuple[float, float, float], largest: float) -> tuple[float, float]:
    """Smallest critical depth of the map's model in a valley, and its speed."""
    low, at, high = valley
    seen: dict[float, float] = {}

    def depth(speed: float) -> float:
        # Where nothing is unstable the depth counts as twice the largest: a plateau the search can leave.
        if speed not in seen:
            seen[speed] = critical_depth(forcing.at(speed, full=False), depth_max=largest).depth
        return min(seen[speed], 2.0 * largest)

    def search(left: float, right: float, steps: int) -> None:
        if right - left > 1e-9 * right:
            minimize_scalar(
                lambda v: depth(float(v)), bounds=(left, right), method="bounded",
                options={"xatol": 1e-3 * (right - left), "maxiter": steps},
            )  # fmt: skip

    # One search on either side of what is known, because a tongue may be narrower than the valley; then between the
    # neighbours of the lowest point met.
    depth(at)
    search(low, at, COARSE_STEPS)
    search(at, high, COARSE_STEPS)
    met = sorted(seen)
    lowest = min(range(len(met)), key=lambda k: seen[met[k]])
    search(met[max(lowest - 1, 0)], met[min(lowest + 1, len(met) - 1)], FINE_STEPS)
    speed = min(seen, key=lambda v: seen[v])
    return seen[speed], speed


def _calm(forcing: Forcing, atlas: ResonanceMap) -> bool:
    """Whether both engines find the full model stable at the largest depth, at the map's least stable speeds."""
    least_stable = np.argsort(atlas.growth_rate[:, -1])[::-1][:PROBES]
    largest = float(atlas.depths[-1])
    found = (floquet(at_depth(forcing.at(float(atlas.parameter[k])), largest)) for k in least_stable)
    return all(one.stable is True for one in found)


def _depths(periodic: Periodic, expected: float) -> FloatArray:
    """The map's depths, with none and with the expected one: what is said of them has to have been computed."""
    grid = periodic.map.depth
    levels = np.linspace(grid.first, grid.last, grid.count)
    extra = [0.0] if grid.first > 0.0 else []
    extra += [expected] if expected > grid.last else []
    return np.asarray(np.unique(np.concatenate([levels, extra])))


def _confirmed(forcing: Forcing, speed: float, decided: CriticalDepth) -> bool:
    """Whether both engines agree that stability is lost at the depth: stable just below, unstable just above."""
    if not np.isfinite(decided.depth):
        return True
    system = forcing.at(speed)
    below = floquet(at_depth(system, decided.depth * (1.0 - BRACKET)))
    above = floquet(at_depth(system, decided.depth * (1.0 + BRACKET)))
    return below.stable is True and above.stable is False


def _floquet_or_none(forcing: Forcing, speed: float, depth: float) -> Floquet | None:
    try:
        return floquet(at_depth(forcing.at(speed), depth))
    except (ModelError, OutOfDomain):
        return None


def _name_at(atlas: ResonanceMap, column: int) -> str:
    if atlas.unstable[column, 0] and atlas.depths[0] == 0.0:
        return "unstable without modulation"
    index = atlas.tongue_index[column]
    named = index[index >= 0]
    return atlas.tongues[int(named[0])].name if named.size else "unnamed"
