"""A sweep for people and for machines: page, arrays and summary."""

from maglev_ctrl.report.sweep.folder import write_sweep

__all__ = ["write_sweep"]
