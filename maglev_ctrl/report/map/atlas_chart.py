"""The tongue atlas as a chart: where lines of the passing frequency meet the modes, and the speeds that are safe."""

from __future__ import annotations

from typing import Final

import numpy as np

from maglev_ctrl.analysis.tongue_atlas import TongueAtlas, TongueCrossing, Verdict
from maglev_ctrl.report.chart import Axis, Bars, Chart, Item, Line, Marks, Note, Panel
from maglev_ctrl.report.charts_periodic import short_words
from maglev_ctrl.report.labels import Anchor, Room, placed
from maglev_ctrl.report.map.words import ranges_words, span_words
from maglev_ctrl.report.style import FADED, FAIL_COLOUR, INK, UNKNOWN_COLOUR, Symbol, colour, number
from maglev_ctrl.study.map.records import OptionMap

_SIZE: Final = (4.3, 3.3)  # in, of the Campbell diagram
_ROOM_ABOVE: Final = 1.12  # of the highest thing that matters
_LEAST_HATCHED: Final = 0.03  # of the speeds
_LEAST_BAND: Final = 0.008  # of the speeds: a narrower no-go band is drawn this wide, for it must be seen
_MOST_NAMES: Final = 14
_GO_COLOUR: Final = "#8fd3bf"  # the green of what passes, paler: most of a good atlas is go
_TURN: Final = 2.0 * np.pi


def atlas_chart(option: OptionMap, atlas: TongueAtlas, speed: tuple[float, str]) -> Chart:
    """Campbell diagram with its crossings, and the bands of speeds below.

    Parameters
    ----------
    speed : display over SI and the unit
    """
    scale, unit = speed
    limits = (float(atlas.speed[0]) * scale, float(atlas.speed[-1]) * scale)
    unstable, _, unknown = _kinds(atlas)
    top = _ROOM_ABOVE * max(
        [float(np.nanmax(atlas.frequencies)) if np.isfinite(atlas.frequencies).any() else 1.0]
        + [_level(atlas, one) for one in (*unstable, *unknown)]
    ) / _TURN  # fmt: skip
    limits_y = (0.0, top)
    curves = [*_sums(atlas, scale, limits_y), *_modes(atlas, scale)]
    passing = _passing(atlas, scale, limits, limits_y)
    told = [Anchor(one.x, one.y, one.text) for one in passing if isinstance(one, Note)]
    curves += passing
    marks, left_out = _crossings(atlas, speed, limits, limits_y, told)
    panel = Panel(
        (*curves, *marks), Axis(f"speed ({unit})", limits=limits), Axis("frequency (Hz)", limits=limits_y)
    )  # fmt: skip
    hidden = f" {left_out} crossing(s) are marked without a name." if left_out else ""
    return Chart(
        key=f"{option.name}-atlas",
        caption=f"Tongue atlas of {option.label}: natural frequencies, their sums and differences that are met, and "
        "the lines of k times the passing frequency. Filled where lines meet: the pair of modes grows there; hollow: "
        f"it decays; a cross: the methods do not decide.{hidden} Below: speeds that are stable (go), unstable (no "
        "go, orange) and UNRESOLVED (grey), both hatched where wide, decided by both engines and not by the lines; "
        f"bands narrower than {100 * _LEAST_BAND:g} % of the range are drawn that wide.",
        alt=atlas_alt(option, atlas, speed), panels=(panel, bands_panel(atlas, speed, limits)),
        row_heights=(_SIZE[1], 0.18), share_x=True, legend="right",
    )  # fmt: skip


def atlas_alt(option: OptionMap, atlas: TongueAtlas, speed: tuple[float, str]) -> str:
    """The atlas in words."""
    told = "; ".join(
        f"{words}: {ranges_words(atlas, speed, verdict)}"
        for verdict, words in (("go", "go"), ("no-go", "no go"), ("unresolved", "UNRESOLVED"))
    )
    return f"Tongue atlas of {option.label} over speed. {told}."


def bands_panel(atlas: TongueAtlas, speed: tuple[float, str], limits: tuple[float, float]) -> Panel:
    """Bands of the speeds: narrow ones widened until they show, the bad ones drawn over the good."""
    least = _LEAST_BAND * (limits[1] - limits[0])
    looks: tuple[tuple[Verdict, str, bool, str], ...] = (
        ("go", _GO_COLOUR, False, "go"), ("unresolved", UNKNOWN_COLOUR, True, "UNRESOLVED"),
        ("no-go", FAIL_COLOUR, True, "no go"),
    )  # fmt: skip
    items: list[Item] = []
    for verdict, tint, hatched, label in looks:
        found = atlas.of(verdict)
        low = np.array([one.lower * speed[0] for one in found])
        length = np.array([one.upper * speed[0] for one in found]) - low
        short = np.maximum(0.0, least - length) / 2 if verdict != "go" else np.zeros(len(found))
        hover = tuple(
            "\n".join(part for part in (f"{label}: {span_words(one, speed[0])} {speed[1]}", *one.tongues) if part)
            for one in found
        )
        wide = (length > _LEAST_HATCHED * (limits[1] - limits[0])) & hatched  # in a narrow bar a hatch hides the colour
        for which, style in ((~wide, False), (wide, True)):
            if which.any():
                told = tuple(text for text, kept in zip(hover, which, strict=True) if kept)
                bars = (low - short)[which], (length + 2.0 * short)[which]
                items.append(Bars(np.full(len(told), 0.5), *bars, 1.0, label, tint, style, told))
    return Panel(tuple(items), Axis(f"speed ({speed[1]})", limits=limits), Axis("", limits=(0.0, 1.0), hidden=True))


def _kinds(
    atlas: TongueAtlas,
) -> tuple[list[TongueCrossing], list[TongueCrossing], list[TongueCrossing]]:
    """Crossings that grow, that decay, and that are not decided."""
    found = atlas.crossings
    return (
        [one for one in found if one.growth > 0.0], [one for one in found if one.growth <= 0.0],
        [one for one in found if np.isnan(one.growth)],
    )  # fmt: skip


def _level(atlas: TongueAtlas, one: TongueCrossing) -> float:
    """Frequency (rad/s) where a line meets its curve: k times the passing frequency there."""
    return one.resonance.order * float(np.interp(one.speed, atlas.speed, atlas.passing))


def _modes(atlas: TongueAtlas, scale: float) -> list[Item]:
    return [
        Line(atlas.speed * scale, values / _TURN, mode_words(atlas, k + 1), colour(1 + k), "solid", 1.6)
        for k, values in enumerate(atlas.frequencies.T)
    ]


def mode_words(atlas: TongueAtlas, mode: int) -> str:
    """A mode's number with its label, where the crossings know one: "w1 (car heave)"."""
    for one in atlas.crossings:
        for known, label in zip(one.resonance.modes, one.resonance.labels, strict=False):
            if known == mode and label:
                return f"w{mode} ({label})"
    return f"w{mode}"


def _sums(atlas: TongueAtlas, scale: float, limits: tuple[float, float]) -> list[Item]:
    """Twice a frequency, sums and differences, as far as a line meets them inside the figure."""
    items: list[Item] = []
    seen: set[tuple[str, tuple[int, ...]]] = set()
    for one in atlas.crossings:
        key = (one.resonance.kind, one.resonance.modes)
        if key in seen or max(one.resonance.modes, default=0) > atlas.frequencies.shape[1] or len(key[1]) != 2:
            continue
        seen.add(key)
        first, second = (atlas.frequencies[:, m - 1] for m in one.resonance.modes)
        values = (second - first if one.resonance.kind == "difference" else first + second) / _TURN
        if np.nanmin(values) < limits[1]:
            label = "sums and differences" if not items else ""
            items.append(Line(atlas.speed * scale, values, "sums and differences" if label else "", FADED, "dash", 0.7))
    return items


def _passing(
    atlas: TongueAtlas, scale: float, limits: tuple[float, float], limits_y: tuple[float, float]
) -> list[Item]:
    """Lines of k times the passing frequency, each with its k where it leaves the figure."""
    items: list[Item] = []
    known = np.isfinite(atlas.passing)
    if not known.any():
        return items
    for order in range(1, max((one.resonance.order for one in atlas.crossings), default=1) + 1):
        x, y = atlas.speed[known] * scale, order * atlas.passing[known] / _TURN
        items.append(Line(x, y, "k v/L, passing frequency" if order == 1 else "", INK, "dot", 1.0))
        at = float(np.interp(0.97 * limits_y[1], y, x)) if y[-1] > 0.97 * limits_y[1] else limits[1]
        level = min(float(np.interp(at, x, y)), 0.97 * limits_y[1])
        if y[0] < 0.9 * limits_y[1]:
            room = 0.03 * (limits[1] - limits[0])
            items.append(Note(max(at - 1.6 * room, limits[0] + room), level, f"k = {order}", "center", "top", INK))
    return items


def _crossings(
    atlas: TongueAtlas,
    speed: tuple[float, str],
    limits: tuple[float, float],
    limits_y: tuple[float, float],
    told: list[Anchor],
) -> tuple[list[Item], int]:
    """Marks of the crossings with the names of those that matter, and how many of these found no place."""
    unstable, damped, unknown = _kinds(atlas)
    items: list[Item] = []
    for one in unstable:
        if np.isfinite(one.half_width) and one.half_width > 0.0:
            ends = np.array([one.speed - one.half_width, one.speed + one.half_width]) * speed[0]
            items.append(
                Line(ends, np.full(2, _level(atlas, one) / _TURN), "first-order width", FAIL_COLOUR, width=2.4)
            )
    looks: tuple[tuple[list[TongueCrossing], Symbol, str, str], ...] = (
        (damped, "open_circle", "crossing, damped", INK), (unknown, "cross", "crossing, UNRESOLVED", UNKNOWN_COLOUR),
        (unstable, "circle", "crossing, unstable", FAIL_COLOUR),
    )  # fmt: skip
    for kind, symbol, words, tint in looks:
        if kind:
            x = np.array([one.speed * speed[0] for one in kind])
            y = np.array([_level(atlas, one) / _TURN for one in kind])
            hover = tuple(
                f"{one.resonance.name}\n{number(one.speed * speed[0], speed[1], digits=4)}\ngrowth "
                f"{number(one.growth, '1/s')}"
                for one in kind
            )
            items.append(Marks(x, y, symbol, words, tint, 3.5 if symbol == "open_circle" else 4.5, hover))
    named = sorted((*unstable, *unknown), key=lambda one: -(one.growth if one.growth > 0.0 else np.inf))
    anchors = [
        Anchor(one.speed * speed[0], _level(atlas, one) / _TURN, short_words(one.resonance.name))
        for one in named
        if _level(atlas, one) / _TURN < limits_y[1]
    ]
    busy = np.zeros((60, 90), dtype=bool)
    for one in atlas.crossings:
        column = int((one.speed * speed[0] - limits[0]) / (limits[1] - limits[0]) * 89)
        row = int(_level(atlas, one) / _TURN / limits_y[1] * 59)
        if 0 <= row < 60 and 0 <= column < 90:
            busy[max(0, row - 1) : row + 2, max(0, column - 1) : column + 2] = True
    notes, left_out = placed(anchors[:_MOST_NAMES], Room(limits, limits_y, _SIZE, busy), taken=told)
    return [*items, *notes], left_out + max(0, len(anchors) - _MOST_NAMES)
