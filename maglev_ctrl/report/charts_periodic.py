"""The resonance map: where periodic forcing makes an option unstable, over speed and depth of modulation."""

from __future__ import annotations

import numpy as np

from maglev_ctrl.analysis.resonance_map import ResonanceMap, SeededTongue
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.report.chart import Axis, Chart, Heat, Item, Line, Marks, Note, Panel, Rule, Span
from maglev_ctrl.report.labels import Anchor, Room, placed
from maglev_ctrl.report.raster import even_cells, worst_members
from maglev_ctrl.report.style import FAIL_COLOUR, INK, PASS_COLOUR, Dash, Symbol, number
from maglev_ctrl.study.records import FloquetStudy, OptionStudy

_MOST_NAMES = 5
_MOST_CELLS = 480
MAP_SIZE = (5.2, 2.8)  # in
_KILOMETRES_PER_HOUR = 3.6


def resonance_chart(option: OptionStudy, *, design_speed: float) -> Chart | None:
    """Growth rate of the unstable tongues over speed and depth, tongues named; None without a map."""
    study = option.floquet
    if study is None:
        return None
    x = study.map.parameter * _KILOMETRES_PER_HOUR
    depth = 100.0 * study.map.depths
    items = growth_items(study.map, x, depth)
    curve = critical_curve(
        x, study.critical_depth, "critical depth", ("critical depth at a single speed", "circle"), INK, "solid"
    )
    items += curve
    items += unresolved_items(study.map, x, depth)
    items.append(Rule("y", 100.0 * study.expected_depth, "expected depth", FAIL_COLOUR, "dash", 1.2))
    items.append(Rule("x", design_speed * _KILOMETRES_PER_HOUR, "design speed", INK, "dot", 1.0))
    items += tip_items(study.map)
    items += name_items(study.map, x, depth)
    tips = any(np.isfinite(seed.threshold) for seed in study.map.seeded)
    drawn = _drawn_words(curve, tips=tips)
    limits_x = (float(x[0]), float(x[-1]))
    upper = Panel(
        tuple(items), Axis("speed (km/h)", limits=limits_x),
        Axis("modulation depth (% of stiffness)", limits=(0.0, float(depth[-1]))),
    )  # fmt: skip
    return Chart(
        key=f"{option.name}-resonance",
        caption=f"Resonance map of {option.label} under stiffness modulation with wavelength "
        f"{number(study.wavelength, 'm')}: colour is the growth rate of unstable tongues, blank is stable{drawn}. "
        "Below: speeds that are stable (go) and unstable (no go, hatched) "
        f"at the expected depth of {number(100 * study.expected_depth, '%')}. Map method: {study.map.method}.",
        alt=resonance_words(option.label, study),
        panels=(upper, _bands(study, limits_x)),
        row_heights=(MAP_SIZE[1], 0.16),
        share_x=True,
        legend="bottom",
    )


def critical_curve(
    x: FloatArray, depth: FloatArray, label: str, single: tuple[str, Symbol], tint: str, style: Dash
) -> tuple[Line | Marks, ...]:
    """The critical depth (V,) over speed in per cent: a line where neighbours share it, marks for columns alone.

    Only what has something to show is returned, so that a legend never names what is not drawn.
    """
    known = np.isfinite(depth)
    beside = np.concatenate([[False], known[:-1]]) | np.concatenate([known[1:], [False]])
    percent = 100.0 * np.where(known, depth, np.nan)
    items: list[Line | Marks] = []
    if np.any(known & beside):
        items.append(Line(x, np.where(beside, percent, np.nan), label, tint, style, 1.0 if tint == INK else 1.4))
    alone = known & ~beside
    if np.any(alone):
        words = tuple(f"{label}: {number(float(d), '%')}" for d in percent[alone])
        items.append(Marks(x[alone], percent[alone], single[1], single[0], tint, 3.5, words))
    return tuple(items)


def _drawn_words(curve: tuple[Line | Marks, ...], *, tips: bool) -> str:
    """What the figure's line and marks stand for, of those that are drawn."""
    words = ""
    if any(isinstance(item, Line) for item in curve):
        words += ", the line is the smallest unstable depth at each speed"
    if any(isinstance(item, Marks) for item in curve):
        words += ", a circle the smallest unstable depth of a single speed between stable ones"
    return words + (", a triangle the tip of a tongue found between the map's speeds" if tips else "")


def tips_below_curve(study: FloquetStudy) -> list[SeededTongue]:
    """Tips between the map's speeds that begin lower than both neighbouring columns show."""
    speeds = study.map.parameter
    found = []
    for seed in study.map.seeded:
        place = int(np.clip(np.searchsorted(speeds, seed.parameter), 1, len(speeds) - 1))
        shown = float(np.min(study.critical_depth[place - 1 : place + 1]))
        if np.isfinite(seed.threshold) and seed.threshold < shown:
            found.append(seed)
    return found


def growth_items(found: ResonanceMap, x: FloatArray, depth: FloatArray) -> list[Item]:
    """Growth rate where a map is unstable, or that it is not; `x` and `depth` as shown."""
    growth = np.where(found.unstable, found.growth_rate, np.nan)
    known = growth[np.isfinite(growth)]
    if known.size:
        return [_heat(x, depth, growth, float(np.max(known)))]
    middle = (0.5 * float(x[0] + x[-1]), 0.5 * float(depth[-1]))
    return [Note(*middle, "stable everywhere on this map", "center", "center", INK)]


def _heat(x: FloatArray, depth: FloatArray, growth: FloatArray, high: float) -> Heat:
    """The map on a regular grid, each cell the point of most growth it stands for, as images need one."""
    (x_even, columns), (y_even, rows) = even_cells(x, most=_MOST_CELLS), even_cells(depth, most=_MOST_CELLS)
    worst = worst_members(np.where(np.isnan(growth), -np.inf, growth), columns, rows)
    return Heat(x_even, y_even, growth.ravel()[worst], "growth rate (1/s)", 0.0, high)


def unresolved_items(found: ResonanceMap, x: FloatArray, depth: FloatArray) -> list[Item]:
    """Question marks where the two engines do not agree."""
    where = np.argwhere(found.unresolved)
    if not where.size:
        return []
    return [Note(float(x[i]), float(depth[j]), "?", "center") for i, j in where[:: max(1, len(where) // 40)]]


def tip_items(found: ResonanceMap) -> list[Item]:
    """Tips of tongues between the grid's speeds, found where resonance says they are."""
    hidden = [s for s in found.seeded if np.isfinite(s.threshold)]
    if not hidden:
        return []
    x = np.array([s.parameter * _KILOMETRES_PER_HOUR for s in hidden])
    y = np.array([100.0 * s.threshold for s in hidden])
    words = tuple(f"{tongue_words(s.name)}: from {number(100 * s.threshold, '%')}" for s in hidden)
    return [Marks(x, y, "triangle", "tip of a tongue between grid speeds", INK, 4.0, words)]


def name_items(found: ResonanceMap, x: FloatArray, depth: FloatArray) -> list[Item]:
    """Names of the tongues that reach lowest, each beside its own tip, kept clear of one another and of the map."""
    anchors = [Anchor(at, low, short_words(name)) for low, at, name in _grid_tips(found, x, depth)[:_MOST_NAMES]]
    limits = (float(x[0]), float(x[-1])), (0.0, float(depth[-1]))
    return placed(anchors, Room(*limits, MAP_SIZE, found.unstable.T))[0]


def _grid_tips(found: ResonanceMap, x: FloatArray, depth: FloatArray) -> list[tuple[float, float, str]]:
    """Lowest unstable depth, its speed and the full name of every tongue the grid shows, lowest first."""
    tips: list[tuple[float, float, str]] = []
    for index, tongue in enumerate(found.tongues):
        inside = (found.tongue_index == index) & found.unstable
        if not inside.any():
            continue
        columns = np.flatnonzero(inside.any(axis=1))
        lowest = [float(depth[np.flatnonzero(inside[c])[0]]) for c in columns]
        best = int(np.argmin(lowest))
        tips.append((lowest[best], float(x[columns[best]]), tongue.name))
    return sorted(tips)


def tongue_tips(study: FloquetStudy) -> list[tuple[str, float, float]]:
    """Every resonance of a map once: name, smallest unstable depth (%), its speed (km/h); lowest first.

    Tips found between the grid's speeds are lower than what the grid shows, and take precedence.
    """
    x, depth = study.map.parameter * _KILOMETRES_PER_HOUR, 100.0 * study.map.depths
    found = [(low, at, name) for low, at, name in _grid_tips(study.map, x, depth)]
    found += [
        (100.0 * s.threshold, s.parameter * _KILOMETRES_PER_HOUR, s.name)
        for s in study.map.seeded
        if np.isfinite(s.threshold)
    ]
    best: dict[str, tuple[float, float]] = {}
    for low, at, name in sorted(found):
        best.setdefault(tongue_words(name), (low, at))
    return [(name, low, at) for name, (low, at) in best.items()]


def _bands(study: FloquetStudy, limits: tuple[float, float]) -> Panel:
    items: list[Item] = []
    for start, stop in study.go_ranges:
        items.append(
            Span("x", start * _KILOMETRES_PER_HOUR, stop * _KILOMETRES_PER_HOUR, PASS_COLOUR, 0.35, label="go")
        )
    for start, stop, _ in study.no_go_ranges:
        items.append(
            Span("x", start * _KILOMETRES_PER_HOUR, stop * _KILOMETRES_PER_HOUR, FAIL_COLOUR, 0.9, True, "no go")
        )
    return Panel(tuple(items), Axis("speed (km/h)", limits=limits), Axis("", limits=(0.0, 1.0), hidden=True))


def tongue_words(name: str) -> str:
    """A tongue's name, or that there is none."""
    return "no resonance: unstable by itself" if name in ("none", "") else name


def short_words(name: str) -> str:
    """A tongue's name without the modes' labels, as figures show it: "2 w1", "w1 + w2", "(w1 + w2)/2"."""
    words = tongue_words(name)
    head, order, _ = words.partition("/")
    if not order:
        return words
    k = order + words[len(head) + 1 :].split(" ")[0]
    return head.strip("()") if k == "/1" else f"{head}{k}"


def resonance_words(label: str, study: FloquetStudy) -> str:
    """The map in words."""
    if bool(np.all(study.map.unstable[:, 0])) and study.map.depths[0] == 0.0:
        return f"{label} is unstable without any modulation at every speed of the map; there is nothing to survive."
    if np.isnan(study.worst_depth):
        return (
            f"Resonance map of {label}: UNRESOLVED, the two engines do not agree where the smallest depth is decided."
        )
    worst = (
        f"the smallest unstable depth is {number(100 * study.worst_depth, '%')} at "
        f"{number(study.worst_speed * _KILOMETRES_PER_HOUR, 'km/h')} ({tongue_words(study.worst_resonance)})"
        if np.isfinite(study.worst_depth)
        else f"no depth up to {number(100 * study.largest_depth, '%')} is unstable where the option is stable unforced"
    )
    bad = ", ".join(
        f"{number(a * _KILOMETRES_PER_HOUR)} to {number(b * _KILOMETRES_PER_HOUR, 'km/h')} ({tongue_words(name)})"
        for a, b, name in study.no_go_ranges
    )
    return f"Resonance map of {label}: {worst}. Unstable at the expected depth: {bad or 'nowhere on the map'}."
