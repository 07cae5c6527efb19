"""How each number was found, in sentences; what a scenario does not ask for is not explained."""

from __future__ import annotations

from typing import Final

from maglev_ctrl.study.records import Comparison

METHOD: Final = (
    "Every operating point has its own equilibrium: magnet currents or heights are trimmed before the model is "
    "linearised, and no force model is ever asked outside its data.",
    "Stability is read from the eigenvalues of the closed loop with their rounding-error bounds and confirmed by the "
    "inertia of a Lyapunov solution; where the two do not agree the result is unresolved, never stable.",
    "The energy ledger splits each growth rate exactly over the vehicle's elements, into damping and circulatory "
    "parts; the residual of the sum is a check of the eigenpair.",
    "Margins are asked only of stable loops. Disk margins are peaks of closed-loop transfer functions found by "
    "Hamiltonian bisection, not on a frequency grid; delay margins come from exact crossings.",
    "Periodic stability comes from Floquet multipliers, computed by two independent engines (propagators over one "
    "period and Hill's infinite determinant); unstable tongues are named by the modes that meet.",
    "Designs are verified after the solver by closing the loop anew; a solver's own word is never taken.",
    "Force limits of actuators play no part in the linear analysis, where commands grow in proportion to the motion "
    "without end. They are checked where the scenario gives [irregularity], by three standard deviations of the force, "
    "and enforced in the nonlinear check.",
    "The resonance map of an option with actuator delay may merge delay and bandwidth into one lag of the same phase "
    "at low frequency (its figure names the map's method); numbers that decide a requirement use the full model.",
    "An equilibrium holds the height, trimming the magnet currents at every point, or holds the magnet strength, and "
    "then the height follows from the balance; the equilibrium table of each option says which.",
    "A verdict is PASS, FAIL or NOT EVALUATED. What could not be computed or confirmed is NOT EVALUATED and never "
    "counts as passed. A margin in per cent is the distance from the limit divided by the limit.",
)  # fmt: skip
RIDE: Final = (
    "The ride is the stationary response to the guideway's irregularity as a Gaussian process, the rear meeting what "
    "the front met before it: variances from covariance (Lyapunov) equations, confirmed by an adaptive integral over "
    "frequency; where the two do not agree the number is unresolved. Weightings and classes of comfort are those of "
    "ISO 2631-1.",
    "A gap or stroke is used up by three standard deviations and the sag of the girders together. Crossings follow "
    "Rice's formula, and the probability of contact in an hour takes them as independent (Poisson).",
    "Supplied power is the mean of the positive part of force times stroke velocity, for a supply that takes nothing "
    "back; losses of the actuators themselves are not in it.",
)
ROBUSTNESS: Final = (
    "Worst cases take every uncertain parameter for constant but unknown within its spread. The guaranteed factor is a "
    "proof (structured singular value), the found factor and the worst values come from a search and are replayed "
    "on the model assembled anew; the true factor lies between the two.",
)
NONLINEAR: Final = (
    "The nonlinear check integrates the equations of motion with the full force map, delays and limits over several "
    "random guideways of the same spectrum. It confirms linear numbers within a confidence band, or says that it does "
    "not; that no contact was seen is no proof that there is none.",
)
TUNING: Final = (
    "All options are tuned by the same method with the same budget against the same objectives. A front holds the "
    "candidates that no other betters; candidates that miss a hard requirement are left out of it. The ranking is by "
    "distance to the ideal point of all fronts, and it is told how firm it is when limits and weights change.",
)


def method_words(comparison: Comparison) -> tuple[str, ...]:
    """The sentences that this comparison needs."""
    options = comparison.options
    return (
        *METHOD,
        *(RIDE if any(o.ride is not None for o in options) else ()),
        *(ROBUSTNESS if any(o.robustness is not None for o in options) else ()),
        *(NONLINEAR if any(o.nonlinear is not None for o in options) else ()),
        *(TUNING if comparison.tuning is not None else ()),
    )


def not_asked(comparison: Comparison) -> str:
    """What no option has and no option gives a reason for: the scenario has no such table; "" where it asks for all."""
    options = comparison.options
    parts = (
        ("periodic forcing and its resonances ([periodic])", [(o.floquet, o.floquet_reason) for o in options]),
        ("ride, gaps and actuators ([irregularity])", [(o.ride, o.ride_reason) for o in options]),
        ("worst cases within spreads ([uncertainty])", [(o.robustness, o.robustness_reason) for o in options]),
        ("the nonlinear check ([simulation])", [(o.nonlinear, o.nonlinear_reason) for o in options]),
    )
    return "; ".join(name for name, found in parts if not any(done is not None or why for done, why in found))
