"""Claims of Secs. 2.1, 3, 4.1 and 4.2: image theory, surge, pitch, kinds of resonance."""

from __future__ import annotations

import math

import numpy as np

from maglev_ctrl.analysis.floquet import floquet
from maglev_ctrl.forces.image import MAGNETIC_CONSTANT
from maglev_ctrl.study.paper import image_theory as theory
from maglev_ctrl.study.paper.evidence import Evidence, judged
from maglev_ctrl.study.paper.magnet_forces import SPEED
from maglev_ctrl.study.paper.records import Claim, ClaimVerdict
from maglev_ctrl.systems import SecondOrderSystem, modulate
from maglev_ctrl.vehicle.models import STANDARD_GRAVITY

_FRACTIONS = {1.0: "1", 1.0 / 3.0: "1/3", 1.0 / 5.0: "1/5"}


def image_claims(evidence: Evidence) -> tuple[Claim, ...]:
    """Claims that need image theory, with this magnet as a second witness where it has one to give."""
    return (
        _drag_peak(evidence), _surge_bracket(), *_surge(), _decoupled(), _heave_frequency(evidence), *_pitch(),
        _resonance(),
    )  # fmt: skip


def _drag_peak(evidence: Evidence) -> Claim:
    peaks = theory.drag_peaks()
    told = "; ".join(f"n = {_FRACTIONS[n]}: {x:.3f} w, eps_D {top:.3f}" for n, x, top in peaks)
    known = evidence.speeds is not None and not math.isnan(evidence.speeds.peak)
    case = evidence.solved.case
    w = 2.0 / (MAGNETIC_CONSTANT * case.conductivity * case.thickness)
    here = "no speed in the force model of this run"
    if known and evidence.speeds is not None:
        here = f"this magnet: {evidence.speeds.peak:.1f} m/s = {evidence.speeds.peak / w:.2f} w, w = {w:.2f} m/s"
    return Claim(
        "drag_peaks", "Sec. 4.1, Eq. 15, Fig. 5",
        "The value of n is 1 for a single conductor and varies from about 1/5 to 1/3 for coils",
        told, here, ClaimVerdict.CORRECTED if known else ClaimVerdict.NOT_TESTABLE,
        f"The drag peak lies at v = w only for n = 1, and at most at {max(x for _, x, _ in peaks):.2f} w for n down to "
        "1/5. A short coil in a corner of thick plates has its own; Eq. 15 is a scoping formula."
        if known else "The curves are as printed; whether they fit a coil needs forces that depend on speed.",
    )  # fmt: skip


def _surge_bracket() -> Claim:
    printed, exact = (float(part) for part in theory.surge_bracket(2.0, 1.0 / 3.0))
    same = [float(part) for part in theory.surge_bracket(2.0, 1.0)]
    return Claim(
        "surge_bracket", "Sec. 4.1, Eq. 22", "C_xx = (w m g / v0^2) [w^2 - (2n - 1) v0^2 / (w^2 + v0^2)] + 2 K_a v0",
        f"bracket at v = 2w (parenthesis mended): n = 1: {same[0]:.4f}; n = 1/3: {printed:+.4f}",
        f"n = 1: {same[1]:.4f}; n = 1/3: {exact:+.4f}; tends to \N{MINUS SIGN}1 at high speed for every n",
        ClaimVerdict.CORRECTED,
        "As printed it is dimensionally impossible; with the parenthesis mended it is exact for n = 1 only, and has "
        "the wrong sign at high speed for n = 1/3 and 1/5.",
    )  # fmt: skip


def _surge() -> tuple[Claim, ...]:
    found = theory.surge_thresholds()
    bare = theory.growth_without_air()
    agree = all(abs(one.vehicle - one.closed) < 1e-4 for one in found)
    printed = "; ".join(
        f"n = {_FRACTIONS[one.exponent]}: " + ("every speed" if math.isnan(one.printed) else f"{one.printed:.2f} m/s")
        for one in found
    )
    exact = f"{found[0].closed:.2f} m/s for every n (20 t, 20 mm sheet, K_a = {theory.AIR:g} kg/m)"
    grows = "; ".join(f"n = {_FRACTIONS[one.exponent]}: {s:+.1e} 1/s" for one, s in zip(found, bare, strict=True))
    always = all(s > 0.0 for s in bare)
    return (
        Claim(
            "surge_exponent", "Sec. 4.1, text of Eq. 27",
            "the vehicle may be unstable if n = 1, and K_a is zero",
            "s = (2n - 1) w g / v0^2: grows for n = 1, decays for n = 1/3 and 1/5",
            f"growth of the assembled vehicle at 100 m/s: {grows}",
            ClaimVerdict.CORRECTED if always else ClaimVerdict.UNRESOLVED,
            "True for every n, not for n = 1 alone: lift is pinned to the weight, so that drag always falls with "
            "speed. The factor 2n - 1 is 1, and 1/m is missing.",
        ),
        Claim(
            "surge_stable", "Sec. 4.1, text of Eq. 27",
            "At high speeds, the second term given in Eq. 27 is larger than the first term regardless of the values of "
            "n; therefore, s is negative and the system is stable",
            f"stable above: {printed}", f"stable above v* = (m w g / 2 K_a)^(1/3) = {exact}",
            judged(agree, ClaimVerdict.CORRECTED),
            "There is such a speed, it does not depend on n, and below it surge grows at constant thrust. Eigenvalues "
            "of the assembled vehicle and the closed form agree." if agree
            else "Eigenvalues of the assembled vehicle and the closed form disagree.",
        ),
    )  # fmt: skip


def _decoupled() -> Claim:
    return Claim(
        "heave_surge_decoupled", "Sec. 4.1, after Eqs. 22 and 25",
        "For high speed vehicles, the values of C_zx and K_xz are approximately zero ... oscillations in the vertical "
        "direction are stable",
        "heave undamped, Re s = 0; surge alone decides",
        f"heave at 100 m/s, n = 1: Re s = {theory.heave_decay():+.1e} 1/s; with receding images (line current) "
        f"{theory.receding_heave_growth():+.1e} 1/s",
        ClaimVerdict.CORRECTED,
        "Each tends to zero, their product does not: it fixes the surge exponent, and is all the damping heave has in "
        "quasi-static theory. What heave's own velocity does needs unsteady forces.",
    )  # fmt: skip


def _heave_frequency(evidence: Evidence) -> Claim:
    model = evidence.solved.force
    forces, slopes = model.forces(12.7e-3, 12.7e-3, SPEED), model.derivatives(12.7e-3, 12.7e-3, SPEED)
    rate = math.sqrt(-float(slopes.by_height.lift) / float(forces.lift) * STANDARD_GRAVITY) / (2.0 * math.pi)
    loop = 12.7e-3 + evidence.solved.case.loop_height
    simple = math.sqrt(STANDARD_GRAVITY / loop) / (2.0 * math.pi)
    assembled = theory.assembled_heave_frequency(theory.HEIGHT)
    eq25 = math.sqrt(STANDARD_GRAVITY / theory.HEIGHT) / (2.0 * math.pi)
    return Claim(
        "heave_frequency", "Sec. 4.1, Eq. 25, Fig. 6",
        "The natural frequency in the vertical direction depends on the levitation height only",
        f"z0 = 100 mm: Eq. 25 {eq25:.4f} Hz, assembled vehicle {assembled:.4f} Hz",
        f"this magnet at h = Y* = 12.7 mm: {rate:.2f} Hz, where Eq. 25 with the loop's height says {simple:.2f} Hz",
        ClaimVerdict.CORRECTED,
        "Right for a force that falls as 1/z, a long coil near the track. A short coil's force falls faster, and its "
        "frequency depends on its size as well.",
    )  # fmt: skip


def _pitch() -> tuple[Claim, ...]:
    long, square, tall = (theory.pitch_ratio(r) for r in (1e-3, 1.0, 1.5))
    needed = theory.slenderness_of_printed_square()
    where = "Sec. 4.2, text of Eq. 35"
    return (
        Claim(
            "pitch_long", where, "For a long vehicle (h \N{MUCH LESS-THAN} L) f_p is equal to about 1.7 f_v",
            "Eq. 35: sqrt(3) = 1.732", f"assembled vehicle: {long:.4f}",
            ClaimVerdict.HOLDS if abs(long - math.sqrt(3.0)) < 1e-4 else ClaimVerdict.UNRESOLVED,
            "With magnets at the ends, as the paper assumes.",
        ),
        Claim(
            "pitch_square", where, "For a square vehicle, f_p = 1.4 f_v", "Eq. 35 itself: sqrt(3/2) = 1.2247",
            f"assembled vehicle: {square:.4f}",
            ClaimVerdict.FALSE if abs(square - math.sqrt(1.5)) < 1e-6 else ClaimVerdict.UNRESOLVED,
            f"A slip of arithmetic: 1.4 needs h/L = {needed:.3f}.",
        ),
        Claim(
            "pitch_above_heave", where,
            "The natural frequency of pitching oscillations is larger than vertical oscillations",
            "Eq. 35: only for h < sqrt(2) L", f"assembled vehicle with h = 1.5 L: f_p = {tall:.3f} f_v",
            ClaimVerdict.CORRECTED if tall < 1.0 else ClaimVerdict.UNRESOLVED,
            "Not for a tall vehicle, and never when the lift is spread evenly along it.",
        ),
    )  # fmt: skip


def modulated_growth(ratio: float, *, depth: float = 0.3) -> float:
    """Growth rate (1/s) of an undamped oscillator of 1 rad/s whose stiffness is modulated at `ratio` rad/s.

    Parameters
    ----------
    ratio : modulation frequency over natural frequency
    depth : of the modulation

    Examples
    --------
    >>> modulated_growth(2.0) > 0.07, modulated_growth(2.6) < 1e-9
    (True, True)
    """
    K = np.eye(1)
    plant = SecondOrderSystem.from_matrices(np.eye(1), np.zeros((1, 1)), K, dofs=("car.heave",))
    return float(floquet(modulate(plant, depth * K[None], 0.0 * K[None], frequency=ratio)).growth_rate)


def _resonance() -> Claim:
    rates = {ratio: modulated_growth(ratio) for ratio in (2.0, 1.0, 0.5)}
    told = ", ".join(f"{ratio:g}: {abs(rate):.4f}" for ratio, rate in rates.items())
    return Claim(
        "resonance", "Sec. 3, after Eq. 14",
        "When the period of a motion-dependent magnetic force is a multiple of one of the natural frequencies of the "
        "vehicle, the vehicle may be dynamically unstable",
        "a period is compared with a frequency; read as periods, Omega = omega_i/k",
        f"Omega = 2 omega_i/k and (omega_i \N{PLUS-MINUS SIGN} omega_j)/k; growth by Floquet theory, 30 % modulation, "
        f"Omega/omega = {told} 1/s",
        ClaimVerdict.CORRECTED if rates[2.0] > 2.0 * max(rates[1.0], rates[0.5]) else ClaimVerdict.UNRESOLVED,
        "Frequencies, not periods, and the strongest tongue, at twice the natural frequency, is missing from a reading "
        "by periods.",
    )  # fmt: skip
