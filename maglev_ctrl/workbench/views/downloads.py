"""What a view shows as a file: a figure of print quality, or the numbers with their units."""

from __future__ import annotations

import csv
import io
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from maglev_ctrl._version import __version__
from maglev_ctrl.report.chart import Chart
from maglev_ctrl.study.live.records import LiveComparison, LiveView
from maglev_ctrl.workbench.views.charts import comparison_chart, eigenvalue_chart, ledger_chart, map_chart, shape_chart
from maglev_ctrl.workbench.views.tables import Column, columns_of

if TYPE_CHECKING:
    import xarray

Which = Literal["eigenvalues", "map", "ledger", "shape", "margins", "comparison"]
FileKind = Literal["svg", "png", "csv", "nc"]
FIGURES: Final[tuple[Which, ...]] = ("eigenvalues", "map", "ledger", "shape", "comparison")
TABLES: Final[tuple[Which, ...]] = ("eigenvalues", "map", "ledger", "shape", "margins", "comparison")
DOTS: Final = 300  # per inch
_FORMULA: Final = ("=", "+", "-", "@", "\t", "\r")


def figure_files(view: LiveView | LiveComparison, which: Which, kind: FileKind, *, mode: int = 0) -> bytes:
    """One view as a file.

    Parameters
    ----------
    which : "margins" has no figure, only numbers
    mode : place of the picked mode among the shown ones, for the ledger and the shape

    Raises
    ------
    ValueError : there is nothing to show, or no figure of it; one sentence
    """
    if kind in ("svg", "png"):
        chart = _chart(view, which, mode)
        return _svg(chart) if kind == "svg" else _png(chart)
    columns = columns_of(view, which, mode)
    return _csv(columns) if kind == "csv" else bytes(dataset(view, which, columns).to_netcdf(engine="scipy"))


def _chart(view: LiveView | LiveComparison, which: Which, mode: int) -> Chart:
    if isinstance(view, LiveComparison):
        if which != "comparison":
            raise ValueError(f"which: expected 'comparison' for a comparison, got {which!r}")
        return comparison_chart(view)
    match which:
        case "eigenvalues":
            return eigenvalue_chart(view)
        case "map":
            return map_chart(view)
        case "ledger":
            return ledger_chart(view, mode)
        case "shape":
            return shape_chart(view, mode)
        case _:
            raise ValueError(f"which: there is no figure of {which!r}; expected one of {', '.join(FIGURES)}")


def _svg(chart: Chart) -> bytes:
    from maglev_ctrl.report.vector import svg

    return b'<?xml version="1.0" encoding="utf-8"?>\n' + svg(chart).encode()


def _png(chart: Chart) -> bytes:
    import matplotlib

    from maglev_ctrl.report.draw import draw
    from maglev_ctrl.report.style import PAPER, RC

    stream = io.BytesIO()
    with matplotlib.rc_context(RC):
        draw(chart).savefig(stream, format="png", dpi=DOTS, facecolor=PAPER, metadata={"Software": None})
    return stream.getvalue()


def _csv(columns: tuple[Column, ...]) -> bytes:
    """A table with a head of names and units; a word that a spreadsheet would take for a formula is quoted as text."""
    stream = io.StringIO()
    out = csv.writer(stream, lineterminator="\n")
    out.writerow([_text(f"{one.name} ({one.unit})" if one.unit else one.name) for one in columns])
    for row in zip(*(one.values for one in columns), strict=True):
        out.writerow([_text(value) if isinstance(value, str) else _number(value) for value in row])
    return stream.getvalue().encode()


def _text(words: str) -> str:
    return f"'{words}" if words.startswith(_FORMULA) else words


def _number(value: Any) -> str:
    number = float(value)
    return "" if np.isnan(number) else f"{number:.12g}"


def dataset(view: LiveView | LiveComparison, which: Which, columns: tuple[Column, ...]) -> xarray.Dataset:
    """The numbers of a view as arrays over a row index, each with its units and its name in words."""
    import xarray

    found = {}
    for one in columns:
        said = {"long_name": one.name, "units": one.unit or "1"}
        if one.key in ("value", "limit"):  # every row has its own
            said = {"long_name": one.name, "comment": "in the unit that the variable `unit` gives for its row"}
        if isinstance(one.values, tuple):
            found[one.key] = ("row", np.array([words.encode() for words in one.values], dtype="S"), {
                "long_name": one.name, "encoding_of_words": "utf-8"})  # fmt: skip
        else:
            found[one.key] = ("row", np.asarray(one.values, dtype=np.float64), said)
    told: dict[str, Any] = {"view": which, "maglev_ctrl_version": __version__}
    if isinstance(view, LiveView):
        told |= {"option": view.option, "speed_m_per_s": view.speed, "height_m": view.height, "depth": view.depth,
                 "verdict": view.verdict.value, "settled": int(view.settled)}  # fmt: skip
    return xarray.Dataset(found, attrs=told)
