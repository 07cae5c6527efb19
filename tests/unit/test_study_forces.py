"""The words about a force table: residuals and checks are those of the fit."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from maglev_ctrl.scenario import Scenario, build_vehicle, load
from maglev_ctrl.study.forces import describe_forces


def test_image_force_in_words(small_scenario: Callable[..., Scenario]) -> None:
    scenario = small_scenario()
    assert describe_forces(scenario, build_vehicle(scenario))[0].startswith("Image force (Eq. 15), exponent n = 1")


def test_table_tells_residuals_check_and_domain(tmp_path: Path, small_text: str) -> None:
    heights, speeds = np.linspace(60.0, 140.0, 7), np.linspace(10.0, 120.0, 6)
    rows = [f"{h:g},{v:g},{4e6 / h * v**2 / (v**2 + 10.0):.9g},{4e6 / h * 3.2 * v / (v**2 + 10.0):.9g}"
            for h in heights for v in speeds]  # fmt: skip
    text = "height [mm],speed [m/s],lift [N],drag [N]\n" + "\n".join(rows) + "\n"
    (tmp_path / "forces.csv").write_text(text, encoding="utf-8")
    start, end = small_text.index("[forces]"), small_text.index("[operating]")
    changed = small_text[:start] + '[forces]\nmodel = "table"\nfile = "forces.csv"\n\n' + small_text[end:]
    (tmp_path / "table.toml").write_text(changed, encoding="utf-8")
    scenario = load(tmp_path / "table.toml")
    words = " ".join(describe_forces(scenario, build_vehicle(scenario)))
    assert "forces.csv: 42 samples, spline fit" in words
    assert "height 60 to 140 mm, speed 36 to 432 km/h; nothing is extrapolated" in words
    assert "Largest residual of the fit: lift" in words and "(halved grid): lift" in words
