"""Designs written as a folder: design.html, design.pdf, design.json and exported controllers, whole or not at all."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

from maglev_ctrl.errors import ModelError
from maglev_ctrl.proofs.file import DesignFile, from_document
from maglev_ctrl.report.design.content import design_model
from maglev_ctrl.report.design.exports import export_design, sampled_form
from maglev_ctrl.report.folder import write_whole
from maglev_ctrl.report.html import html
from maglev_ctrl.report.pdf import pdf
from maglev_ctrl.report.vector import svg
from maglev_ctrl.study.design.document import DAMPERS, SAMPLED, dated, designs_text, kind_of
from maglev_ctrl.study.design.records import DesignStudy

PAGE: Final = "design.html"
PAPER: Final = "design.pdf"
FILE: Final = "design.json"
EXPORTS: Final = "export"


def write_design(study: DesignStudy, folder: Path) -> tuple[Path, ...]:
    """Write design.html, design.pdf, design.json and the folder export into `folder`; other files there are kept.

    Every proved law is exported to MATLAB, Python and JSON, and to C where it has a sampling period.

    Parameters
    ----------
    folder : made when it does not exist
    """
    report = design_model(study)
    pictures = {chart.key: svg(chart) for chart in report.charts()}
    documents = dated(
        [option.document for option in study.options if option.document is not None],
        created=study.created, versions=study.versions,
    )  # fmt: skip
    made = {
        PAGE: html(report, pictures).encode(), PAPER: pdf(report, pictures),
        FILE: designs_text(documents, created=study.created, versions=study.versions).encode(),
    }  # fmt: skip
    exported: dict[str, bytes] = {}
    for document in documents:
        design = from_document(document)
        files = _exports(design)
        while exported.keys() & files.keys():  # options "a" and "a_sampled" both want a_sampled.py
            design = replace(design, name=f"{design.name}_law")
            files = _exports(design)
        exported |= files
    made |= {f"{EXPORTS}/{name}": content for name, content in exported.items()}
    return write_whole(made, Path(folder), replaced=[EXPORTS])


def _exports(design: DesignFile) -> dict[str, bytes]:
    """Every file of one design; a law whose sampled loop is not proved stable is written as it was designed only."""
    try:
        held = sampled_form(design, None)
    except ModelError:  # the page tells it where it speaks of sampling
        design = replace(design, extra={key: value for key, value in design.extra.items() if key != SAMPLED})
        held = None
    programmed = held is not None and kind_of(design) != DAMPERS
    targets = (*("mat", "python", "json"), *(("c",) if programmed else ()))
    return {name: content for target in targets for name, content in export_design(design, target).items()}
