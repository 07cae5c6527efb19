"""Reports of a comparison: one self-contained HTML page, a PDF and a JSON file, written all or nothing."""

from maglev_ctrl.report.document import write

__all__ = ["write"]
