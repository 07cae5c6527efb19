"""A sweep written as a folder: sweep.html, sweep.nc and sweep.json, whole or not at all."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any, Final

from maglev_ctrl.report.folder import write_whole
from maglev_ctrl.report.html import html
from maglev_ctrl.report.serialise import plain
from maglev_ctrl.report.sweep.arrays import write_netcdf
from maglev_ctrl.report.sweep.content import range_words, sweep_report
from maglev_ctrl.report.sweep.digest import SweepDigest
from maglev_ctrl.report.vector import svg
from maglev_ctrl.study.sweep.records import SweepStudy
from maglev_ctrl.study.sweep.store import SweepStore

PAGE: Final = "sweep.html"
ARRAYS: Final = "sweep.nc"
SUMMARY: Final = "sweep.json"
FORMAT: Final = 1


def write_sweep(study: SweepStudy, store: SweepStore, folder: Path) -> tuple[Path, ...]:
    """Write sweep.html, sweep.nc and sweep.json into `folder`; other files there are kept.

    Parameters
    ----------
    store : of the finished sweep; every block is read, checked, and written on

    Raises
    ------
    ModelError : a block that was kept cannot be read any more
    """
    digest = SweepDigest(study)
    arrays = store.path / ARRAYS  # whatever ends this process, it goes with the store
    write_netcdf(arrays, study, store, watch=digest.add)
    with arrays.open("rb") as stream:
        os.fsync(stream.fileno())  # on the disk before it gets its place, as the others are
    report = sweep_report(digest)
    page = html(report, {chart.key: svg(chart) for chart in report.charts()})
    made: dict[str, bytes | Path] = {PAGE: page.encode(), ARRAYS: arrays, SUMMARY: json_text(study).encode()}
    return write_whole(made, folder)


def json_text(study: SweepStudy) -> str:
    """The sweep without its arrays; every number with its unit."""
    request = study.request
    body: dict[str, Any] = {
        "format": FORMAT, "kind": "maglev-ctrl sweep", "title": study.title, "scenario": study.name,
        "scenario_path": study.scenario_path, "scenario_hash": study.scenario_hash, "created": study.created,
        "versions": plain(study.versions), "method": request.method, "seed": request.seed, "points": request.points,
        "computed": list(request.parts), "notes": list(study.notes), "workers": study.workers,
        "blocks": study.blocks, "points_of_a_block": study.block, "blocks_kept": study.resumed,
        "blocks_damaged": study.damaged, "seconds": _quantity(study.seconds, "s"), "work": _quantity(study.busy, "s"),
        "quantities": [
            {"name": one.quantity.name, "label": one.quantity.label, "unit": one.quantity.unit or "1",
             "distribution": "normal" if one.normal else "even", "values": range_words(one, study),
             "from": plain(one.ends[0]), "to": plain(one.ends[1]), "steps": one.count or None,
             "own_value": plain(float(one.quantity.value))}
            for one in request.ranges
        ],
        "options": [
            {"name": one.name, "label": one.label, "states": one.states, "modulated_states": one.modulated,
             "requirements": one.verdicts, "status": one.statuses,
             "remarks": [{"words": words, "points": count} for words, count in one.remarks]}
            for one in study.options
        ],
        "arrays": ARRAYS,
    }  # fmt: skip
    return json.dumps(body, ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def _quantity(value: float, unit: str) -> dict[str, Any]:
    return {"value": plain(float(value)), "unit": unit}
