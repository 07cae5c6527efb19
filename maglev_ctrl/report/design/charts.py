"""Figures of a design: poles at its corners, gain over frequency, gains of a schedule, cost of damping, a manoeuvre."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.report.chart import Area, Axis, Chart, Item, Line, Marks, Panel, Rule, Span
from maglev_ctrl.report.design.words import round_up, short_names
from maglev_ctrl.report.style import FADED, FAIL_COLOUR, INK, colour, dash, number
from maglev_ctrl.study.design.budgeted import shown_damping
from maglev_ctrl.study.design.records import CornerPoles, GainCurve, LawStudy, PredictiveStudy
from maglev_ctrl.synthesis.damping.budget import BudgetCurve, DampingBudget
from maglev_ctrl.synthesis.lmi.regions import Region, contains
from maglev_ctrl.systems.scheduled import ScheduledController

MOST_GAINS = 8
RAYS = 721
ALIKE = 1e-3
"""Gains whose changes over the parameter differ by less than this share of the largest are shown once."""
_HERTZ = 2.0 * np.pi


def response_chart(study: LawStudy) -> Chart | None:
    """Poles and gain over frequency side by side; one alone where there is no other."""
    poles, gain = poles_chart(study), gain_chart(study)
    if poles is None or gain is None or study.gain is None:
        return poles or gain
    curve = study.gain
    bound = f"; proved below {number(round_up(curve.level), digits=4)}" if np.isfinite(curve.level) else ""
    unstable = " Without the law the loop is unstable." if _unstable(study) else ""
    return Chart(
        key=f"{study.name}-response",
        caption=f"Left: poles of {study.label}{_where(study)}, no actuator delays; crosses without the law, dots with "
        f"it.{_outside(study)} Right: largest gain at the design point, disturbances by their density, outputs and "
        f"commands by their allowed values{bound}.{unstable}",
        alt=f"{poles.alt} {gain.alt}",
        panels=(replace(poles.panels[0], title="poles"), replace(gain.panels[0], title="gain")),
        columns=2, panel_height=1.6, legend="bottom",
    )  # fmt: skip


def poles_chart(study: LawStudy) -> Chart | None:
    """Open- and closed-loop poles of every corner, once for the slow ones of the vehicle; None without corners."""
    if not study.corners:
        return None
    window = _window(study.corners)
    items: list[Item] = []
    asked = None if study.region is None else region_area(study.region, window)
    if asked is not None:
        items.append(asked)
    opened = np.concatenate([corner.open_loop for corner in study.corners])
    closed = np.concatenate([corner.closed_loop for corner in study.corners])
    items.append(Span("x", 0.0, window[1], FAIL_COLOUR, 0.10, label="unstable"))
    items.append(Rule("x", 0.0, "", INK, "solid", 0.7))
    away, held = _hover(study, "open_loop"), _hover(study, "closed_loop")
    items.append(Marks(opened.real, opened.imag, "cross", "without the law", FADED, 5.0, away))
    items.append(Marks(closed.real, closed.imag, "circle", "with the law", colour(1), 4.5, held))
    worst = float(np.max(closed.real, initial=-np.inf))
    return Chart(
        key=f"{study.name}-poles",
        caption=f"Poles of {study.label}{_where(study)}, actuator delays left out; crosses without the law, dots with "
        f"it.{_outside(study)}",
        alt=f"Poles of {study.label}: the rightmost pole with the law is at {number(worst, '1/s')}.",
        panels=(Panel(tuple(items), Axis("real part (1/s)", limits=window[:2]),
                      Axis("imaginary part (rad/s)", limits=(-window[2], window[2]))),),
        panel_height=2.1,
    )  # fmt: skip


def gain_chart(study: LawStudy) -> Chart | None:
    """Largest gain from disturbances to performance over frequency; None where there is no such channel."""
    if study.gain is None:
        return None
    curve = study.gain
    x = np.log10(curve.frequency / _HERTZ)
    unstable = _unstable(study)
    items: list[Item] = [
        Line(x, _decibel(curve.open_loop), "without the law" + (", unstable" if unstable else ""), FADED, "dash"),
        Line(x, _decibel(curve.closed_loop), "with the law", colour(1)),
    ]
    if np.isfinite(curve.level):
        items.append(Rule("y", float(_decibel(np.array([curve.level]))[0]), "proved bound", colour(2), "dashdot", 1.2))
    ticks = tuple(float(k) for k in range(int(np.ceil(x[0])), int(np.floor(x[-1])) + 1))
    labels = tuple(f"{10.0**k:g}" for k in ticks)
    peak = float(np.max(curve.closed_loop))
    proved = (
        f" It is proved to stay below {number(round_up(curve.level), digits=4)}." if np.isfinite(curve.level) else ""
    )
    if unstable:
        proved += " Without the law the loop is unstable and settles to no such response."
    return Chart(
        key=f"{study.name}-gain",
        caption=f"Largest gain of {study.label} at the design point, from disturbances in units of their density to "
        f"outputs and commands in units of their allowed values.{proved}",
        alt=f"Gain of {study.label} over frequency, largest {number(peak)} with the law.",
        panels=(Panel(tuple(items), Axis("frequency (Hz)", limits=(float(x[0]), float(x[-1])), ticks=ticks,
                                         tick_labels=labels),
                      Axis("gain (dB)", limits=_gain_limits(curve))),),
        panel_height=2.1,
    )  # fmt: skip


def schedule_chart(study: LawStudy, schedule: ScheduledController, *, scale: float, unit: str) -> Chart:
    """The largest gains of a scheduled law over its parameter, each relative to its own largest value."""
    x = scale * schedule.nodes
    gains = np.stack([law.D if law.D.any() else law.C for law in schedule.controllers])
    size = np.max(np.abs(gains), axis=0)
    order = np.dstack(np.unravel_index(np.argsort(-size, axis=None, kind="stable"), size.shape))[0]
    first = schedule.controllers[0]
    names = first.measured if first.D.any() else first.states
    shown: list[tuple[FloatArray, str]] = []
    alike: dict[int, int] = {}
    for i, j in order:
        if size[i, j] <= 1e-9 * np.max(size):
            continue
        change = 100.0 * (np.abs(gains[:, i, j]) - np.abs(gains[0, i, j])) / size[i, j]
        same = next((k for k, (other, _) in enumerate(shown) if np.max(np.abs(other - change)) <= 100.0 * ALIKE), None)
        if same is not None:
            alike[same] = alike.get(same, 0) + 1
        elif len(shown) < MOST_GAINS:
            shown.append((change, f"{names[j]} to {first.commands[i]}"))
    items: list[Item] = []
    for place, (change, label) in enumerate(shown):
        more = f" (+{alike[place]} alike)" if place in alike else ""
        items.append(Line(x, change, label + more, colour(place + 1), dash(place // 4)))
        items.append(Marks(x, change, "circle", "", colour(place + 1), 3.0))
    return Chart(
        key=f"{study.name}-schedule",
        caption=f"How the size of the gains of {study.label} changes over {schedule.parameter}, against the first node "
        "and relative to each gain's largest size, the largest gains first; gains that change alike are drawn once. "
        "Dots are the nodes.",
        alt=f"{len(shown)} gains of {study.label} over {schedule.parameter}.",
        panels=(Panel((*items, Rule("y", 0.0, "", INK, "solid", 0.7)), Axis(f"{schedule.parameter} ({unit})"),
                      Axis("change of gain (%)")),),
        panel_height=2.2,
    )  # fmt: skip


def budget_chart(study: LawStudy, budget: DampingBudget, *, chosen: float) -> Chart:
    """Cost against proved decay rate, all places together and each alone, and where the damping sits."""
    unit = "1/s" if budget.quantity == "decay rate" else ""
    axis = Axis(f"proved {budget.quantity}" + (f" ({unit})" if unit else ""))
    together, names = budget.together, short_names(budget.together.places)
    costs: list[Item] = [
        Line(together.margin, together.cost / 1e3, "all places", INK, "solid", 2.2),
        Marks(together.margin, together.cost / 1e3, "circle", "", INK, 4.5),
    ]
    for order, curve in enumerate(budget.alone):
        if np.any(curve.certified):  # the page says in words where nothing was proved
            cost, tint = curve.cost / 1e3, colour(order + 1)
            costs += [Line(curve.margin, cost, f"only {names[order]}", tint, "dash", 1.3),
                      Marks(curve.margin, cost, "square", "", tint, 3.0)]  # fmt: skip
    costs += _unproved(together)
    costs.append(Line(together.margin, together.lower_bound / 1e3, "nothing is cheaper", FADED, "dot", 1.0))
    where: list[Item] = [
        Line(together.margin, shown_damping(together.damping)[:, k] / 1e3, name, colour(k + 1), "solid", 1.4)
        for k, name in enumerate(names)
    ]
    mark = Rule("x", chosen, "chosen", INK, "dot", 1.0)
    return Chart(
        key=f"{study.name}-budget",
        caption=f"What a proved {budget.quantity} costs (left) and how the damping is shared out (right). The dotted "
        "grey line is a bound from the sum of the poles: nothing is cheaper.",
        alt=f"Cost of damping against {budget.quantity}: up to {number(budget.together.best_margin, unit)} is proved.",
        panels=(Panel((*costs, mark), axis, Axis("weighted damping (kN s/m)"), title="cost"),
                Panel((*where, mark), axis, Axis("damping (kN s/m)"), title="where it sits")),
        columns=2, panel_height=2.2, legend="bottom",
    )  # fmt: skip


def _unproved(curve: BudgetCurve) -> list[Item]:
    missing = ~curve.certified
    if not np.any(missing):
        return []
    return [Marks(curve.margin[missing], np.zeros(int(np.sum(missing))), "cross", "UNRESOLVED", FAIL_COLOUR, 5.0,
                  tuple(reason for reason in curve.reasons if reason))]  # fmt: skip


def manoeuvre_chart(study: LawStudy, predictive: PredictiveStudy) -> Chart:
    """Limited outputs and commands of the shown manoeuvre, with prediction and with the saturated law."""
    panels: list[Panel] = []
    for signal in predictive.signals:
        items: list[Item] = [
            Line(predictive.time, signal.scale * signal.predicted, "with prediction", colour(1), "solid", 1.6),
            Line(predictive.time, signal.scale * signal.saturated, "saturated law", colour(2), "dash", 1.3),
        ]
        if np.isfinite(signal.limit):
            ends = ((signal.limit, "limit"), (-signal.limit, ""))
            items += [Rule("y", signal.scale * end, label, FAIL_COLOUR, "dot", 1.0) for end, label in ends]
        panels.append(Panel(tuple(items), Axis("time (s)"), Axis(signal.unit), title=signal.name))
    return Chart(
        key=f"{study.name}-manoeuvre",
        caption=f"The shown manoeuvre of {study.label}: with prediction, and with the linear law cut at its limits.",
        alt=f"{len(panels)} signals over time of the manoeuvre of {study.label}.",
        panels=tuple(panels), panel_height=1.5, share_x=True,
    )  # fmt: skip


def _unstable(study: LawStudy) -> bool:
    """Whether the design point is unstable without the law."""
    opened = study.corners[0].open_loop.real if study.corners else np.zeros(0)
    return bool(np.max(opened, initial=-np.inf) >= 0.0)


def _where(study: LawStudy) -> str:
    return "" if len(study.corners) == 1 else f" at {len(study.corners)} operating points"


def _outside(study: LawStudy) -> str:
    window = _window(study.corners)
    closed = np.concatenate([corner.closed_loop for corner in study.corners])
    count = int(np.sum((closed.real < window[0]) | (np.abs(closed.imag) > window[2])))
    return {0: "", 1: " A faster one lies outside."}.get(count, f" {count} faster ones lie outside.")


def _decibel(values: FloatArray) -> FloatArray:
    return np.asarray(20.0 * np.log10(np.maximum(values, 1e-300)))


def _gain_limits(curve: GainCurve) -> tuple[float, float]:
    """Resonances without damping are cut: they would leave nothing of the rest to see."""
    closed = _decibel(curve.closed_loop)
    top = max(float(np.max(closed)), float(np.percentile(_decibel(curve.open_loop), 95.0)))
    if np.isfinite(curve.level):
        top = max(top, float(_decibel(np.array([curve.level]))[0]))
    bottom = max(float(np.percentile(closed, 10.0)), top - 80.0)
    return bottom - 5.0, top + 10.0


def _window(corners: tuple[CornerPoles, ...]) -> tuple[float, float, float]:
    """Left and right end of the real axis and half the height: what belongs to the vehicle, not to fast lags."""
    every: ComplexArray = np.concatenate([np.concatenate([c.open_loop, c.closed_loop]) for c in corners])
    lively = every[(np.abs(every.imag) > 1e-9) | (every.real > -1.0)]
    size = np.abs(lively if lively.size else every)
    reach = 3.0 * float(np.median(size)) if size.size else 1.0
    shown = every[np.abs(every) <= max(reach, 1e-6)]
    shown = shown if shown.size else every
    left = 1.15 * min(float(np.min(shown.real)), -0.1 * float(np.max(np.abs(shown))))
    right = max(0.25 * abs(left), 1.3 * float(np.max(shown.real)))
    height = 1.15 * max(float(np.max(np.abs(shown.imag))), 0.2 * abs(left))
    return left, right, height


def region_area(region: Region, window: tuple[float, float, float]) -> Area | None:
    """The part of a convex region of poles inside the window, ray by ray from a point well inside; None without any.

    Parameters
    ----------
    window : left and right end of the real axis, and half the height
    """
    left, right, height = window
    middle = _inside(region, left, min(right, 0.0))
    if middle is None:
        return None
    centre = complex(middle, 0.0)
    corners = [complex(x, y) - centre for x in (left, right) for y in (-height, height)]
    angles = np.concatenate([np.linspace(-np.pi, np.pi, RAYS), np.angle(corners)])
    rays = np.exp(1j * np.unique(angles))
    shape = centre + _reach(region, centre, rays, window) * rays
    return Area(
        shape.real.astype(float), shape.imag.astype(float), "asked for", colour(3), 0.12, colour(3), "dash", 0.9
    )


def _reach(region: Region, centre: complex, rays: ComplexArray, window: tuple[float, float, float]) -> FloatArray:
    """How far each ray from `centre` stays inside both the region and the window."""
    left, right, height = window
    across = np.maximum(np.abs(rays.real), 1e-300)
    sides = np.where(rays.real > 0.0, right - centre.real, centre.real - left) / across
    high = np.minimum(sides, height / np.maximum(np.abs(rays.imag), 1e-300))
    low = np.where(contains(region, centre + high * rays), high, 0.0)
    for _ in range(40):
        middle = 0.5 * (low + high)
        inside = contains(region, centre + middle * rays)
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return low


def _inside(region: Region, left: float, right: float) -> float | None:
    """A real point of the region in the window, as far from its ends as possible; None where there is none."""
    points = np.linspace(left, right, 801)[1:-1]
    kept = points[contains(region, points.astype(complex))]
    return float(kept[len(kept) // 2]) if kept.size else None


def _hover(study: LawStudy, key: str) -> tuple[str, ...]:
    return tuple(corner.name for corner in study.corners for _ in getattr(corner, key))
