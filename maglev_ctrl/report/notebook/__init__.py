"""Results in a notebook: `html` draws what `_repr_html_` shows, `to_dataset` and `to_frame` hand out the numbers."""

from maglev_ctrl.report.notebook.datasets import to_dataset
from maglev_ctrl.report.notebook.frames import to_frame
from maglev_ctrl.report.notebook.page import html

__all__ = ["html", "to_dataset", "to_frame"]
