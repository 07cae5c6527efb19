"""A reproduction written as a folder: page, JSON and the data of every figure as CSV, all or nothing."""

from __future__ import annotations

import csv
import io
import json
import os
from pathlib import Path
from typing import Final

from maglev_ctrl.report.folder import write_whole
from maglev_ctrl.report.paper.page import page
from maglev_ctrl.report.serialise import plain
from maglev_ctrl.study.paper.records import DataTable, Reproduction

PAGE: Final = "reproduction.html"
RECORD: Final = "reproduction.json"
DATA: Final = "reproduction_data"
NAMES: Final = (PAGE, RECORD, DATA)


def write_reproduction(found: Reproduction, folder: str | os.PathLike[str]) -> tuple[Path, ...]:
    """Write reproduction.html, reproduction.json and reproduction_data/*.csv into `folder`; returns the three paths.

    Everything is made in a temporary folder beside `folder` and moved there when complete: a failure leaves an earlier
    reproduction as it was. Other files in `folder` are kept.

    Parameters
    ----------
    folder : made when it does not exist
    """
    tables = {f"{DATA}/{table.name}.csv": csv_text(table).encode() for table in found.tables}
    return write_whole({PAGE: page(found).encode(), RECORD: to_json(found).encode(), **tables}, Path(folder))


def to_json(found: Reproduction) -> str:
    """The reproduction as JSON text; the figures' numbers stand in the CSV files beside it.

    Lengths are in m, forces in N, squared frequencies in 1/s^2.
    """
    solved = found.solved
    body = {
        "format": 1,
        "kind": "maglev-ctrl reproduction",
        "version": found.version,
        "created": found.created,
        "seconds": found.seconds,
        "quick": found.quick,
        "method": solved.method,
        "case": plain(solved.case),
        "assumptions": list(found.assumptions),
        "notes": list(found.notes),
        "claims": [plain(claim) for claim in found.claims],
        "extremes": {name: [plain(one) for one in group] for name, group in found.extremes.items()},
        "sweeps": [
            {
                "figure": one.key, "model": one.model, "parameter": one.parameter, "gap": one.gap,
                "height": one.height, "flutter": plain(one.flutter), "divergence": plain(one.divergence),
                "boundaries": [plain(boundary) for boundary in one.boundaries], "agreement": one.agreement.value,
                "reason": one.reason, "data": f"{DATA}/{one.key}_model_{one.model}.csv",
            }
            for one in found.sweeps
        ],
        "modes": [plain(one) for one in found.modes],
        "sensitivity": [plain(row) for row in found.sensitivity],
        "tables": [{"file": f"{DATA}/{one.name}.csv", "columns": list(one.columns)} for one in found.tables],
    }  # fmt: skip
    return json.dumps(body, ensure_ascii=False, allow_nan=False, indent=1)


def csv_text(table: DataTable) -> str:
    """One table as CSV: headings with units, then the rows to ten significant digits; an unknown value is empty.

    Examples
    --------
    >>> import numpy as np
    >>> csv_text(DataTable("t", ("v (m/s)", "F (N)"), np.array([[1.0, np.nan]])))
    'v (m/s),F (N)\\n1,\\n'
    """
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(table.columns)
    writer.writerows([["" if value != value else f"{value:.10g}" for value in row] for row in table.rows])
    return stream.getvalue()
