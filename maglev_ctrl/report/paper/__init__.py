"""The reproduction of the paper as one offline page, a JSON file and the data of every figure."""

from maglev_ctrl.report.paper.files import write_reproduction

__all__ = ["write_reproduction"]
