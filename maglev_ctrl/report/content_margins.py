"""Margins as a reader sees them: one loop at a time, all at once, and peaks of the sensitivity with their zones."""

from __future__ import annotations

import math

import numpy as np

from maglev_ctrl.analysis.disk import DiskMargin
from maglev_ctrl.analysis.margin_sites import sensitivity_zone
from maglev_ctrl.analysis.margins import ChannelMargins, Margins
from maglev_ctrl.report.charts_margins import disk_value, nyquist
from maglev_ctrl.report.content_margin_sites import margin_site_blocks
from maglev_ctrl.report.content_worst import worst_blocks
from maglev_ctrl.report.equations import DISK, DISK_PEAK
from maglev_ctrl.report.model import Block, Bullets, Cell, FigureBlock, Paragraph, Table, row
from maglev_ctrl.report.style import ABSENT, ALPHA, number
from maglev_ctrl.study.records import OptionStudy

_ALL = 150.0  # dB; a disk margin of 2 is all of the right half plane, to rounding


def option_margin_blocks(option: OptionStudy) -> list[Block]:
    """The margins of an option with its Nyquist curves, or why there are none."""
    margins = option.margins
    if margins is None:
        return [Paragraph(f"Margins were not evaluated: {option.margins_reason}")] if option.margins_reason else []
    blocks = [*margin_blocks(margins, option.label), *worst_blocks(margins, option.label, key=option.name)]
    chart = nyquist(option)
    blocks = [*blocks, FigureBlock(chart)] if chart is not None else blocks
    if option.margin_sites is not None:
        blocks += margin_site_blocks(option.margin_sites, option.label)
    return blocks


def margin_blocks(margins: Margins, label: str) -> list[Block]:
    """Margins of every channel, of all at once, and what no replay confirmed."""
    rows = tuple(_channel_row(channel) for channel in margins.channels)
    heads = ("Channel", "Gain down", "Gain up", "Phase", "Delay", "Modulus", f"Disk {ALPHA}", "Verified")
    caption = f"Margins of {label}, one channel at a time with the others closed"
    widths = (2.0, 1.0, 1.0, 0.9, 1.0, 0.9, 1.1, 0.9)
    blocks: list[Block] = [
        Table(caption, heads, rows, widths, (1, 2, 3, 4, 5, 6), see=(DISK, DISK_PEAK)), _peak_table(margins, label),
        Paragraph(_multi_loop_words(margins.multi_loop)),
    ]  # fmt: skip
    unresolved = _unresolved(margins)
    return [*blocks, Bullets(unresolved)] if unresolved else blocks


def _channel_row(one: ChannelMargins) -> tuple[Cell, ...]:
    return row(
        one.channel, number(one.gain_reduction.decibel, "dB"), number(one.gain_increase.decibel, "dB"),
        number(one.phase.value, "deg"), number(1e3 * one.delay.value, "ms"), number(one.modulus.value),
        number(disk_value(one.disk)), "yes" if one.verified else "no",
    )  # fmt: skip


def _peak_table(margins: Margins, label: str) -> Table:
    """Peaks of |S| and |T| with the zone of the standard."""
    rows = tuple(
        row(
            one.channel, number(peak), number(20.0 * math.log10(peak), "dB"),
            number(one.modulus.frequency / (2.0 * math.pi), "Hz"), zone(peak),
            number(one.complementary_peak.value), number(one.disk.frequency / (2.0 * math.pi), "Hz"),
        )
        for one, peak in ((one, _peak(one)) for one in margins.channels)
    )  # fmt: skip
    heads = ("Channel", "Peak of |S|", "in dB", "At", "Zone", "Peak of |T|", f"Disk {ALPHA} at")
    return Table(
        f"Sensitivity peaks of {label}, one channel at a time, with the zones of ISO 14839-3 for active magnetic "
        "bearings: A below 3 (9.5 dB), B below 4 (12 dB), C below 5 (14 dB), D above",
        heads, rows, (2.0, 1.0, 1.0, 1.0, 0.7, 1.0, 1.0), (1, 2, 3, 5, 6),
    )  # fmt: skip


def _peak(one: ChannelMargins) -> float:
    """The largest |S|; NaN where the modulus margin is unresolved."""
    return math.nan if math.isnan(one.modulus.value) else one.sensitivity_peak


def zone(sensitivity_peak: float) -> str:
    """The zone of ISO 14839-3 for the largest |S| of a loop; a dash where that is not known.

    Examples
    --------
    >>> [zone(value) for value in (2.9, 3.0, 4.5, 5.0)]
    ['A', 'B', 'C', 'D']
    """
    return ABSENT if math.isnan(sensitivity_peak) else sensitivity_zone(sensitivity_peak)


def _multi_loop_words(disk: DiskMargin) -> str:
    low, high = disk.gain_range_db
    at = number(disk.frequency / (2.0 * np.pi), "Hz")
    bounds = f"proven {number(disk.alpha_proven)}, reached by a worst case at {number(disk.alpha_reached)} and {at}"
    replayed = "the replay puts a pole on the axis" if disk.verified else "not confirmed by a replay"
    return (
        f"All channels at once: disk margin {ALPHA} between bounds {bounds} ({disk.agreement.value}; {replayed}). "
        f"Every channel may change at once by {_any_gain(low, high)}, or by {number(disk.phase, 'deg')} of phase."
    )


def _any_gain(low: float, high: float) -> str:
    """A range of gains (dB) in words; a disk as large as it can be leaves nothing out."""
    if low < -_ALL and high > _ALL:
        return "any positive gain"
    return f"any gain between {number(low, 'dB')} and {number(high, 'dB')}"


def _unresolved(margins: Margins) -> tuple[str, ...]:
    """Reasons of every margin that no replay confirmed."""
    named = ("gain_reduction", "gain_increase", "phase", "delay", "modulus")
    found = [
        f"{one.channel}, {name.replace('_', ' ')}: {value.reason}"
        for one in margins.channels
        for name, value in ((name, getattr(one, name)) for name in named)
        if not value.verified
    ]
    if not margins.multi_loop.verified:
        found.append(f"all channels, disk margin: {margins.multi_loop.reason}")
    return tuple(found)
