"""Margins at every place where a loop can be broken: skews side by side, replayed poles, common delay, peaks of K S."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from maglev_ctrl.analysis.common_delay import CommonDelay
from maglev_ctrl.analysis.margin_sites import MarginSites, Site, SiteMargins
from maglev_ctrl.errors import Agreement
from maglev_ctrl.report.charts_margins import disk_value
from maglev_ctrl.report.model import Block, Bullets, Cell, Paragraph, Table, row
from maglev_ctrl.report.style import ABSENT, ALPHA, SIGMA, number

_SITES: Final[dict[Site, str]] = {
    "input": "inputs of the plant (commands)", "output": "outputs of the plant (sensors)",
    "both": "inputs and outputs at once",
}  # fmt: skip
_MOST_SENSORS: Final = 8


def margin_site_blocks(sites: MarginSites, label: str) -> list[Block]:
    """Disk margins of all channels at once by site and skew, with what the replays found."""
    blocks: list[Block] = [_site_table(sites, label), Paragraph(common_delay_words(sites.common_delay))]
    told = tuple(
        f"{_SITES[one.site]}, skew {number(sigma)}: {disk.reason}"
        for one in sites.sites
        for sigma, disk in zip(one.sigmas, one.skewed, strict=True)
        if disk.reason
    )
    blocks += [Bullets(told)] if told else []
    return [*blocks, _command_table(sites, label)] if sites.command_peaks.size else blocks


def _site_table(sites: MarginSites, label: str) -> Table:
    sigmas = sites.input.sigmas
    skews = tuple(f"{ALPHA}, {SIGMA} = {number(sigma)}" for sigma in sigmas)
    heads = ("Loops broken at", *skews, "Replayed pole off the axis", "Largest |S| of one", "Zone")
    count = len(sigmas)
    return Table(
        f"Disk margins {ALPHA} of {label}, all channels at once, for skews {SIGMA} of the disk (above 0 gain increase "
        "counts more, below 0 gain reduction); how far from the axis the worst perturbations leave the pole, relative; "
        "the worst zone of ISO 14839-3 of a single channel",
        heads, tuple(_site_row(one) for one in sites.sites), (2.2, *(1.0 for _ in sigmas), 1.4, 1.1, 0.6),
        right=tuple(range(1, count + 3)),
    )  # fmt: skip


def _site_row(one: SiteMargins) -> tuple[Cell, ...]:
    far = one.pole_distances[np.isfinite(one.pole_distances)]
    moduli = [channel.modulus.value for channel in one.margins.channels]
    peak = math.nan if any(math.isnan(m) for m in moduli) else max(c.sensitivity_peak for c in one.margins.channels)
    return row(
        _SITES[one.site], *(number(disk_value(disk)) for disk in one.skewed),
        number(float(np.max(far)), digits=1) if far.size else ABSENT, number(peak),
        ABSENT if math.isnan(peak) else max(one.zones),
    )  # fmt: skip


def common_delay_words(delay: CommonDelay) -> str:
    """How much more delay all channels together survive."""
    if delay.agreement is Agreement.UNRESOLVED:
        return f"Delay common to all channels: UNRESOLVED: {delay.reason}"
    if math.isinf(delay.delay):
        return "Delay common to all channels: none destabilises the loop."
    if delay.delay == 0.0:
        return f"Delay common to all channels: {delay.reason}."
    return (
        f"The same additional delay in all channels is survived up to {number(1e3 * delay.delay, 'ms')}, where a pole "
        f"reaches the axis at {number(delay.frequency / (2.0 * math.pi), 'Hz')} (replayed: "
        f"{number(delay.pole_distance, digits=1)} off the axis, relative)."
    )


def _command_table(sites: MarginSites, label: str) -> Table:
    shown = sites.measured[:_MOST_SENSORS]
    rows = tuple(
        row(
            command,
            *(
                f"{number(float(peak))} at {number(float(frequency) / (2.0 * math.pi), 'Hz')}"
                for peak, frequency in zip(peaks[: len(shown)], frequencies[: len(shown)], strict=True)
            ),
        )
        for command, peaks, frequencies in zip(
            sites.commands, sites.command_peaks, sites.command_frequencies, strict=True
        )
    )  # fmt: skip
    left = len(sites.measured) - len(shown)
    more = f"; {left} more signals are in report.json" if left else ""
    return Table(
        f"What disturbed sensors ask of the actuators of {label}: largest gain of K S from each measured signal to "
        f"each command, in command units per measured unit{more}",
        ("Command", *shown), rows, (1.4, *(1.2 for _ in shown)), small=True,
    )  # fmt: skip
