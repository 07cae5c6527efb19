"""Forces of a magnet written as a folder: forces.html, forces.nc and forces.csv, whole or not at all."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from maglev_ctrl._version import __version__
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.report.charts_forces import charts
from maglev_ctrl.report.folder import write_whole
from maglev_ctrl.report.html import html
from maglev_ctrl.report.model import Banner, Block, Bullets, FigureBlock, Paragraph, Report, Section, Table, row
from maglev_ctrl.report.style import number
from maglev_ctrl.report.vector import svg
from maglev_ctrl.study.force_survey import ForceSurvey

if TYPE_CHECKING:
    import xarray

PAGE: Final = "forces.html"
ARRAYS: Final = "forces.nc"
TABLE: Final = "forces.csv"
SIGNS: Final = (
    "Forces act on one magnet: lift up, guidance away from the wall, drag backwards. Damping is force per velocity of "
    "the magnet, so that a value above zero feeds the motion (negative damping)."
)


def write_forces(found: ForceSurvey, folder: str | os.PathLike[str]) -> tuple[Path, ...]:
    """Write forces.html, forces.nc and forces.csv into `folder`; other files there are kept.

    forces.csv is a force table: `model = "table"` reads it.

    Parameters
    ----------
    folder : made when it does not exist
    """
    made = {PAGE: page(found).encode(), ARRAYS: _netcdf(found), TABLE: csv_text(found).encode()}
    return write_whole(made, Path(folder))


def page(found: ForceSurvey) -> str:
    """The page."""
    blocks: list[Block] = []
    verdict = damping_words(found)
    if verdict:
        blocks.append(Banner(None, verdict))
    rows = tuple(row(*one) for one in design_rows(found))
    blocks += [Table("At the design point.", ("quantity", "value"), rows, right=(1,)), Paragraph(SIGNS)]
    sections = [
        Section("Forces of one magnet", "forces", 1, tuple(blocks)),
        Section("Figures", "figures", 1, tuple(FigureBlock(chart) for chart in charts(found))),
        Section("Model", "model", 1, (Bullets((*found.facts, *accuracy_words(found))),)),
    ]
    if found.assumptions:
        sections.append(Section("Assumptions", "assumptions", 1, (Bullets(found.assumptions),)))
    report = Report(
        title=f"Magnetic forces: {found.title}", subtitle=f"{found.name}, {found.model.replace('_', ' ')}",
        created=time.strftime("%Y-%m-%d %H:%M"), scenario_hash=found.scenario_hash, version=__version__,
        sections=tuple(sections),
    )  # fmt: skip
    return html(report, {chart.key: svg(chart) for chart in report.charts()})


def design_rows(found: ForceSurvey) -> tuple[tuple[str, str], ...]:
    """What is known at the design point, in words and numbers; the same on the page and on the terminal."""
    gap = "" if found.gap is None else f", gap {found.gap * 1e3:.4g} mm"
    rows = [("at", f"height {found.height * 1e3:.4g} mm{gap}, {found.speed:.4g} m/s")]
    slopes = found.partials
    for name in ("lift", "guidance", "drag"):
        value = float(getattr(found.forces, name))
        if value or name == "lift":
            rows.append((name, number(value, "N", digits=4)))
    rows.append(("k_ll, lift by height", number(float(slopes.by_height.lift), "N/m", digits=4)))
    if found.gap is not None:
        rows += [
            ("k_lg, lift by gap", number(float(slopes.by_gap.lift), "N/m", digits=4)),
            ("k_gl, guidance by height", number(float(slopes.by_height.guidance), "N/m", digits=4)),
            ("k_gg, guidance by gap", number(float(slopes.by_gap.guidance), "N/m", digits=4)),
        ]
    for name in ("lift", "guidance", "drag"):
        value = float(getattr(slopes.by_speed, name))
        if value:
            rows.append((f"{name} by speed", number(value, "N s/m", digits=3)))
    if np.any(found.table.drag):
        peak = "none in range" if found.drag_peak is None else number(found.drag_peak, "m/s", digits=4)
        rows.append(("drag peak", peak))
    if found.torque is not None:
        rows.append(("roll torque", number(found.torque * 1e3, "mN m", digits=3)))
    rows.append(("vertical damping", _damping_cell(found)))
    if found.heave_damping is not None:
        changes = ", ".join(number(speed, "m/s", digits=4) for speed in found.heave_changes)
        rows.append(("vertical damping changes sign", changes or "none in range"))
    return tuple(rows)


def _damping_cell(found: ForceSurvey) -> str:
    value = found.heave_damping
    if value is None:
        return "not in this model"
    sign = "negative" if value > 0.0 else "positive"
    return f"{sign} (c_ll = {number(value, 'N s/m', digits=3)})"


def damping_words(found: ForceSurvey) -> str:
    """Whether heave is damped at the design point, in a sentence; empty where the model does not say."""
    value = found.heave_damping
    if value is None:
        return ""
    if value > 0.0:
        return f"Vertical damping: negative at {found.speed:.4g} m/s. The magnet's own vertical motion is fed."
    return f"Vertical damping: positive at {found.speed:.4g} m/s. The magnet's own vertical motion is damped."


def accuracy_words(found: ForceSurvey) -> tuple[str, ...]:
    """How good the forces are, in sentences."""
    if found.error is None:
        return ()
    return (
        f"Solved again with finer elements, energy and drag change by {100.0 * found.error:.2g} % at most: an estimate "
        "of the error of the forces, beside that of the map.",
        "Damping and roll torque are exact in frequency and taken from the currents themselves, not from the map.",
    )


def csv_text(found: ForceSurvey) -> str:
    """Every second point of the grid as a force table, SI; a wall that is not there has no gap and no guidance."""
    has_gap = found.gap is not None
    heights, gaps, speeds = (one[_thinned(one)] for one in (found.heights, found.gaps, found.speeds))
    cut = np.ix_(*(_thinned(one) for one in (found.heights, found.gaps, found.speeds)))
    grids = np.meshgrid(heights, gaps, speeds, indexing="ij")
    columns = [("height [m]", grids[0]), ("gap [m]", grids[1]), ("speed [m/s]", grids[2])]
    columns += [(f"{name} [N]", getattr(found.table, name)[cut]) for name in ("lift", "guidance", "drag")]
    kept = [one for one in columns if has_gap or one[0] not in ("gap [m]", "guidance [N]")]
    lines = [f"# forces of one magnet: {found.name}, {found.model}", ", ".join(name for name, _ in kept)]
    values = np.stack([values.ravel() for _, values in kept], axis=1)
    lines += [", ".join(f"{value:.9g}" for value in line) for line in values.tolist()]
    return "\n".join(lines) + "\n"


def _thinned(values: FloatArray) -> FloatArray:
    """Every second index, both ends kept."""
    return np.unique(np.r_[np.arange(0, len(values), 2), len(values) - 1])


def to_dataset(found: ForceSurvey) -> xarray.Dataset:
    """Everything in the figures as named arrays with units."""
    import xarray

    has_gap = found.gap is not None
    axes = {"height": (found.heights, "m"), "gap": (found.gaps, "m"), "speed": (found.speeds, "m/s")}
    axes["fine_speed"] = (found.over_speed.values, "m/s")
    parts: dict[str, tuple[tuple[str, ...], FloatArray, str, str]] = {}
    plane = ("height", "gap") if has_gap else ("height",)
    space = (*plane, "speed")

    def flat(values: FloatArray) -> FloatArray:
        return values if has_gap else values[:, 0]

    for name in ("lift", "guidance", "drag"):
        parts[name] = space, flat(getattr(found.table, name)), "N", f"{name} of one magnet"
        line = found.over_speed
        parts[f"{name}_over_speed"] = ("fine_speed",), getattr(line.forces, name), "N", f"{name} at the design place"
        parts[f"{name}_by_speed"] = (
            ("fine_speed",), getattr(line.slopes.by_speed, name), "N s/m", f"partial of the {name} by speed",
        )  # fmt: skip
    for symbol, way, name in (
        ("k_ll", "by_height", "lift"), ("k_lg", "by_gap", "lift"),
        ("k_gl", "by_height", "guidance"), ("k_gg", "by_gap", "guidance"),
    ):  # fmt: skip
        values = flat(getattr(getattr(found.slopes, way), name))
        parts[symbol] = plane, values, "N/m", f"partial of the {name} {way.replace('_', ' ')} at the design speed"
    for along, damping in (("speed", found.damping_over_speed), ("height", found.damping_over_height)):
        if damping is None:
            continue
        for symbol, kind in (("c_ll", "heave"), ("c_gg", "sway"), ("c_gl", "sway_by_heave"), ("c_xx", "surge")):
            words = f"force on the magnet per velocity, {kind.replace('_', ' ')}; above zero it feeds the motion"
            parts[f"{symbol}_over_{along}"] = (along,), getattr(damping, kind), "N s/m", words
    for along, torque in (("speed", found.torque_over_speed), ("height", found.torque_over_height)):
        if torque is not None:
            parts[f"roll_torque_over_{along}"] = (along,), torque, "N m", "about the coil's middle, y towards z"
    used = {axis for dims, *_ in parts.values() for axis in dims}
    return xarray.Dataset(
        {name: (dims, values, {"units": unit, "long_name": words}) for name, (dims, values, unit, words) in
         parts.items()},
        coords={name: (name, values, {"units": unit}) for name, (values, unit) in axes.items() if name in used},
        attrs=_attributes(found),
    )  # fmt: skip


def _attributes(found: ForceSurvey) -> dict[str, Any]:
    said: dict[str, Any] = {
        "title": found.title, "scenario": found.name, "scenario_hash": found.scenario_hash, "model": found.model,
        "maglev_ctrl_version": __version__, "design_height_m": found.height, "design_speed_m_per_s": found.speed,
        "facts": "\n".join(found.facts), "assumptions": "\n".join(found.assumptions), "signs": SIGNS,
    }  # fmt: skip
    if found.gap is not None:
        said["design_gap_m"] = found.gap
    if found.drag_peak is not None:
        said["drag_peak_m_per_s"] = found.drag_peak
    if found.error is not None:
        said["error_estimate_relative"] = found.error
    if found.quality is not None:
        quality = found.quality
        said |= {"map_residual_forces": quality.forces, "map_residual_drag": quality.drag,
                 "map_residual_stiffness": quality.stiffness, "map_residual_points": quality.checks}  # fmt: skip
    return said


def _netcdf(found: ForceSurvey) -> bytes:
    """NetCDF 3: every reader of NetCDF knows it, and SciPy writes it."""
    return bytes(to_dataset(found).to_netcdf(engine="scipy"))
