"""Claims about the magnet's forces: Sec. 2 and Figs. 3 and 4."""

from __future__ import annotations

import math

from maglev_ctrl.study.paper.evidence import Evidence
from maglev_ctrl.study.paper.records import Claim, ClaimVerdict, Extreme

NOTICED = 1e-3  # m: a minimum that moves by less stays where it is
NEAR = 0.1  # an extreme that moves by less than this share of what the other leg moves it is not caused by the leg


def force_claims(evidence: Evidence) -> tuple[Claim, ...]:
    """Extremes of the guidance force and their causes, lower speeds, reciprocity, measured data."""
    return (
        _maximum(evidence), _minimum(evidence), _cause(evidence), _lower_speeds(evidence), _four_stiffnesses(evidence),
        *_unsteady(evidence), _measured(),
    )  # fmt: skip


def _place(extreme: Extreme) -> str:
    other = "Y*" if extreme.along == "height" else "h"
    at = "none" if math.isnan(extreme.at) else f"{1e3 * extreme.at:.1f} mm ({extreme.force:.3f} N)"
    return f"{other} = {1e3 * extreme.fixed:g} mm: {at}"


def _maximum(evidence: Evidence) -> Claim:
    found = [one for one in evidence.extremes["default"] if one.kind == "maximum"]
    every = all(not math.isnan(one.at) for one in found)
    return Claim(
        "guidance_maximum", "Sec. 2.3, Figs. 3e, 3f",
        "a maximum occurs in the variation of the guidance force with respect to variations in height at a fixed gap, "
        "... that is caused by the corner region of the guideway",
        "maximum of F_G(h) at " + "; ".join(_place(one) for one in found),
        "the same: forces do not depend on the vehicle's kinematics",
        ClaimVerdict.HOLDS if every else ClaimVerdict.FALSE,
        "A perfectly conducting corner with endless legs, which has no edge, has such a maximum too (16.9 mm at "
        "Y* = 12.7 mm): far above the lift leg only the lateral leg repels, near the corner both legs' images cancel "
        "in part.",
    )  # fmt: skip


def _minimum(evidence: Evidence) -> Claim:
    found = [one for one in evidence.extremes["default"] if one.kind == "minimum"]
    every = all(not math.isnan(one.at) for one in found)
    return Claim(
        "guidance_minimum", "Sec. 2.3, Figs. 3g, 3h",
        "a minimum occurs in the variation of the guidance force with respect to variations in the gap at a fixed "
        "height",
        "minimum of F_G(Y*) at " + "; ".join(_place(one) for one in found),
        "the same: forces do not depend on the vehicle's kinematics",
        ClaimVerdict.HOLDS if every else ClaimVerdict.FALSE,
        "Beyond it the guidance force grows with the gap: k_gg > 0, a guidance that pushes the wrong way."
        if every else "The force model of this run has no free edges, and no minimum.",
    )  # fmt: skip


def _cause(evidence: Evidence) -> Claim:
    quote = "... that is caused by the edge of the lateral leg of the guideway"
    where, key = "Sec. 2.3, Figs. 3g, 3h", "cause_of_minimum"
    if not {"long_wall", "long_floor"} <= set(evidence.extremes):
        why = "The guideways with one leg lengthened were not solved in this run."
        return Claim(key, where, quote, "not computed", "not computed", ClaimVerdict.NOT_TESTABLE, why)
    told, moved = [], {}
    for name, words in (("long_wall", "lateral leg"), ("long_floor", "lift leg")):
        shifts = []
        for before, after in zip(evidence.extremes["default"], evidence.extremes[name], strict=True):
            if before.kind == "minimum":
                shifts.append(math.inf if math.isnan(after.at) else abs(after.at - before.at))
                there = "no minimum any more" if math.isnan(after.at) else f"minimum at {1e3 * after.at:.1f} mm"
                told.append(f"{words} doubled, h = {1e3 * before.fixed:g} mm: {there}")
        moved[name] = shifts
    if any(math.isnan(one.at) for one in evidence.extremes["default"] if one.kind == "minimum"):
        why = "The force model of this run has no minimum whose cause could be asked for."
        return Claim(key, where, quote, "; ".join(told), "the same", ClaimVerdict.NOT_TESTABLE, why)
    floor_does = all(f > NOTICED and w < NEAR * f for w, f in zip(moved["long_wall"], moved["long_floor"], strict=True))
    wall_does = all(w > NOTICED and f < NEAR * w for w, f in zip(moved["long_wall"], moved["long_floor"], strict=True))
    verdict = ClaimVerdict.FALSE if floor_does else ClaimVerdict.HOLDS if wall_does else ClaimVerdict.CORRECTED
    neither = max(*moved["long_wall"], *moved["long_floor"]) <= NOTICED
    why = (
        "Each leg was doubled in turn. The minimum answers to the free edge of the lift leg, towards which the magnet "
        "moves as the gap widens, and not to the edge of the lateral leg." if floor_does
        else "Each leg was doubled in turn; the minimum follows the lateral leg." if wall_does
        else "Each leg was doubled in turn; the minimum follows neither." if neither
        else "Each leg was doubled in turn; the minimum follows both."
    )  # fmt: skip
    return Claim(key, where, quote, "; ".join(told), "the same", verdict, why)


def _lower_speeds(evidence: Evidence) -> Claim:
    quote = (
        "The qualitative trends in the lift and guidance force data taken at lower velocities ... are the same as "
        "shown in Figs. 3a-3h for the highest velocity tested"
    )
    if not evidence.slow_extremes:
        why = "The force model of this run does not depend on speed."
        return Claim("lower_speeds", "Sec. 2.3", quote, "not computed", "not computed", ClaimVerdict.NOT_TESTABLE, why)
    told = [
        f"{speed:g} m/s: " + ", ".join(
            f"{one.kind} at " + ("none" if math.isnan(one.at) else f"{1e3 * one.at:.1f} mm") for one in found
        )
        for speed, found in evidence.slow_extremes.items()
    ]  # fmt: skip
    every = all(not math.isnan(one.at) for found in evidence.slow_extremes.values() for one in found)
    return Claim(
        "lower_speeds", "Sec. 2.3", quote, "; ".join(told), "the same",
        ClaimVerdict.HOLDS if every else ClaimVerdict.CORRECTED,
        "Order: maxima at Y* = 5 and 12.7 mm, minima at h = 7 and 12.7 mm."
        + ("" if every else " Not every extreme lies inside the range of heights and gaps at the lower speeds."),
    )  # fmt: skip


def _four_stiffnesses(evidence: Evidence) -> Claim:
    small = evidence.reciprocity < 1e-3
    return Claim(
        "four_stiffnesses", "Sec. 2.3, Fig. 4",
        "All elements of magnetic stiffness k_ll, k_lg, k_gl and k_gg, were calculated",
        "four curves from two polynomial fits, k_lg and k_gl independent of each other",
        f"k_lg = k_gl {evidence.reciprocity_words}",
        ClaimVerdict.CORRECTED if small else ClaimVerdict.UNRESOLVED,
        "Only three are independent. On a guideway uniform along the track lift and guidance are the gradient of one "
        "scalar at a fixed speed, eddy-current losses notwithstanding, so that k_lg = k_gl. Separate fits of two "
        "measured forces break this." if small else "The force model breaks reciprocity; its map is too coarse.",
    )  # fmt: skip


def _unsteady(evidence: Evidence) -> tuple[Claim, ...]:
    speeds = evidence.speeds
    heave_quote = "negative damping occurs for velocities greater than the characteristic velocity"
    surge_quote = "C_xx = w m g / v0^2 [w^2 - (2n - 1) v0^2 / (w^2 + v0^2)]: for n = 1 negative beyond the drag peak"
    heave_where, surge_where = "Sec. 1 (Davis and Wilkie)", "Sec. 4.1, Eq. 22"
    if speeds is None or not speeds.unsteady_speed.size:
        why = "The force model of this run has no unsteady forces."
        return tuple(
            Claim(key, where, quote, "not computed", "not computed", ClaimVerdict.NOT_TESTABLE, why)
            for key, where, quote in (
                ("heave_damping", heave_where, heave_quote), ("surge_damping", surge_where, surge_quote),
            )
        )  # fmt: skip
    surge, heave = speeds.damping[:, 0], speeds.damping[:, 2]
    v = speeds.unsteady_speed
    at = int(abs(v - 36.1).argmin())
    beyond = v > speeds.peak + 1.0
    before = v < speeds.peak - 1.0
    changes = bool((surge[beyond] > 0.0).all() and (surge[before] < 0.0).all())
    never = bool((heave < 0.0).all())
    hertz = speeds.frequency / (2.0 * math.pi)
    return (
        Claim(
            "heave_damping", heave_where, heave_quote,
            "thin-track theory: negative above w",
            f"this magnet at {hertz:.0f} Hz: c between {heave.min():.3f} and {heave.max():.3f} N s/m from {v[0]:g} to "
            f"{v[-1]:g} m/s ({heave[at]:+.3f} at {v[at]:g}); positive would be negative damping",
            ClaimVerdict.FALSE if never else ClaimVerdict.CORRECTED,
            "Not for this magnet, at any speed: it needs a coil wide across the track. A line current over a thin "
            "sheet, two-dimensional, does have it above w." if never else "It occurs, at some speeds only.",
        ),
        Claim(
            "surge_damping", surge_where, surge_quote,
            f"drag peak of this magnet at {speeds.peak:.1f} m/s",
            f"surge at {hertz:.0f} Hz: c = {surge[at]:+.3f} N s/m at {v[at]:g} m/s; positive is negative damping",
            ClaimVerdict.HOLDS if changes else ClaimVerdict.CORRECTED,
            "Below the drag peak surge is damped, beyond it its damping is negative, at fixed height. A vehicle that "
            "is free to rise is surge-unstable in a wider range: see the claims on Eq. 27.",
        ),
    )  # fmt: skip


def _measured() -> Claim:
    return Claim(
        "measured_values", "Sec. 2.3, Figs. 3 and 4",
        "Figures 3a-3h show those measured forces ... our experimental error, estimated at \N{PLUS-MINUS SIGN}5%",
        "curves lost in the scan", "curves lost in the scan", ClaimVerdict.NOT_TESTABLE,
        "All forces here are computed, not measured. They can be held against the measurement only through what the "
        "text says of the curves, and through Table 1.",
    )  # fmt: skip
