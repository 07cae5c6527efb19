"""Designs written as a folder: design.html, design.pdf, design.json and exported controllers, whole or not at all."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from maglev_ctrl.proofs.file import from_document
from maglev_ctrl.report.design.content import design_model
from maglev_ctrl.report.design.exports import export_design
from maglev_ctrl.report.folder import write_whole
from maglev_ctrl.report.html import html
from maglev_ctrl.report.pdf import pdf
from maglev_ctrl.report.vector import svg
from maglev_ctrl.study.design.document import designs_text
from maglev_ctrl.study.design.records import DesignStudy

PAGE: Final = "design.html"
PAPER: Final = "design.pdf"
FILE: Final = "design.json"
EXPORTS: Final = "export"


def write_design(study: DesignStudy, folder: Path) -> tuple[Path, ...]:
    """Write design.html, design.pdf, design.json and the folder export into `folder`; other files there are kept.

    Every proved law is exported to MATLAB and Python, sampled ones to C too.

    Parameters
    ----------
    folder : made when it does not exist
    """
    report = design_model(study)
    pictures = {chart.key: svg(chart) for chart in report.charts()}
    documents = [option.document for option in study.options if option.document is not None]
    made = {
        PAGE: html(report, pictures).encode(), PAPER: pdf(report, pictures),
        FILE: designs_text(documents, created=study.created, versions=study.versions).encode(),
    }  # fmt: skip
    for document in documents:
        found = from_document(document)
        for target in ("mat", "python", "c"):
            if target == "c" and "sampled" not in found.extra:
                continue
            made |= {f"{EXPORTS}/{name}": content for name, content in export_design(found, target).items()}
    return write_whole(made, Path(folder), replaced=[EXPORTS])
