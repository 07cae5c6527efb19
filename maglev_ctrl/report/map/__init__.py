"""Stability maps as a folder: map.html, map.pdf, map.nc, map.json and ranges.csv."""

from maglev_ctrl.report.map.folder import write_map

__all__ = ["write_map"]
