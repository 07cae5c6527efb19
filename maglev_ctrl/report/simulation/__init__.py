"""A simulated option as a folder: page, PDF, summary and every signal of every run."""

from maglev_ctrl.report.simulation.folder import write_simulation

__all__ = ["write_simulation"]
