"""Simulations written as a folder: simulation.html, simulation.pdf, simulation.json and trajectory.nc, or nothing."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from maglev_ctrl._version import __version__
from maglev_ctrl.analysis.simulation.records import Trajectory
from maglev_ctrl.report.content_nonlinear import study_blocks
from maglev_ctrl.report.folder import write_whole
from maglev_ctrl.report.html import html
from maglev_ctrl.report.model import Banner, Block, Bullets, Listing, Report, Section
from maglev_ctrl.report.pdf import pdf
from maglev_ctrl.report.serialise import plain
from maglev_ctrl.report.vector import svg
from maglev_ctrl.study.nonlinear.records import SimulationStudy

if TYPE_CHECKING:
    import xarray

FORMAT: Final = 1
PAGE, PAPER, SUMMARY, ARRAYS = "simulation.html", "simulation.pdf", "simulation.json", "trajectory.nc"
METHOD = (
    "The linear numbers are those of the report: eigenvalues, exact variances, Floquet exponents. They are computed in "
    "the band of waves that the simulated guideway holds.",
    "A growth rate is fitted to small free motions of the nonlinear vehicle without use of the linear model; a "
    "standard deviation comes with a band from the scatter of the runs.",
    "The step of the integration is halved until the motion no longer changes; contact is found between steps.",
    "AGREED means that the two numbers agree within what each is known to; anything else is told and never smoothed.",
)


def write_simulation(study: SimulationStudy, folder: Path) -> tuple[Path, ...]:
    """Write simulation.html, simulation.pdf, simulation.json and trajectory.nc into `folder`; other files are kept.

    Parameters
    ----------
    folder : made when it does not exist
    """
    report = simulation_model(study)
    pictures = {chart.key: svg(chart) for chart in report.charts()}
    made = {
        PAGE: html(report, pictures).encode(), PAPER: pdf(report, pictures), SUMMARY: json_text(study).encode(),
        ARRAYS: bytes(to_dataset(study).to_netcdf(engine="scipy")),
    }  # fmt: skip
    return write_whole(made, Path(folder))


def simulation_model(study: SimulationStudy) -> Report:
    """The whole page as a tree of blocks."""
    blocks: list[Block] = [Banner(study.verdict, verdict_words(study))]
    if study.summary:
        blocks.append(Bullets(study.summary))
    check = study_blocks(study.study, study.label, key=study.option)
    sections = (
        Section(f"Option: {study.label}", "option", 1, tuple(blocks), study.verdict),
        Section("Linear theory and nonlinear vehicle", "check", 1, tuple(check)),
        Section("Method", "method", 1, (Bullets(METHOD),)),
        Section("Scenario file", "scenario", 1, (Listing(study.scenario_text),)),
    )
    return Report(
        f"Simulation: {study.title}", f"{study.label}, of {study.name}", study.created, study.scenario_hash,
        dict(study.versions).get("maglev_ctrl", __version__), sections,
    )  # fmt: skip


def verdict_words(study: SimulationStudy) -> str:
    """What the banner says."""
    events, compared = study.study.events, study.study.compared
    if events:
        first = min(events, key=lambda event: event.time)
        return (
            f"{len(events)} of {study.study.runs} runs ended early; the first after {first.time:.3g} s: {first.words}."
        )
    differ = [one.name for one in compared if one.reason]
    if differ:
        return f"Not agreed with the linear theory: {'; '.join(differ)}."
    return f"{len(compared)} numbers of the linear theory are confirmed by the nonlinear vehicle; nothing touched."


def json_text(study: SimulationStudy) -> str:
    """The summary for machines; the signals stand in trajectory.nc."""
    body = {
        "format": FORMAT, "kind": "maglev-ctrl simulation", "verdict": study.verdict.value, "title": study.title,
        "scenario": study.name, "scenario_hash": study.scenario_hash, "option": study.option,
        "study": plain(study.study), "versions": [list(pair) for pair in study.versions], "created": study.created,
    }  # fmt: skip
    return json.dumps(body, ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def to_dataset(study: SimulationStudy) -> xarray.Dataset:
    """Every signal (run, time) in SI; NaN after a run's end."""
    return trajectory_dataset(study.trajectory).assign_attrs({
        "title": study.title, "scenario": study.name, "scenario_hash": study.scenario_hash, "option": study.option,
        "created": study.created, "assumptions": "\n".join(study.study.assumptions),
    })  # fmt: skip


def trajectory_dataset(found: Trajectory) -> xarray.Dataset:
    """The same for a trajectory on its own."""
    import xarray

    names = {_safe(name): name for name in found.signals}
    return xarray.Dataset(
        {key: (("run", "time"), np.asarray(found.signals[name]), {"signal": name, "units": "SI"})
         for key, name in names.items()}
        | {"ends": ("run", np.asarray(found.ends), {"units": "s", "long_name": "when each run ended"})},
        coords={"time": ("time", np.asarray(found.time), {"units": "s"})},
        attrs={
            "maglev_ctrl_version": __version__, "step_s": found.step, "step_error": found.step_error,
            "energy_error": found.energy_error, "events": "\n".join(event.reason for event in found.events),
        },
    )  # fmt: skip


def _safe(name: str) -> str:
    """A name that every reader of NetCDF takes."""
    return "".join(c if c.isalnum() else "_" for c in name)
