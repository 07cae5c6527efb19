"""Claims about the double-L vehicle: Sec. 4.4, Figs. 10 to 15, Table 1, and the classification after Eq. 14."""

from __future__ import annotations

from typing import Final

import numpy as np

from maglev_ctrl.study.paper.cases import HEIGHT_RANGE
from maglev_ctrl.study.paper.double_l import closed_matrices, damped_growth, equal_damping_that_ends_flutter
from maglev_ctrl.study.paper.evidence import Evidence, judged, ranges_words, within
from maglev_ctrl.study.paper.records import MODELS, Claim, ClaimVerdict, Model
from maglev_ctrl.study.paper.table1 import PRINTED, ratios

WINDOW: Final = (19e-3, 35e-3)  # of the flutter in Fig. 10 as the text gives it, m
READING: Final = 1e-3  # m: the window is given in whole millimetres, read off a curve
GAPS_OF_FIG_15: Final = (10e-3, 15e-3, 20e-3, 25e-3)
TABLE_TOLERANCE: Final = 0.1  # on v3/v1: forces were measured to 5 per cent, ratios of stiffnesses to worse
OVERDAMPED: Final = 2.0


def double_l_claims(evidence: Evidence) -> tuple[Claim, ...]:
    """Flutter, divergence, mode shapes and what damping does to them."""
    return (
        _flutter(evidence), _flutter_at_small_gap(evidence), _flutter_from_maximum(evidence),
        _roll_divergence(evidence),
        _heave(evidence), *_divergence(evidence), _only_at_25(evidence), _divergence_from_minimum(evidence),
        _damping(evidence), _table_1(evidence), _eigenvalue_words(), _classification(evidence), _roll_yaw(),
    )  # fmt: skip


def _flutter_words(evidence: Evidence, key: str, models: tuple[Model, ...]) -> str:
    told = []
    for model in models:
        flutter = ranges_words(evidence.ranges(key, model, "flutter"))
        divergence = ranges_words(evidence.ranges(key, model, "divergence"), high=HEIGHT_RANGE[1])
        name = f"{model}: " if len(models) > 1 else ""
        told.append(f"{name}flutter {flutter}" + ("" if divergence == "none" else f", divergence {divergence}"))
    return "; ".join(told)


def _flutter_verdict(evidence: Evidence, key: str) -> ClaimVerdict:
    consistent = [evidence.ranges(key, model, "flutter") for model in ("C", "CG")]
    reduced = evidence.ranges(key, "P", "flutter")
    if not any(consistent):
        verdict = ClaimVerdict.FALSE
    else:
        verdict = ClaimVerdict.CORRECTED if reduced != consistent[1] else ClaimVerdict.HOLDS
    return judged(evidence.resolved(key), verdict)


def _why_no_flutter(evidence: Evidence, key: str) -> str:
    unresolved = evidence.reasons(key)
    if unresolved:
        return unresolved
    return (
        "Magnets that sit a below the centre of mass move sideways by a theta when the vehicle rolls; Eq. 43 leaves "
        "that out, which makes the stiffness circulatory. With it, reciprocity (k_lg = k_gl, here "
        f"{evidence.reciprocity_words}) makes the stiffness symmetric, and no coupled-mode flutter is "
        "possible at any height."
    )


def _flutter(evidence: Evidence) -> Claim:
    close = within(evidence.ranges("fig10", "P", "flutter"), WINDOW, READING)
    start = "The paper's window is reproduced to its reading accuracy. " if close else ""
    return Claim(
        "flutter_12p7", "Sec. 4.4, Fig. 10",
        "Within range of height h = 19.0 mm to 35 mm, the imaginary parts of eigenvalues appear not to be zero. This "
        "result indicates within this range the flutter does exist",
        _flutter_words(evidence, "fig10", ("P",)), _flutter_words(evidence, "fig10", ("C", "CG")),
        _flutter_verdict(evidence, "fig10"), start + _why_no_flutter(evidence, "fig10"),
    )  # fmt: skip


def _flutter_at_small_gap(evidence: Evidence) -> Claim:
    return Claim(
        "flutter_5", "Sec. 4.4, Fig. 12",
        "When fixing the guidance gaps to be g1 = g2 = Y* = 5 mm, the same results are obtained as shown in Fig. 12, "
        "there is a flutter for coupled roll-yaw modes",
        _flutter_words(evidence, "fig12", ("P",)), _flutter_words(evidence, "fig12", ("C", "CG")),
        _flutter_verdict(evidence, "fig12"), _why_no_flutter(evidence, "fig12"),
    )  # fmt: skip


def _flutter_from_maximum(evidence: Evidence) -> Claim:
    found = [one for one in evidence.extremes["default"] if one.kind == "maximum"]
    told = []
    for one, key in zip(found, ("fig12", "fig10"), strict=True):
        window = evidence.ranges(key, "P", "flutter")
        if window:
            told.append(f"Y* = {1e3 * one.fixed:g} mm: maximum {1e3 * one.at:.1f} mm, flutter from "
                        f"{1e3 * window[0][0]:.1f} mm")  # fmt: skip
    verdict = _flutter_verdict(evidence, "fig10")
    return Claim(
        "flutter_from_maximum", "Sec. 2.3",
        "the first feature [the maximum of F_G(h)] is associated with a flutter", "; ".join(told) or "no flutter",
        "the maximum is there, the flutter is not", verdict,
        "In the paper's equations flutter needs k_gl (a k_gg - b k_lg) > 0, heights above the maximum. The sign of "
        "k_gl decides nothing once a theta is in the equations.",
    )  # fmt: skip


def _roll_divergence(evidence: Evidence) -> Claim:
    seen = {key: evidence.ranges(key, "CG", "divergence") for key in ("fig10", "fig12")}
    words = "; ".join(
        f"Y* = {gap} mm: {ranges_words(seen[key], high=HEIGHT_RANGE[1])}"
        for key, gap in (("fig12", "5"), ("fig10", "12.7"))
    )
    hidden = any(seen.values()) and not any(evidence.ranges(key, "P", "divergence") for key in seen)
    return Claim(
        "heights_are_stable", "Sec. 4.4, Figs. 10 and 12",
        "Within range of height h = 19.0 mm to 35 mm, the imaginary parts of eigenvalues appear not to be zero",
        "zero at all other heights: no divergence over height", f"roll-sway divergence, CG, {words}",
        judged(evidence.resolved("fig10", "fig12"), ClaimVerdict.FALSE if hidden else ClaimVerdict.HOLDS),
        "The centre of mass stands above its supports, and the guidance forces preload the roll: -(a m g + b (G1 + "
        "G2)) is missing in the paper's roll stiffness. The torque on the tilted magnet itself is in neither model."
        if hidden else "No divergence over height in any model.",
    )  # fmt: skip


def _heave(evidence: Evidence) -> Claim:
    coupling = 0.0
    for gap in (5e-3, 12.7e-3):
        for model in MODELS:
            _, K = closed_matrices(evidence.line(gap), np.linspace(*HEIGHT_RANGE, 9), model)
            size = np.max(np.abs(np.diagonal(K, axis1=-2, axis2=-1)))
            coupling = max(
                coupling, float(np.max(np.abs(K[:, 0, 1:])) / size), float(np.max(np.abs(K[:, 1:, 0])) / size)
            )
    _, off = closed_matrices(evidence.line(25e-3, height=12.7e-3), 5e-3, "P")
    moved = float(np.max(np.abs(off[0, 1:])))
    return Claim(
        "heave_uncoupled", "Sec. 4.4, Fig. 10, Table 1", "The first mode omega_1 shows an uncoupled heave motion",
        f"centred: coupling {coupling:.0e} of the stiffness; off centre it couples (up to {moved:.1f} N/rad or N/m at "
        "5 mm)",
        "the same", ClaimVerdict.CORRECTED if coupling < 1e-12 and moved > 0.0 else ClaimVerdict.UNRESOLVED,
        "Exactly so for the centred vehicle, by symmetry, in every model; not at a lateral offset (Figs. 13 to 15), "
        "and not in Eqs. 49 and 50 as printed, where k_13 is not zero.",
    )  # fmt: skip


def _divergence(evidence: Evidence) -> tuple[Claim, ...]:
    claims = []
    for key, height, words in (("fig13", "12.7", "h = 12.7 mm"), ("fig14", "7", "h = 7 mm")):
        seen = {model: evidence.ranges(key, model, "divergence") for model in MODELS}
        everywhere = all(seen.values())
        claims.append(Claim(
            f"divergence_{key}", f"Sec. 4.4, {key.replace('fig', 'Fig. ')}",
            f"g0 = 25 mm, {words}: the real part is zero and imaginary part is not zero with a certain region. It "
            "indicates that the divergence is subjected to the lateral motion",
            f"offsets {ranges_words(seen['P'])}" + _offset_flutter(evidence, key),
            f"C: {ranges_words(seen['C'])}; CG: {ranges_words(seen['CG'])}",
            judged(evidence.resolved(key), ClaimVerdict.HOLDS if everywhere else ClaimVerdict.FALSE),
            evidence.reasons(key) or (
                "k_gg > 0 at this gap: the guidance force pulls the vehicle further off centre. The determinant of the "
                "roll-sway stiffness is the same with and without a theta."
                if everywhere else f"Not in every model at h = {height} mm."
            ),
        ))  # fmt: skip
    return tuple(claims)


def _offset_flutter(evidence: Evidence, key: str) -> str:
    """What P has besides: a flutter off centre."""
    seen = evidence.ranges(key, "P", "flutter")
    return f"; besides, flutter at {ranges_words(seen)}" if seen else ""


def _only_at_25(evidence: Evidence) -> Claim:
    keys = tuple(f"fig15_{1e3 * gap:.0f}" for gap in GAPS_OF_FIG_15)
    told = {
        model: "; ".join(
            f"g0 = {1e3 * gap:.0f}: {ranges_words(evidence.ranges(key, model, 'divergence'))}"
            for gap, key in zip(GAPS_OF_FIG_15, keys, strict=True)
        )
        for model in MODELS
    }
    only = all(bool(evidence.ranges(key, model, "divergence")) == (key == keys[-1]) for key in keys for model in MODELS)
    flutter = [key for key in keys for model in ("C", "CG") if evidence.ranges(key, model, "flutter")]
    return Claim(
        "divergence_only_25", "Sec. 4.4, Fig. 15",
        "the divergence only appears with the case of g0 = 25 mm", told["P"], f"C: {told['C']}. CG: {told['CG']}",
        judged(evidence.resolved(*keys), ClaimVerdict.HOLDS if only and not flutter else ClaimVerdict.CORRECTED),
        evidence.reasons(*keys) or "At h = 7 mm, with the mass of the centred vehicle and dead loads that supply the "
        "side force and the roll moment of the offset (frozen). Smaller gaps keep k_gg < 0.",
    )  # fmt: skip


def _divergence_from_minimum(evidence: Evidence) -> Claim:
    found = [one for one in evidence.extremes["default"] if one.kind == "minimum"]
    inside = [one for one in found if one.at < 25e-3]
    agrees = len(inside) == len(found) and all(evidence.ranges(key, "CG", "divergence") for key in ("fig13", "fig14"))
    known = all(not np.isnan(one.at) for one in found)
    places = "; ".join(
        f"h = {1e3 * one.fixed:g} mm: " + ("no minimum" if np.isnan(one.at) else f"minimum at {1e3 * one.at:.1f} mm")
        for one in found
    )
    return Claim(
        "divergence_from_minimum", "Sec. 2.3",
        "the second [feature, the minimum of F_G(Y*), is associated] with a divergence instability", places,
        "the same: det = 4 b^2 (k_ll k_gg - k_lg k_gl) with and without a theta",
        judged(evidence.resolved("fig13", "fig14"), ClaimVerdict.HOLDS if agrees
               else ClaimVerdict.FALSE if known else ClaimVerdict.NOT_TESTABLE),
        "Beyond the minimum k_gg > 0; with k_ll < 0 the determinant is then negative. g0 = 25 mm lies beyond it, "
        "20 mm does not." if agrees else "The forces of this run have no such minimum below 25 mm.",
    )  # fmt: skip


def _damping(evidence: Evidence) -> Claim:
    quote = "the damping effects were not considered in above analysis"
    grows = []
    for height in (12.7e-3, 7e-3):
        line = evidence.line(25e-3, height=height)
        grows += [damped_growth(line, 0.0, model, OVERDAMPED) for model in MODELS]
    window = evidence.ranges("fig10", "P", "flutter")
    told = "no flutter to damp"
    if window:
        middle = 0.5 * (window[0][0] + window[0][1])
        needed = equal_damping_that_ends_flutter(evidence.line(12.7e-3), middle, "P")
        told = (
            f"the flutter at {1e3 * middle:.1f} mm would end with {100 * needed:.0f} % damping, equal in roll and sway"
        )
    diverges = all(evidence.ranges(key, model, "divergence") for key in ("fig13", "fig14") for model in MODELS)
    if not diverges:
        why = "The forces of this run make no divergence that could be damped."
        return Claim("damping", "Sec. 4.4", quote, told, "no divergence here", ClaimVerdict.NOT_TESTABLE, why)
    stays = min(grows) > 0.0
    return Claim(
        "damping", "Sec. 4.4", quote, told,
        f"divergence at g0 = 25 mm with dampers of {OVERDAMPED:g} times critical: still grows, by "
        f"{min(grows):.2f} to {max(grows):.2f} 1/s",
        judged(stays and evidence.resolved("fig13", "fig14"), ClaimVerdict.CORRECTED),
        "The caveat matters only to the flutter. A negative determinant of the stiffness leaves a growing root "
        "whatever the damping: the divergence can be slowed, not removed.",
    )  # fmt: skip


def _table_1(evidence: Evidence) -> Claim:
    told: dict[Model, list[str]] = {model: [] for model in MODELS}
    errors: list[float] = []
    turned = 0.0
    for table in evidence.modes:
        found = ratios(table)
        words = ", ".join(_complex_words(value) for value in found)
        told[table.model].append(f"h = {1e3 * table.height:.0f}: {words}")
        if table.model != "P":
            continue
        for got, want in zip(found, PRINTED[table.height], strict=True):
            errors.append(abs(abs(got) - abs(want)) if abs(want.imag) > 0.0 else abs(got - want))
            if abs(want.imag) > 0.0:  # which of the conjugate pair was printed is not known
                turned = abs(abs(np.angle(got, deg=True)) - abs(np.angle(want, deg=True)))
    printed = "; ".join(
        f"h = {1e3 * height:.0f}: " + ", ".join(_complex_words(value) for value in pair)
        for height, pair in PRINTED.items()
    )
    kinds = all(
        (abs(table.squared[1].imag) > 0.0) == (table.height == 0.025) for table in evidence.modes if table.model == "P"
    )
    near = kinds and max(errors) < TABLE_TOLERANCE
    compared = (
        f"The paper's equations give the printed ratios, in modulus, within {max(errors):.2f}; at 25 mm the phase "
        f"between sway and roll differs by {turned:.0f} degrees. Forces were measured to 5 %, and ratios of their "
        "slopes to worse. " if near else f"This run's forces miss the printed ratios by up to {max(errors):.2f}. "
    )  # fmt: skip
    return Claim(
        "table_1", "Sec. 4.4, Table 1, Fig. 11", f"v3/v1 of the coupled modes, as printed: {printed}",
        "; ".join(told["P"]), "C: " + "; ".join(told["C"]) + ". CG: " + "; ".join(told["CG"]),
        judged(evidence.resolved("fig10"), ClaimVerdict.CORRECTED if near else ClaimVerdict.FALSE),
        compared + "The two columns at 25 mm are real and imaginary part of one complex vector. The consistent "
        "equations have other, real vectors.",
    )  # fmt: skip


def _complex_words(value: complex) -> str:
    if abs(value.imag) < 1e-9:
        return f"{value.real:.3f}"
    return f"{value.real:.3f}{value.imag:+.3f}i (modulus {abs(value):.3f})"


def _eigenvalue_words() -> Claim:
    return Claim(
        "eigenvalue", "Sec. 4.4, Eq. 51", "where lambda = omega_R + i omega_I",
        "a divergence would have a negative real part, not a zero one", "sqrt(lambda) = omega_R + i omega_I",
        ClaimVerdict.CORRECTED,
        "The eigenvalue of K v = lambda M v is the squared frequency; only its root has real part zero and imaginary "
        "part not zero in a divergence, as the text reads Figs. 13 and 14.",
    )  # fmt: skip


def _classification(evidence: Evidence) -> Claim:
    circulation = {}
    for model in ("P", "C"):
        _, K = closed_matrices(evidence.line(12.7e-3), np.linspace(15e-3, 37e-3, 23), model)
        circulation[model] = float(np.max(np.abs(K[:, 2, 1] - K[:, 1, 2])) / np.max(np.abs(K[:, 1, 2])))
    reciprocal = evidence.reciprocity < 1e-3
    return Claim(
        "classification", "Sec. 3, after Eq. 14",
        "Magnetic Stiffness Controlled Instability (coupled mode flutter): The dominant terms are associated with the "
        "antisymmetric stiffness matrix [K_2]",
        f"K_2 of roll and sway up to {100 * circulation['P']:.0f} % of their coupling: 2 a k_gg, from the kinematics "
        "alone",
        f"K_2 up to {100 * circulation['C']:.1g} %: none",
        ClaimVerdict.CORRECTED if reciprocal else ClaimVerdict.UNRESOLVED,
        "The classification is sound, but the magnets of a guideway uniform along the track have no K_2 in heave, sway "
        "and roll: the class is empty there. M_2 belongs beside C_1 and K_2 as not conservative.",
    )  # fmt: skip


def _roll_yaw() -> Claim:
    return Claim(
        "roll_yaw", "Sec. 1 (Moon; Chu and Moon; MIT) and Sec. 4.4",
        "sway-yaw instabilities; coupled yaw-lateral vibration; the pitch-heave instability",
        "no yaw or pitch in the double-L model", "no yaw or pitch in the double-L model", ClaimVerdict.NOT_TESTABLE,
        "Three freedoms, heave, roll and sway, are modelled; what the text calls roll-yaw is roll-sway. Yaw, pitch and "
        "surge are not covered by the reciprocity that excludes flutter here.",
    )  # fmt: skip
