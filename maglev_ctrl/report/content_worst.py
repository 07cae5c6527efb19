"""The worst perturbation of an option's loops: what gain and phase, where, puts a pole on the axis."""

from __future__ import annotations

import cmath
import math
from typing import Final

import numpy as np

from maglev_ctrl.analysis.disk import DiskMargin
from maglev_ctrl.analysis.margins import Margins
from maglev_ctrl.report.charts_margins import disk_value, disk_words
from maglev_ctrl.report.equations import DISK, DISK_PEAK
from maglev_ctrl.report.model import Block, Cell, Paragraph, Passage, Reference, Table, cell
from maglev_ctrl.report.style import ABSENT, ALPHA, MINUS, TIMES, number

_MOST: Final = 16


def worst_words(channel: str, factor: complex, frequency: float, *, replayed: bool) -> str:
    """The perturbation of one channel that takes the loop to its limit, in words; `frequency` in rad/s.

    Examples
    --------
    >>> worst_words("coil", 0.5 + 0.0j, 2.0 * math.pi, replayed=True)
    'coil: gain × 0.500 (−6.02 dB) at 1.00 Hz and phase 0° puts a pole on the axis'
    """
    at = number(frequency / (2.0 * math.pi), "Hz")
    turned = "" if phase_words(factor) == ABSENT else f" and phase {phase_words(factor)}"
    told = "puts a pole on the axis" if replayed else "should put a pole on the axis, which no replay confirmed"
    return f"{channel}: gain {gain_words(factor)} at {at}{turned} {told}"


def gain_words(factor: complex) -> str:
    """The modulus of a factor with its decibels.

    Examples
    --------
    >>> gain_words(2.0 + 0.0j), gain_words(0.0j), gain_words(complex("inf"))
    ('× 2.00 (6.02 dB)', '× 0', 'beyond all bounds')
    """
    size = abs(factor)
    if not math.isfinite(size):
        return "beyond all bounds"
    if size == 0.0:
        return f"{TIMES} {number(size)}"
    return f"{TIMES} {number(size)} ({number(20.0 * math.log10(size), 'dB')})"


def phase_words(factor: complex) -> str:
    """The angle of a factor in degrees, with its sign.

    Examples
    --------
    >>> phase_words(1.0j), phase_words(1.0 - 1.0j)
    ('+90.0°', '−45.0°')
    """
    if not cmath.isfinite(factor) or factor == 0.0:
        return ABSENT
    degrees = math.degrees(cmath.phase(factor))
    text = number(abs(degrees)) + "°"
    return text if round(degrees, 6) == 0.0 else f"{'+' if degrees > 0.0 else MINUS}{text}"


def worst_blocks(margins: Margins, label: str, *, key: str) -> list[Block]:
    """One sentence for the loop that is lost first, and a table of the worst perturbation of every channel.

    Parameters
    ----------
    key : begins the name of the table for references
    """
    known = [c for c in margins.channels if math.isfinite(disk_value(c.disk)) and _factors(c.disk, 1) is not None]
    joint = margins.multi_loop
    together = _factors(joint, len(margins.channels))
    if not known and together is None:
        return []
    blocks: list[Block] = []
    if known:
        first = min(known, key=lambda c: disk_value(c.disk))
        disk = first.disk
        size = disk_words(disk) if math.isnan(disk.alpha) else f"= {disk_words(disk)}"
        which = "single channels" if len(known) == len(margins.channels) else (
            f"the {len(known)} of {len(margins.channels)} single channels whose worst perturbation was found"
        )  # fmt: skip
        factor = complex(disk.factors[0])
        if math.isfinite(abs(factor)):
            told = worst_words(first.channel, factor, disk.frequency, replayed=disk.verified)
            blocks.append(
                Passage((f"Lost first among {which} is {told} (disk margin {ALPHA} {size}; ",
                         Reference(f"table:{key}-worst"), ")."))
            )  # fmt: skip
        else:
            blocks.append(Paragraph(
                f"Among {which} none is lost by any positive gain, nor within {number(disk.phase, 'deg')} of phase "
                f"(disk margin {ALPHA} {size})."
            ))  # fmt: skip
    rows = []
    for place, one in enumerate(margins.channels[:_MOST]):
        alone = complex(one.disk.factors[0]) if one in known else complex(math.nan, 0.0)
        both = complex(math.nan, 0.0) if together is None else complex(together[place])
        rows.append((
            cell(one.channel), *_perturbed(alone), cell(number(one.disk.frequency / (2.0 * math.pi), "Hz")),
            cell("yes" if one.disk.verified else "no"), *_perturbed(both),
        ))  # fmt: skip
    left = len(margins.channels) - len(rows)
    more = f" (first {len(rows)} of {len(margins.channels)} channels)" if left else ""
    at = number(joint.frequency / (2.0 * math.pi), "Hz")
    joined = "" if together is None else (
        f" All channels changed at once as in the last two columns put it there at {at}"
        + ("." if joint.verified else ", which no replay confirmed.")
    )  # fmt: skip
    heads = ("Channel alone", "Gain", "Phase", "At", "Replayed", "Gain, all at once", "Phase, all at once")
    blocks.append(Table(
        f"Worst perturbations of {label}{more}: a channel multiplied by this gain and turned by this phase puts a pole "
        f"of the closed loop on the axis.{joined}",
        heads, tuple(rows), (1.9, 1.5, 0.9, 0.9, 0.8, 1.5, 1.0), (1, 2, 3, 5, 6), True, f"{key}-worst",
        (DISK, DISK_PEAK),
    ))  # fmt: skip
    return blocks


def _factors(disk: DiskMargin, channels: int) -> tuple[complex, ...] | None:
    """The factors of a disk margin of all channels; None where it has none."""
    if disk.perturbation.size != channels or not np.isfinite(disk.perturbation).all():
        return None
    return tuple(complex(factor) for factor in disk.factors)


def _perturbed(factor: complex) -> tuple[Cell, Cell]:
    if math.isnan(factor.real):
        return cell(ABSENT), cell(ABSENT)
    return cell(gain_words(factor)), cell(phase_words(factor))
