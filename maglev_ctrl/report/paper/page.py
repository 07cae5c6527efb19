"""The reproduction as one HTML file: no network, light and dark, readable without scripts and in print."""

from __future__ import annotations

from collections import Counter
from importlib.resources import files
from typing import Final

from maglev_ctrl.errors import Agreement
from maglev_ctrl.report.chart import Chart
from maglev_ctrl.report.interactive import interactive, packed, plotly_script
from maglev_ctrl.report.paper import charts
from maglev_ctrl.report.paper.shapes import Drawing, drawings
from maglev_ctrl.report.style import ABSENT
from maglev_ctrl.report.vector import svg, themed
from maglev_ctrl.study.paper.claims_double_l import WINDOW
from maglev_ctrl.study.paper.evidence import ranges_words
from maglev_ctrl.study.paper.records import ClaimVerdict, EigenSweep, ModeTable, Reproduction, SensitivityRow
from maglev_ctrl.study.paper.table1 import PRINTED

SIGNS: Final = {
    ClaimVerdict.HOLDS: "✓", ClaimVerdict.CORRECTED: "✓*", ClaimVerdict.FALSE: "✗", ClaimVerdict.NOT_TESTABLE: ABSENT,
    ClaimVerdict.UNRESOLVED: "?",
}  # fmt: skip
SLUGS: Final = {
    ClaimVerdict.HOLDS: "pass", ClaimVerdict.CORRECTED: "corrected", ClaimVerdict.FALSE: "fail",
    ClaimVerdict.NOT_TESTABLE: "unknown", ClaimVerdict.UNRESOLVED: "unresolved",
}  # fmt: skip
_EIGEN: Final = (("fig10", "Fig. 10"), ("fig12", "Fig. 12"), ("fig13", "Fig. 13"), ("fig14", "Fig. 14"))


def page(found: Reproduction) -> str:
    """The whole page.

    Parameters
    ----------
    found : a reproduction, from any force model
    """
    from jinja2 import Environment, StrictUndefined
    from markupsafe import Markup

    shared = files("maglev_ctrl.report").joinpath("templates")
    own = files("maglev_ctrl.report.paper").joinpath("templates")
    made = _charts(found)
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    template = environment.from_string(own.joinpath("reproduction.html.j2").read_text(encoding="utf-8"))
    return template.render(
        found=found,
        charts=made,
        figures={key: Markup(themed(svg(chart), label=chart.alt)) for key, chart in made.items()},
        counts=[(verdict, Counter(claim.verdict for claim in found.claims)[verdict]) for verdict in ClaimVerdict],
        headline=headline(found),
        signs=SIGNS,
        slugs=SLUGS,
        shapes=[(_model_words(model), _shape_rows(found, model)) for model in ("P", "CG")],
        table_1=_table_1(found),
        boundaries=_boundaries(found),
        sensitivity=[_sensitivity_cells(row) for row in found.sensitivity],
        resolved=lambda row: row.agreement is Agreement.AGREED,
        style_sheet=Markup(shared.joinpath("report.css").read_text(encoding="utf-8")),
        own_style=Markup(own.joinpath("reproduction.css").read_text(encoding="utf-8")),
        figure_data=Markup(packed({key: interactive(chart) for key, chart in made.items()})),
        figure_library=Markup(plotly_script()),
        script=Markup(shared.joinpath("report.js").read_text(encoding="utf-8")),
        own_script=Markup(own.joinpath("reproduction.js").read_text(encoding="utf-8")),
    )


def headline(found: Reproduction) -> tuple[str, ...]:
    """The findings in a few sentences, put together from the numbers of this very run."""
    paper, consistent = found.sweep("fig10", "P"), found.sweep("fig10", "CG")
    told = [
        f"Flutter (Fig. 10): the paper reads {1e3 * WINDOW[0]:.0f} to {1e3 * WINDOW[1]:.0f} mm; its own equations with "
        f"these forces give {ranges_words(paper.flutter)}; the consistent equations give "
        f"{ranges_words(consistent.flutter)}.",
        "Divergence at g0 = 25 mm (Figs. 13 and 14), lateral offsets: "
        f"h = 12.7 mm {ranges_words(found.sweep('fig13', 'CG').divergence)}, "
        f"h = 7 mm {ranges_words(found.sweep('fig14', 'CG').divergence)}; in the paper's equations "
        f"{ranges_words(found.sweep('fig13', 'P').divergence)} and "
        f"{ranges_words(found.sweep('fig14', 'P').divergence)}.",
    ]
    rolls = []
    for key, gap in (("fig12", "5"), ("fig10", "12.7")):
        sweep = found.sweep(key, "CG")
        rolls.append(f"{ranges_words(sweep.divergence, high=float(sweep.values[-1]))} at Y* = {gap} mm")
    told.append("Roll-sway divergence over height that the paper's equations cannot see: " + "; ".join(rolls) + ".")
    open_ones = [f"{one.key} model {one.model}: {one.reason}" for one in found.sweeps if one.reason]
    if open_ones:
        told.append("UNRESOLVED, two ways to a boundary disagree: " + "; ".join(open_ones))
    return tuple(told)


def _charts(found: Reproduction) -> dict[str, Chart]:
    made = [
        charts.force_chart(found),
        charts.stiffness_chart(found),
        charts.ratio_chart(found),
        charts.heave_chart(found),
    ]
    made += [charts.eigen_chart(found, key, number) for key, number in _EIGEN]
    made.append(charts.gap_chart(found))
    speeds = charts.speed_chart(found)
    if speeds is not None:
        made.append(speeds)
    return {chart.key: chart for chart in made}


def _model_words(model: str) -> str:
    return {"P": "Paper's reduced kinematics (P)", "CG": "Consistent kinematics with weight and preload (CG)"}[model]


def _shape_rows(found: Reproduction, model: str) -> list[tuple[str, tuple[Drawing, ...]]]:
    return [(f"h = {1e3 * t.height:g} mm", drawings(t)) for t in found.modes if t.model == model]


def _table_1(found: Reproduction) -> list[tuple[str, ...]]:
    """Rows: height, mode, printed v3/v1, then that of each model."""
    rows = []
    for height, printed in PRINTED.items():
        tables = [one for one in found.modes if one.height == height]
        for k in (1, 2):
            cells = [_complex(printed[k - 1]), *(_ratio(table, k) for table in tables)]
            rows.append((f"{1e3 * height:g}", str(k + 1), *cells))
    return rows


def _ratio(table: ModeTable, k: int) -> str:
    return _complex(complex(table.vectors[2, k] / table.vectors[0, k]))


def _complex(value: complex) -> str:
    minus = "\N{MINUS SIGN}"
    if abs(value.imag) < 1e-9:
        return f"{value.real:.3f}".replace("-", minus)
    return (
        f"{value.real:.3f} {'+' if value.imag > 0 else minus} {abs(value.imag):.3f}i, modulus {abs(value):.3f}".replace(
            "-", minus
        )
    )


def _boundaries(found: Reproduction) -> list[tuple[str, ...]]:
    """Rows: figure, model, what, closed condition, eigenvalues, difference."""
    rows = []
    for one in found.sweeps:
        for edge in one.boundaries:
            what = f"{edge.kind} {'begins' if edge.begins else 'ends'}"
            rows.append((
                _figure_words(one), one.model, what, f"{1e3 * edge.value:.4f}", f"{1e3 * edge.eigenvalue:.4f}",
                f"{1e6 * abs(edge.value - edge.eigenvalue):.1e}",
            ))  # fmt: skip
    return [tuple(cell.replace("-", "\N{MINUS SIGN}") for cell in cells) for cells in rows]


def _figure_words(sweep: EigenSweep) -> str:
    number = sweep.key.removeprefix("fig").partition("_")[0]
    return f"Fig. {number}" + (f", g0 = {1e3 * sweep.gap:g} mm" if number == "15" else "")


def _sensitivity_cells(row: SensitivityRow) -> tuple[str, ...]:
    lift, guidance, drag = row.reference_forces
    consistent = [key for key in row.flutter if not key.endswith(" P") and row.flutter[key]]
    return (
        row.label, f"{lift:.3f} / {guidance:.3f} / {drag:.3f}", ranges_words(row.flutter["fig10 P"]),
        ranges_words(row.flutter["fig12 P"]), ", ".join(consistent) or "none", ranges_words(row.divergence["fig13 P"]),
        ranges_words(row.divergence["fig14 P"]), ranges_words(row.divergence["fig13 CG"]),
        ranges_words(row.divergence["fig14 CG"]), row.agreement.value,
    )  # fmt: skip
