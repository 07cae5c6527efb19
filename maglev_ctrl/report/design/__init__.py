"""Designs as a folder: design.html, design.pdf, design.json and the exported controllers."""

from maglev_ctrl.report.design.folder import write_design

__all__ = ["write_design"]
