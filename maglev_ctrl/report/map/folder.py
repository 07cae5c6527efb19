"""Stability maps written as a folder: map.html, map.pdf, map.nc, map.json and ranges.csv, whole or not at all."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from maglev_ctrl.report.folder import write_whole
from maglev_ctrl.report.html import html
from maglev_ctrl.report.map.content import map_model
from maglev_ctrl.report.map.data import json_text, netcdf, ranges_csv
from maglev_ctrl.report.pdf import pdf
from maglev_ctrl.report.vector import svg
from maglev_ctrl.study.map.records import MapStudy

PAGE: Final = "map.html"
PAPER: Final = "map.pdf"
ARRAYS: Final = "map.nc"
SUMMARY: Final = "map.json"
RANGES: Final = "ranges.csv"


def write_map(study: MapStudy, folder: Path) -> tuple[Path, ...]:
    """Write map.html, map.pdf, map.nc, map.json and ranges.csv into `folder`; other files there are kept.

    Parameters
    ----------
    folder : made when it does not exist

    Raises
    ------
    ValueError : a map that does not stand on the study's own grid
    """
    report = map_model(study)
    pictures = {chart.key: svg(chart) for chart in report.charts()}
    made = {
        PAGE: html(report, pictures).encode(), PAPER: pdf(report, pictures), ARRAYS: netcdf(study),
        SUMMARY: json_text(study).encode(), RANGES: ranges_csv(study).encode(),
    }  # fmt: skip
    return write_whole(made, Path(folder))
