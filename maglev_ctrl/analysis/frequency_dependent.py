"""Is the quasi-static theory adequate for a vehicle whose magnets depend on frequency? Two methods must agree.

Every mode is computed quasi-statically, by p-k iteration (which uses Q itself) and from the rational fit's internal
states (whose eigenvalues need no iteration), and where the force model takes complex frequencies by Newton's method
on det D(s), which is exact. What they disagree by, or what their own error bounds add up to, is the mode's margin; a
mode whose margin is too large beside its growth rate is UNRESOLVED, and nothing is concluded from it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from maglev_ctrl.analysis.modes import Modes, StabilityVerdict, modes
from maglev_ctrl.analysis.p_k import PKMode, exact_root, fit_error, p_k_modes, quasi_static_modes
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import Agreement
from maglev_ctrl.vehicle.unsteady import WELL_DAMPED, UnsteadyVehicle


@dataclass(frozen=True, eq=False, slots=True)
class UnsteadyMode:
    """One mode by every method; eigenvalues in 1/s.

    `quasi_static`; `p_k` and its `p_k_error`, `p_k_classical` before the correction for growth; `rational` and its
    `rational_error`; `exact`, None unless asked for and found; `margin` 1/s: the largest difference between the
    unsteady methods or the sum of their errors; `agreement`; `verdict` of this mode; `adequate`: whether the
    quasi-static growth rate has the right sign and lies within the stated share, None where that is unresolved;
    `compared` False for a well-damped mode above the band, which is left out of the judgement; `note` says why a mode
    is unresolved or left out.
    """

    label: str
    quasi_static: complex
    p_k: complex
    p_k_classical: complex
    p_k_error: float
    iterations: int
    rational: complex
    rational_error: float
    exact: complex | None
    margin: float
    agreement: Agreement
    verdict: StabilityVerdict
    adequate: bool | None
    compared: bool
    note: str

    @property
    def s(self) -> complex:
        """The eigenvalue to quote: the exact one, else the rational fit's."""
        return self.rational if self.exact is None else self.exact


@dataclass(frozen=True, eq=False, slots=True)
class UnsteadyComparison:
    """Quasi-static against frequency-dependent magnets, mode by mode.

    `verdict` of the vehicle with frequency-dependent magnets, `quasi_static_verdict` without; `adequate`: the
    quasi-static theory gives the same verdict, and growth rates within `share`; None = UNRESOLVED. `agreement` is
    the largest margin of a resolved mode relative to its growth rate. `augmented` the modes of the augmented system,
    those of the eddy currents among them.
    """

    modes: tuple[UnsteadyMode, ...]
    verdict: StabilityVerdict
    quasi_static_verdict: StabilityVerdict
    adequate: bool | None
    agreement: float
    share: float
    band: tuple[float, float]
    order: int
    residual: float
    static_mismatch: float
    augmented: Modes

    @property
    def critical(self) -> int:
        """Index of the compared mode that grows fastest (or decays slowest)."""
        growth = [one.s.real if one.compared else -np.inf for one in self.modes]
        return int(np.argmax(growth))


def compare_unsteady(
    unsteady: UnsteadyVehicle, *, agreement: float = 0.05, share: float = 0.1, complex_frequency: bool = False
) -> UnsteadyComparison:
    """The modes of a vehicle by quasi-static theory, p-k iteration, rational fit and, if asked, exactly.

    Parameters
    ----------
    agreement : largest margin of a resolved mode, relative to its growth rate
    share : largest error of the quasi-static growth rate that is still adequate, relative to the unsteady one
    complex_frequency : whether the force model takes complex frequencies; then the exact root is found too and the
        p-k error, first order in the growth rate, no longer widens the margin

    Raises
    ------
    ValueError : agreement or share that is not positive
    ModelError : the mass matrix is singular
    """
    for name, value in (("agreement", agreement), ("share", share)):
        if not (np.isfinite(value) and value > 0.0):
            raise ValueError(f"{name}: expected a positive number, got {value}")
    base = quasi_static_modes(unsteady)
    followed = p_k_modes(unsteady, start=base)
    augmented = modes(unsteady.augmented)
    bounds = fit_error(unsteady, augmented)
    partner = _partners(followed, augmented)
    judged = []
    for i, one in enumerate(followed):
        k = partner[i]
        rational = complex(augmented.s[k]) if k >= 0 else complex(np.nan, np.nan)
        exact = _exact(unsteady, one, rational) if complex_frequency and one.converged else None
        judged.append(
            _judged(
                one, exact, rational=rational, rational_error=float(bounds[k]) if k >= 0 else np.inf,
                start_error=float(base.error_bound[i]), asked=complex_frequency, band=unsteady.band,
                agreement=agreement, share=share,
            )
        )  # fmt: skip
    verdict = _verdict(judged, augmented)
    return UnsteadyComparison(
        modes=tuple(judged),
        verdict=verdict,
        quasi_static_verdict=base.verdict,
        adequate=_adequate(judged, verdict, base.verdict),
        agreement=agreement,
        share=share,
        band=unsteady.band,
        order=max(fit.order for fit in unsteady.fits),
        residual=max(fit.residual for fit in unsteady.fits),
        static_mismatch=unsteady.static_mismatch,
        augmented=augmented,
    )


def _partners(followed: tuple[PKMode, ...], augmented: Modes) -> list[int]:
    """Which eigenvalue of the augmented system each mode is; each serves once, -1 where none is left."""
    distance: FloatArray = np.abs(np.array([one.s for one in followed])[:, None] - augmented.s[None, :])
    rows, columns = linear_sum_assignment(distance)
    found = [-1] * len(followed)
    for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
        found[row] = column
    return found


def _exact(unsteady: UnsteadyVehicle, one: PKMode, rational: complex) -> complex | None:
    """The exact root beside the p-k one, or beside the rational fit's where p-k led astray."""
    found = exact_root(unsteady, one.shape, one.s)
    if found is None and np.isfinite(rational):
        found = exact_root(unsteady, one.shape, rational)
    return found


def _judged(
    one: PKMode,
    exact: complex | None,
    *,
    rational: complex,
    rational_error: float,
    start_error: float,
    asked: bool,
    band: tuple[float, float],
    agreement: float,
    share: float,
) -> UnsteadyMode:
    s = rational if exact is None else exact
    if exact is None:
        margin = max(abs(one.s - rational), one.error + rational_error)
    else:
        margin = max(abs(exact - rational), rational_error)
    above = not abs(s) <= band[1]
    aside = above and one.converged and one.start.real <= -WELL_DAMPED * abs(one.start)
    note = ""
    if aside:
        note = "well damped and above the band: not compared"
    elif not one.converged:
        note = "p-k iteration did not converge"
    elif above:
        note = f"|s| above the band, which ends at {band[1]:.4g} rad/s"
    elif asked and exact is None:
        note = "no exact root was found beside the p-k one"
    elif not margin <= agreement * abs(s.real):
        note = f"the methods leave {margin:.3g} 1/s, more than {agreement:.3g} of the growth rate"
    resolved = not note
    verdict, adequate = StabilityVerdict.UNRESOLVED, None
    if resolved and abs(s.real) > margin:
        verdict = StabilityVerdict.STABLE if s.real < 0.0 else StabilityVerdict.UNSTABLE
        adequate = _same_growth(one.start.real, s.real, start_error=start_error, margin=margin, share=share)
        if adequate is None:
            note = "the quasi-static error is too near the stated share to tell"
    return UnsteadyMode(
        label=one.label,
        quasi_static=one.start,
        p_k=one.s,
        p_k_classical=one.classical,
        p_k_error=one.error,
        iterations=one.iterations,
        rational=rational,
        rational_error=rational_error,
        exact=exact,
        margin=margin,
        agreement=Agreement.AGREED if resolved else Agreement.UNRESOLVED,
        verdict=verdict,
        adequate=adequate,
        compared=not aside,
        note=note,
    )


def _same_growth(start: float, growth: float, *, start_error: float, margin: float, share: float) -> bool | None:
    """Whether a quasi-static growth rate has the sign and about the size of the true one; None = too near to tell."""
    difference, doubt = abs(start - growth), margin * (1.0 + share) + start_error
    if abs(start) <= start_error or start * growth < 0.0:
        return False
    if difference + doubt <= share * abs(growth):
        return True
    return False if difference - doubt > share * abs(growth) else None


def _verdict(judged: list[UnsteadyMode], augmented: Modes) -> StabilityVerdict:
    """Unstable when one mode surely grows, stable when all surely decay; the augmented system's proof must agree."""
    compared = [one.verdict for one in judged if one.compared]
    if augmented.verdict is StabilityVerdict.UNSTABLE and StabilityVerdict.UNSTABLE in compared:
        return StabilityVerdict.UNSTABLE
    if augmented.verdict is StabilityVerdict.STABLE and all(one is StabilityVerdict.STABLE for one in compared):
        return StabilityVerdict.STABLE
    return StabilityVerdict.UNRESOLVED


def _adequate(judged: list[UnsteadyMode], verdict: StabilityVerdict, quasi_static: StabilityVerdict) -> bool | None:
    each = [one.adequate for one in judged if one.compared]
    if False in each:
        return False
    if None in each or not each or verdict is StabilityVerdict.UNRESOLVED:
        return None
    return verdict is quasi_static
