"""Figures of a sweep: lines over one quantity, maps over two, shares and distributions of everything else."""

from __future__ import annotations

from typing import Final

import numpy as np

from maglev_ctrl.report.chart import Axis, Chart, Item, Line, Marks, Panel, Rule
from maglev_ctrl.report.map.chart import grid_colours
from maglev_ctrl.report.map.picture import MOST_COLUMNS, MOST_ROWS, Picture
from maglev_ctrl.report.raster import outer_edges
from maglev_ctrl.report.style import FAIL_COLOUR, ON_MAP, colour, dash, number
from maglev_ctrl.report.sweep.digest import SweepDigest, share_words
from maglev_ctrl.study.sweep.records import NO_ANSWER, UNRESOLVED
from maglev_ctrl.study.sweep.request import SweepRange

_PAIR: Final = 2
_MAP_HEIGHT: Final = 2.6  # in


def charts(digest: SweepDigest) -> tuple[Chart, ...]:
    """Every figure the sweep has something to draw for."""
    request = digest.study.request
    if digest.growth.size and len(request.ranges) == 1:
        return (lines_chart(digest),)
    if digest.growth.size and len(request.ranges) == _PAIR and min(request.shape) > 1:
        fits = request.shape[0] <= MOST_COLUMNS and request.shape[1] <= MOST_ROWS
        return (maps_chart(digest),) if fits else (shares_chart(digest), growth_chart(digest))
    return shares_chart(digest), growth_chart(digest)


def under(digest: SweepDigest) -> str:
    """Under which forces the growth rates are."""
    return "under the periodic forces" if digest.modulated else "without modulation"


def axis_words(one: SweepRange) -> str:
    """Label of a quantity's axis."""
    unit, _ = one.shown()
    return f"{one.quantity.label} ({unit})" if unit else one.quantity.label


def lines_chart(digest: SweepDigest) -> Chart:
    """Growth rate of every option over the one quantity."""
    one = digest.study.request.ranges[0]
    x = one.steps() * one.shown()[1]
    items: list[Item] = [Rule("y", 0.0, dash="solid", width=0.7)]
    for j, option in enumerate(digest.study.options):
        items.append(Line(x, digest.growth[j], option.label, colour(j), dash(j)))
        undecided = digest.state[j] == UNRESOLVED
        if undecided.any():
            items.append(Marks(x[undecided], digest.growth[j][undecided], "cross", f"{option.label}: UNRESOLVED",
                               colour(j)))  # fmt: skip
    items += _design(one)
    return Chart(
        key="growth",
        caption=f"Largest growth rate {under(digest)} over {one.quantity.label}; above zero the vehicle is unstable. "
        "A line has gaps where there is no answer.",
        alt=f"Growth rate over {one.quantity.label}. {_shares(digest)}.",
        panels=(Panel(tuple(items), Axis(axis_words(one)), Axis("growth rate (1/s)")),), panel_height=2.8,
        legend="bottom",
    )  # fmt: skip


def maps_chart(digest: SweepDigest) -> Chart:
    """A map of every option over the two quantities, all with the same colours."""
    x, y = digest.study.request.ranges
    shown = [_picture(digest, j) for j in range(len(digest.study.options))]
    limits = _limits(digest)
    panels = [
        Panel(
            (*grid_colours(one, limits, scales=(j + 1) % _PAIR == 0 or j + 1 == len(shown)), *_cross(x, y)),
            Axis(axis_words(x), limits=outer_edges(one.x)), Axis(axis_words(y), limits=outer_edges(one.y)),
            title=option.label,
        )
        for j, (one, option) in enumerate(zip(shown, digest.study.options, strict=True))
    ]  # fmt: skip
    signs = "Strong colours are unstable: the growth rate. Faint blue is stable: the decay rate."
    if np.any(digest.state == UNRESOLVED):
        signs += " Hatched is UNRESOLVED: the methods do not decide, it does not count as stable."
    if np.any(digest.state == NO_ANSWER):
        signs += " Grey has no answer; the table of remarks says why."
    return Chart(
        key="maps",
        caption=f"Growth rate {under(digest)} over {x.quantity.label} and {y.quantity.label}. {signs}",
        alt=f"Stability over {x.quantity.label} and {y.quantity.label}. {_shares(digest)}.",
        panels=tuple(panels), columns=min(_PAIR, len(panels)), panel_height=_MAP_HEIGHT, legend="bottom",
    )  # fmt: skip


def shares_chart(digest: SweepDigest) -> Chart:
    """Share of stable points over each quantity, whatever the others are."""
    panels = []
    for k, one in enumerate(digest.study.request.ranges):
        x = digest.middles(k) * one.shown()[1]
        items: list[Item] = []
        for j, option in enumerate(digest.study.options):
            points, stable = digest.counts[k, j, :, 0], digest.counts[k, j, :, 1]
            share = np.divide(100.0 * stable, points, out=np.full(len(points), np.nan), where=points > 0.0)
            there = np.isfinite(share)
            items.append(Line(x[there], share[there], option.label if k == 0 else "", colour(j), dash(j)))
        panels.append(Panel((*items, *_design(one)), Axis(axis_words(one)), Axis("stable (%)", limits=(-4.0, 104.0))))
    return Chart(
        key="shares",
        caption=f"Share of points that are stable {under(digest)} over each quantity, all the others as they come in "
        "the sweep. UNRESOLVED points and points without an answer do not count as stable.",
        alt=f"Share of stable points over each quantity. {_shares(digest)}.",
        panels=tuple(panels), columns=min(_PAIR, len(panels)), panel_height=1.7, legend="bottom",
    )  # fmt: skip


def growth_chart(digest: SweepDigest) -> Chart:
    """How the growth rates of every option are distributed."""
    items: list[Item] = [Rule("x", 0.0, "stable left of here", FAIL_COLOUR, "dash")]
    for j, option in enumerate(digest.study.options):
        values = digest.growth_sample(j)
        if len(values):
            share = 100.0 * (np.arange(len(values)) + 1.0) / len(values)
            items.append(Line(values, share, option.label, colour(j), dash(j)))
    return Chart(
        key="growth-distribution",
        caption=f"Share of points whose growth rate {under(digest)} is below a value; where a line crosses the dashed "
        "one is the share that decays.",
        alt="Distribution of the growth rates of every option.",
        panels=(Panel(tuple(items), Axis("growth rate (1/s)"), Axis("points below (%)", limits=(-2.0, 102.0))),),
        panel_height=2.4, legend="bottom",
    )  # fmt: skip


def _picture(digest: SweepDigest, option: int) -> Picture:
    """An option's grid as a picture: a cell for every point."""
    x, y = digest.study.request.ranges
    shape = digest.study.request.shape
    state = digest.state[option].reshape(shape).T.astype(np.int8)
    return Picture(
        x=x.steps() * x.shown()[1], y=y.steps() * y.shown()[1], state=state,
        growth=digest.growth[option].reshape(shape).T, tongue=np.full(state.shape, -1, dtype=np.int16), gathered=False,
    )  # fmt: skip


def _limits(digest: SweepDigest) -> tuple[float, float]:
    """Largest growth and decay with a colour of their own, for all options alike."""
    growth = digest.growth[np.isfinite(digest.growth)]
    fast, slow = growth[growth > 0.0], -growth[growth <= 0.0]
    return (
        float(np.percentile(fast, 98.0)) if fast.size else 0.0,
        float(np.percentile(slow, 95.0)) if slow.size else 0.0,
    )  # fmt: skip


def _design(one: SweepRange) -> list[Item]:
    """A line at the scenario's own value."""
    value, (low, high) = one.quantity.value, one.ends
    if not low <= value <= high:
        return []
    unit, scale = one.shown()
    return [Rule("x", value * scale, f"own value {number(value * scale, unit)}")]


def _cross(x: SweepRange, y: SweepRange) -> list[Item]:
    """The point of the scenario's own values."""
    inside = all(low <= q.quantity.value <= high for q in (x, y) for low, high in (q.ends,))
    if not inside:
        return []
    at = [np.array([q.quantity.value * q.shown()[1]]) for q in (x, y)]
    return [Marks(at[0], at[1], "diamond", "the scenario's own values", ON_MAP, 5.0)]


def _shares(digest: SweepDigest) -> str:
    """How the points of every option came out, in words."""
    points = digest.study.request.points
    return "; ".join(f"{option.label}: {share_words(option, points)}" for option in digest.study.options)
