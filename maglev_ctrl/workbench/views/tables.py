"""The numbers behind every view, column by column with their units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.report.charts_margins import disk_value
from maglev_ctrl.report.groups import ledger_groups
from maglev_ctrl.study.live.records import LiveComparison, LiveView
from maglev_ctrl.workbench.views.ledger import ledger_rows
from maglev_ctrl.workbench.views.map_image import WORDS
from maglev_ctrl.workbench.views.shown import ShownMode, shown_modes


@dataclass(frozen=True, eq=False, slots=True)
class Column:
    """`key`: a name that every format takes; `name` in words; `unit`, "" for words and ratios; numbers or words."""

    key: str
    name: str
    unit: str
    values: FloatArray | tuple[str, ...]


def columns_of(view: LiveView | LiveComparison, which: str, mode: int = 0) -> tuple[Column, ...]:
    """The columns of one view, all of one length.

    Raises
    ------
    ValueError : there is nothing to show; one sentence says why
    """
    if isinstance(view, LiveComparison):
        return _comparison(view)
    if which == "map":
        return _map(view)
    if which == "margins":
        return _margins(view)
    if which == "eigenvalues":
        return _eigenvalues(view)
    if which == "ledger":
        return _ledger(view, mode)
    if which == "shape":
        return _shape(view, mode)
    raise ValueError(f"which: there are no numbers of {which!r} in this view")


def picked(view: LiveView, mode: int) -> ShownMode:
    """The picked mode of a view.

    Raises
    ------
    ValueError : there is no such mode; one sentence says why
    """
    shown = shown_modes(view)
    if not 0 <= mode < len(shown):
        raise ValueError(view.failure or f"mode: expected one of {len(shown)} shown modes, got number {mode}")
    return shown[mode]


def _eigenvalues(view: LiveView) -> tuple[Column, ...]:
    """Every shown track at every speed, then the modes at the operating point."""
    if view.modes is None:
        raise ValueError(view.failure or "there are no modes to show")
    labels: list[str] = []
    points: list[str] = []
    speed, s = [], []
    shown = shown_modes(view)
    for one in shown:
        if one.track >= 0 and view.tracks is not None:
            count = len(view.tracks.parameter)
            labels += [one.label] * count
            points += ["sweep"] * count
            speed.append(view.tracks.parameter)
            s.append(view.tracks.s[:, one.track])
    labels += [one.label for one in shown]
    points += ["operating point"] * len(shown)
    speed.append(np.full(len(shown), view.speed))
    s.append(view.modes.s[[one.mode for one in shown]])
    values, at = np.concatenate(s), np.concatenate(speed)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = -values.real / np.abs(values)
    return (
        Column("mode", "mode", "", tuple(labels)), Column("point", "point", "", tuple(points)),
        Column("speed", "speed", "m/s", at), Column("growth", "growth rate", "1/s", values.real),
        Column("frequency", "frequency", "Hz", values.imag / (2.0 * np.pi)),
        Column("damping_ratio", "damping ratio", "", ratio),
    )  # fmt: skip


def _map(view: LiveView) -> tuple[Column, ...]:
    if view.map is None:
        raise ValueError(view.failure or view.map_reason or "there is no map")
    found = view.map
    depth, speed = np.meshgrid(found.depth, found.speed, indexing="ij")
    states = tuple(WORDS[int(value)] for value in found.state.ravel())
    return (
        Column("speed", "speed", "m/s", speed.ravel()), Column("depth", "modulation depth", "", depth.ravel()),
        Column("growth", "growth rate", "1/s", np.asarray(found.growth, dtype=float).ravel()),
        Column("state", "state", "", states),
        Column("checked", "checked by two engines", "", ("yes" if found.checked else "no",) * len(states)),
    )  # fmt: skip


def _ledger(view: LiveView, mode: int) -> tuple[Column, ...]:
    one = picked(view, mode)
    if view.modes is None or view.system is None:
        raise ValueError(view.failure or "there are no modes to show")
    rows, why = ledger_rows(ledger_groups(view.system, view.modes.ledger), view.modes, one.mode)
    if not rows:
        raise ValueError(why)
    return (
        Column("mode", "mode", "", (one.label,) * len(rows)),
        Column("element", "element", "", tuple(r[0] for r in rows)),
        Column("damping", "share through damping", "1/s", np.array([r[1] for r in rows])),
        Column("circulatory", "share through circulation", "1/s", np.array([r[2] for r in rows])),
    )  # fmt: skip


def _shape(view: LiveView, mode: int) -> tuple[Column, ...]:
    one = picked(view, mode)
    if view.modes is None:
        raise ValueError(view.failure or "there are no modes to show")
    shape = view.modes.shapes[:, one.mode]
    return (
        Column("mode", "mode", "", (one.label,) * len(shape)), Column("coordinate", "coordinate", "", view.modes.dofs),
        Column("real", "real part, largest entry 1", "", shape.real),
        Column("imaginary", "imaginary part", "", shape.imag),
    )  # fmt: skip


def _margins(view: LiveView) -> tuple[Column, ...]:
    """Requirements, then margins, one value per row."""
    rows: list[tuple[str, str, float, float, str, str, str]] = [
        ("requirement", one.name, one.value, one.limit, one.unit or "1", one.verdict.value, one.reason)
        for one in view.requirements
    ]
    for one in view.margins.channels if view.margins is not None else ():
        for name, value, unit in (
            ("gain reduction", one.gain_reduction.value, "1"), ("gain increase", one.gain_increase.value, "1"),
            ("phase", one.phase.value, "deg"), ("delay", one.delay.value, "s"), ("disk", disk_value(one.disk), "1"),
        ):  # fmt: skip
            said = "verified" if one.verified else "UNRESOLVED"
            rows.append((f"margin of {one.channel}", name, value, np.nan, unit, said, ""))
    if not rows:
        raise ValueError(view.failure or view.margins_reason or "nothing has been evaluated yet")
    heads = ("kind", "name", "value", "limit", "unit", "verdict", "reason")
    return tuple(
        Column(head, head, "", np.array([row[k] for row in rows], dtype=float) if head in ("value", "limit")
               else tuple(str(row[k]) for row in rows))
        for k, head in enumerate(heads)
    )  # fmt: skip


def _comparison(found: LiveComparison) -> tuple[Column, ...]:
    if not found.options:
        raise ValueError("the scenario has no options to compare")
    return (
        Column("option", "option", "", found.options), Column("label", "label", "", found.labels),
        Column("growth", "growth rate", "1/s", found.growth),
        Column("least_damping", "least damping ratio", "", found.least_damping),
        Column("disk_margin", "disk margin", "", found.disk_margin),
        Column("periodic_growth", "growth rate with modulation", "1/s", found.periodic_growth),
        Column("verdict", "verdict", "", tuple(one.value for one in found.verdicts)),
        Column("reason", "reason", "", found.reasons),
    )  # fmt: skip
