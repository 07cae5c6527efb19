"""Pictures of the gallery: the largest growth rate of every option over the first sweep of a scenario, computed anew.

A picture is kept under the hash of its scenario and of the program that drew it, so that neither can change without it.
"""

from __future__ import annotations

import hashlib
import re
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import OutOfDomain
from maglev_ctrl.report.chart import Axis, Chart, Line, Panel, Rule, Span
from maglev_ctrl.report.charts_modes import PARAMETER_WORDS
from maglev_ctrl.report.style import FAIL_COLOUR, INK, colour, dash
from maglev_ctrl.report.vector import svg, themed
from maglev_ctrl.scenario import OptionRecord, Scenario, load
from maglev_ctrl.study import solve_forces
from maglev_ctrl.study.law import designed_option
from maglev_ctrl.study.records import SweepName
from maglev_ctrl.study.situation import Situation
from maglev_ctrl.study.sweeps import DISPLAY, sweep_values, varied

ROOT = Path(__file__).resolve().parents[2]
POINTS = 25


def scenario_files() -> list[Path]:
    """Every scenario of the project, those that compare options first."""
    order = ("compare", "periodic", "design", "paper")
    files = (ROOT / "scenarios").rglob("*.toml")
    return sorted(files, key=lambda path: (order.index(path.parent.name), path.name))


def pictures(folder: Path) -> dict[Path, str]:
    """SVG texts of all scenarios, read from the folder or drawn by two processes.

    Raises
    ------
    MaglevError : a scenario cannot be read, or a law of it does not exist
    """
    folder.mkdir(parents=True, exist_ok=True)
    program = program_hash()
    kept = {path: folder / f"{path.stem}-{_hash(program, path.read_bytes())}.svg" for path in scenario_files()}
    for stale in set(folder.glob("*.svg")) - set(kept.values()):
        stale.unlink()
    missing = [path for path, file in kept.items() if not file.exists()]
    if missing:
        # The slowest laws first, so that both processes end together.
        missing.sort(key=lambda path: "design" not in path.parts)
        with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
            for path, text in zip(missing, pool.map(picture, missing), strict=True):
                kept[path].write_text(text, encoding="utf-8")
    return {path: file.read_text(encoding="utf-8") for path, file in kept.items()}


def program_hash() -> bytes:
    """One hash of everything a picture depends on besides its scenario."""
    digest = hashlib.sha256(Path(__file__).read_bytes())
    for path in sorted((ROOT / "maglev_ctrl").rglob("*.py")):
        if not {"workbench", "cli"} & set(path.parts):
            digest.update(path.read_bytes())
    return digest.digest()


def _hash(program: bytes, text: bytes) -> str:
    return hashlib.sha256(program + text).hexdigest()[:16]


def picture(path: Path) -> str:
    """The picture of one scenario as an SVG text for inlining."""
    scenario = solve_forces(load(path))
    parameter, swept = sweep_values(scenario)[0]
    values = np.linspace(swept[0], swept[-1], POINTS)
    unit, scale = DISPLAY[parameter]
    lines = [
        Line(values * scale, growth(scenario, option, parameter, values), option.label, colour(k), dash(k))
        for k, option in enumerate(scenario.options)
    ]
    known = np.concatenate([line.y[np.isfinite(line.y)] for line in lines])
    low, high = float(known.min()), float(known.max())
    room = 0.08 * (max(high, 0.0) - min(low, 0.0))
    limits = (min(low, 0.0) - room, max(high, 0.0) + room)
    words = f"{PARAMETER_WORDS[parameter]} ({unit})"
    chart = Chart(
        key=f"gallery-{path.parent.name}-{path.stem}",
        caption="",
        alt=f"Largest growth rate of every option of {scenario.title!r} over {words}; below zero is stable.",
        panels=(
            Panel(
                (Span("y", 0.0, limits[1], FAIL_COLOUR, 0.10), *lines, Rule("y", 0.0, "", INK, "solid", 0.7)),
                Axis(words),
                Axis("largest growth rate (1/s)", limits=limits),
            ),
        ),
        panel_height=2.0,
    )
    return themed(svg(chart), label=chart.alt)


def growth(scenario: Scenario, option: OptionRecord, parameter: SweepName, values: FloatArray) -> FloatArray:
    """Largest real part of the closed loop's eigenvalues (1/s) at every value; NaN where forces or law end.

    Raises
    ------
    ModelError : there is no equilibrium, or the option's law does not exist
    """
    model, design = designed_option(scenario, option)
    law = None if design is None else design.controller
    found = np.full(values.shape, np.nan)
    for k, value in enumerate(values):
        there = varied(Situation.of_design(scenario), parameter, float(value))
        try:
            closed = model.closed_of(model.vehicle(there.payload), there, law)
        except OutOfDomain:
            continue
        found[k] = np.linalg.eigvals(closed.state_matrix()).real.max()
    return found


def looked_for(text: str) -> list[str]:
    """The numbered points under "What to look for" in the opening comment of a scenario file."""
    opening = text.split("\nformat =", 1)[0]
    _, _, told = opening.partition("What to look for")
    points: list[str] = []
    for line in told.splitlines()[1:]:
        words = line.removeprefix("#").strip()
        numbered = re.fullmatch(r"\d+\. (.*)", words)
        if numbered:
            points.append(numbered[1])
        elif words and points:
            points[-1] += f" {words}"
    return points
