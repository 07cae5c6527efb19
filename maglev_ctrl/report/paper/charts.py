"""Charts of the reproduction: each figure of the paper, the reduced kinematics beside the consistent ones."""

from __future__ import annotations

from typing import Final

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.report.chart import Axis, Chart, Item, Line, Marks, Panel, Rule, Span
from maglev_ctrl.report.style import FAIL_COLOUR, INK, colour, dash
from maglev_ctrl.study.paper.double_l import root
from maglev_ctrl.study.paper.records import MODELS, DataTable, EigenSweep, Model, Reproduction

MODEL_WORDS: Final[dict[Model, str]] = {
    "P": "P: paper, Eq. 43", "C": "C: consistent", "CG": "CG: with preload",
}  # fmt: skip
COMPUTED: Final = "Computed, not measured."
_MODES: Final = ("first mode (heave)", "second mode", "third mode")
_FLUTTER: Final = "#cc79a7"


def force_chart(found: Reproduction) -> Chart:
    """Fig. 3: lift and guidance over height and over the gap."""
    return _force_panels(
        found, ("F_L (N)", "F_G (N)"), "fig03",
        "Fig. 3 of the paper: lift and guidance force of one magnet at 36.1 m/s over height (left) and gap (right). "
        f"{COMPUTED} Circles: maximum over height, squares: minimum over the gap.",
    )  # fmt: skip


def stiffness_chart(found: Reproduction) -> Chart:
    """Fig. 4: the four stiffnesses over height and over the gap."""
    return _force_panels(
        found, ("k_ll (N/m)", "k_lg (N/m)", "k_gl (N/m)", "k_gg (N/m)"), "fig04",
        "Fig. 4 of the paper: stiffness of one magnet at 36.1 m/s over height (left) and gap (right): k_ll = dF_L/dh, "
        f"k_lg = dF_L/dY*, k_gl = dF_G/dh, k_gg = dF_G/dY*. {COMPUTED} k_lg and k_gl are one curve, by reciprocity.",
    )  # fmt: skip


def _force_panels(found: Reproduction, columns: tuple[str, ...], key: str, caption: str) -> Chart:
    tables = {
        "height": [t for t in found.tables if t.name.startswith("fig03_04_over_height")],
        "gap": [t for t in found.tables if t.name.startswith("fig03_04_over_gap")],
    }
    panels = []
    for column in columns:
        for along, words, other in (("height", "levitation height h (mm)", "Y*"), ("gap", "guidance gap Y* (mm)", "h")):
            items: list[Item] = []
            fixed = [one.fixed for one in found.extremes["default"] if one.along == along]
            for order, (table, value) in enumerate(zip(tables[along], fixed, strict=True), 1):
                label = f"{other} = {1e3 * value:g} mm"
                place = order if along == "height" else order + 2
                items.append(Line(table.rows[:, 0], _column(table, column), label, colour(place), dash(0)))
            if column == "F_G (N)":
                items += _extremes(found, along)
            if column.startswith("k_"):
                items.append(Rule("y", 0.0, "", INK, "solid", 0.7))
            panels.append(Panel(tuple(items), Axis(words), Axis(""), column))
    return Chart(
        key=key, caption=caption, alt=caption, panels=tuple(panels), columns=2, panel_height=1.45, legend="bottom",
    )  # fmt: skip


def _extremes(found: Reproduction, along: str) -> list[Item]:
    return [
        Marks(
            np.array([1e3 * one.at]), np.array([one.force]),
            "circle" if one.kind == "maximum" else "square", "", INK, 4.5,
            (f"{one.kind} at {1e3 * one.at:.2f} mm",),
        )
        for one in found.extremes["default"]
        if one.along == along and np.isfinite(one.at)
    ]  # fmt: skip


def _column(table: DataTable, name: str) -> FloatArray:
    return np.asarray(table.rows[:, table.columns.index(name)])


def ratio_chart(found: Reproduction) -> Chart:
    """Fig. 5: lift and drag as shares of the image force."""
    table = found.table("fig05_force_ratios")
    panels = []
    for force, words in (("L", "lift ratio ε_L"), ("D", "drag ratio ε_D")):
        items: list[Item] = [
            Line(table.rows[:, 0], _column(table, f"eps_{force} n={n}"), f"n = {n}", colour(i), dash(0))
            for i, n in enumerate(("1", "1/3", "1/5"), 1)
        ]
        panels.append(Panel(tuple(items), Axis("speed ratio v/w"), Axis(""), words))
    caption = "Fig. 5 of the paper: magnetic forces divided by the image force, Eq. 15."
    return Chart("fig05", caption, caption, tuple(panels), columns=2, panel_height=1.7)


def heave_chart(found: Reproduction) -> Chart:
    """Fig. 6: heave frequency over height."""
    table = found.table("fig06_heave_frequency")
    known = np.isfinite(table.rows[:, 2])
    items: tuple[Item, ...] = (
        Line(table.rows[:, 0], table.rows[:, 1], "Eq. 25", colour(1)),
        Marks(table.rows[known, 0], table.rows[known, 2], "open_circle", "assembled vehicle", colour(2), 4.0),
    )
    caption = "Fig. 6 of the paper: natural frequency of heave over the levitation height, image force of Eq. 15."
    panel = Panel(items, Axis("levitation height (mm)"), Axis("frequency (Hz)"))
    return Chart("fig06", caption, caption, (panel,), panel_height=1.8)


def eigen_chart(found: Reproduction, key: str, number: str) -> Chart:
    """Figs. 10, 12, 13, 14: omega_R and omega_I of the three modes, one column a model.

    Parameters
    ----------
    key : of the sweep, such as "fig10"
    number : how the paper calls the figure, such as "Fig. 10"
    """
    sweeps = [found.sweep(key, model) for model in MODELS]
    top, bottom = [], []
    real, imaginary = _limits(sweeps)
    for sweep in sweeps:
        x, omega = 1e3 * sweep.values, root(sweep.squared)
        bands = _bands(sweep)
        first = sweep is sweeps[0]
        above: list[Item] = [Line(x, omega[:, k].real, _MODES[k], colour(k + 1), dash(0)) for k in range(3)]
        below: list[Item] = [Line(x, omega[:, k].imag, _MODES[k], colour(k + 1), dash(0)) for k in range(3)]
        label = "levitation height h (mm)" if sweep.parameter == "height" else "lateral offset (mm)"
        title = MODEL_WORDS[sweep.model]
        top.append(Panel((*above, *bands), Axis(""), Axis("ω_R (1/s)" if first else "", limits=real), title))
        bottom.append(Panel(
            (*below, *bands), Axis(label), Axis("ω_I (1/s)" if first else "", limits=imaginary)
        ))  # fmt: skip
    where = f"Y* = {1e3 * sweeps[0].gap:g} mm" if key in ("fig10", "fig12") else (
        f"g0 = {1e3 * sweeps[0].gap:g} mm, h = {1e3 * (sweeps[0].height or 0.0):g} mm, frozen"
    )  # fmt: skip
    caption = (
        f"{number} of the paper, {where}: real and imaginary part of √λ. Left the paper's reduced "
        "kinematics, then the consistent ones without and with weight and preload. Bands: flutter and divergence, "
        "from closed conditions and confirmed by eigenvalues."
    )
    alt = caption + " " + "; ".join(f"{one.model}: {instability_words(one)}" for one in sweeps)
    return Chart(
        key=key, caption=caption, alt=alt, panels=(*top, *bottom), columns=3, panel_height=1.5, legend="bottom",
    )  # fmt: skip


def instability_words(sweep: EigenSweep) -> str:
    """Where a sweep flutters and diverges, in words."""
    from maglev_ctrl.study.paper.evidence import ranges_words

    ends = {"high": float(sweep.values[-1])} if sweep.parameter == "height" else {}
    return f"flutter {ranges_words(sweep.flutter, **ends)}, divergence {ranges_words(sweep.divergence, **ends)}"


def _limits(
    sweeps: list[EigenSweep], *, columns: tuple[int, ...] = (0, 1, 2)
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Common axes, so that models can be compared across."""
    omega = np.concatenate([root(one.squared)[:, list(columns)] for one in sweeps])
    high, other = float(np.max(omega.real)), float(np.max(omega.imag))
    return (-0.03 * high, 1.06 * high), (-0.05 * max(other, 1.0), 1.1 * max(other, 1.0))


def _bands(sweep: EigenSweep) -> list[Item]:
    bands: list[Item] = [Span("x", 1e3 * a, 1e3 * b, _FLUTTER, 0.20, label="flutter") for a, b in sweep.flutter]
    bands += [Span("x", 1e3 * a, 1e3 * b, FAIL_COLOUR, 0.22, label="divergence") for a, b in sweep.divergence]
    return bands


def gap_chart(found: Reproduction) -> Chart:
    """Fig. 15: the third mode over the lateral offset for four gaps, one column a model."""
    keys = [key for key in dict.fromkeys(one.key for one in found.sweeps) if key.startswith("fig15")]
    real, imaginary = _limits([found.sweep(key, model) for key in keys for model in MODELS], columns=(2,))
    top, bottom = [], []
    for model in MODELS:
        above: list[Item] = []
        below: list[Item] = []
        for order, key in enumerate(keys, 1):
            sweep = found.sweep(key, model)
            omega, name = root(sweep.squared)[:, 2], f"g0 = {1e3 * sweep.gap:g} mm"
            above.append(Line(1e3 * sweep.values, omega.real, name, colour(order), dash(0)))
            below.append(Line(1e3 * sweep.values, omega.imag, name, colour(order), dash(0)))
        first = model == MODELS[0]
        label_x = Axis("lateral offset (mm)")
        top.append(Panel(tuple(above), Axis(""), Axis("ω_R (1/s)" if first else "", limits=real), MODEL_WORDS[model]))
        bottom.append(Panel(tuple(below), label_x, Axis("ω_I (1/s)" if first else "", limits=imaginary)))
    caption = (
        "Fig. 15 of the paper, h = 7 mm: third mode (sway where the vehicle is centred) over the lateral offset, "
        "frozen, for four guidance gaps. Where ω_R is zero and ω_I is not, it diverges."
    )
    return Chart("fig15", caption, caption, (*top, *bottom), columns=3, panel_height=1.4, legend="bottom")


def speed_chart(found: Reproduction) -> Chart | None:
    """Lift, drag and unsteady damping of this magnet over speed; None where the forces know one speed only."""
    speeds = found.speeds
    if speeds is None:
        return None
    forces: tuple[Item, ...] = (
        Line(speeds.speed, speeds.lift, "lift", colour(1)),
        Line(speeds.speed, speeds.drag, "drag", colour(2)),
        Rule("x", speeds.peak, "drag peak", INK, "dot"),
    )
    panels = [Panel(forces, Axis("speed (m/s)"), Axis(""), "force (N)")]
    if speeds.unsteady_speed.size:
        names = ("surge", "sway", "heave")
        items: list[Item] = []
        for k, name in enumerate(names):
            items.append(Line(speeds.unsteady_speed, speeds.damping[:, k], f"c of {name}", colour(k + 3)))
            items.append(Marks(speeds.unsteady_speed, speeds.damping[:, k], "circle", "", colour(k + 3), 3.5))
        items += [Rule("y", 0.0, "", INK, "solid", 0.7), Rule("x", speeds.peak, "drag peak", INK, "dot")]
        panels.append(Panel(tuple(items), Axis("speed (m/s)"), Axis(""), "c = Im Q / ω (N s/m)"))
    hertz = speeds.frequency / (2.0 * np.pi)
    caption = (
        f"Beyond the paper: lift and drag of this magnet over speed at h = Y* = 12.7 mm, and its damping when it "
        f"oscillates at {hertz:.0f} Hz. Positive c is negative damping: surge beyond the drag peak, heave never."
        if len(panels) == 2 else "Lift and drag of this magnet over speed at h = Y* = 12.7 mm."
    )  # fmt: skip
    return Chart("speeds", caption, caption, tuple(panels), columns=2, panel_height=1.7)
