"""The equations that a study's numbers come from, each with its place in the paper or the theory pages."""

from __future__ import annotations

from typing import Final

from maglev_ctrl.report.formula import (
    Formula,
    adjoint,
    digits,
    largest,
    named,
    over,
    power,
    rate,
    row,
    space,
    symbol,
    total,
    transposed,
    under,
)
from maglev_ctrl.report.model import Block, Equation, Passage, Reference
from maglev_ctrl.report.style import SIGMA
from maglev_ctrl.study.records import Comparison

MOTION: Final = "equation:motion"
LEDGER: Final = "equation:ledger"
SHARES: Final = "equation:shares"
LYAPUNOV: Final = "equation:lyapunov"
DISK: Final = "equation:disk"
DISK_PEAK: Final = "equation:disk-peak"
FLOQUET: Final = "equation:floquet"
RESONANCE: Final = "equation:resonance"
VARIANCE: Final = "equation:variance"

_A, _M, _C, _K, _P = (symbol(name, bold=True) for name in "AMCKP")
_Q, _F, _S, _Z, _I = (symbol(name, bold=True) for name in "QFSZI")
_SHAPE, _MOTION, _STATE = (symbol(name, bold=True) for name in "aqx")
_GROWTH, _CIRCULAR, _ELEMENT = symbol("lambda"), symbol("omega"), symbol("e")
_ONE, _TWO, _ZERO = digits("1"), digits("2"), digits("0")


def _of(matrix: Formula, part: Formula) -> Formula:
    """The symmetric (1) or antisymmetric (2) part of an element's matrix."""
    return under(matrix, row(part, _ELEMENT))


def _form(inner: Formula) -> Formula:
    return row(adjoint(_SHAPE), inner, _SHAPE)


def _motion() -> Formula:
    return row(_M, rate(_MOTION, order=2), "+", _C, rate(_MOTION), "+", _K, _MOTION, "=", _F, symbol("xi", bold=True))


def _ledger() -> Formula:
    return row(
        _GROWTH, "=", total(_ELEMENT), "(", under(_GROWTH, row(named("d"), ",", _ELEMENT)), "+",
        under(_GROWTH, row(named("c"), ",", _ELEMENT)), ")", space(), symbol("n"), "=", _TWO, _CIRCULAR,
        _form(under(_M, _ONE)), "+", named("Im"), _form(under(_C, _TWO)),
    )  # fmt: skip


def _shares() -> Formula:
    damping = row(_CIRCULAR, _form(_of(_C, _ONE)), "+", _form(row(named("Im"), _of(_Z, _ONE))))
    turning = row(
        named("Im"), _form(_of(_K, _TWO)), "+", "(", power(_GROWTH, _TWO, spoken="squared"), "-",
        power(_CIRCULAR, _TWO, spoken="squared"), ")", named("Im"), _form(_of(_M, _TWO)), "+", named("Im"),
        _form(row(named("Re"), _of(_Z, _TWO))),
    )  # fmt: skip
    n = symbol("n")
    return row(
        under(_GROWTH, row(named("d"), ",", _ELEMENT)), "=", "-", over(damping, n), space(),
        under(_GROWTH, row(named("c"), ",", _ELEMENT)), "=", "-", over(turning, n),
    )  # fmt: skip


def _lyapunov() -> Formula:
    return row(
        transposed(_A), _P, "+", _P, _A, "=", "-", _Q, space(), _Q, ">", _ZERO, space(), named("Re"),
        under(symbol("s"), symbol("k")), "<", _ZERO, "iff", _P, ">", _ZERO,
    )  # fmt: skip


def _disk() -> Formula:
    delta, sigma = under(symbol("delta"), symbol("k")), symbol("sigma")
    return row(
        under(symbol("f"), symbol("k")), "=",
        over(row(_TWO, "+", "(", _ONE, "-", sigma, ")", delta), row(_TWO, "-", "(", _ONE, "+", sigma, ")", delta)),
        space(), "|", delta, "/|", "<", symbol("alpha"),
    )  # fmt: skip


def _disk_peak() -> Formula:
    sigma, at = symbol("sigma"), row("(", named("j"), _CIRCULAR, ")")
    inner = row(_S, at, "+", over(row(sigma, "-", _ONE), _TWO), _I)
    inverse = row(largest(_CIRCULAR), symbol("mu"), "(", inner, ")")
    return row(over(_ONE, symbol("alpha")), "=", inverse)


def _floquet() -> Formula:
    period, k, mu = symbol("T"), symbol("k"), symbol("mu")
    return row(
        rate(_STATE), "=", _A, "(", symbol("t"), ")", _STATE, space(), _A, "(", symbol("t"), "+", period, ")", "=", _A,
        "(", symbol("t"), ")", space(), _STATE, "(", period, ")", "=", symbol("Phi", bold=True), _STATE, "(", _ZERO,
        ")", space(), under(_GROWTH, k), "=", over(row(named("ln"), "|", under(mu, k), "/|"), period),
    )  # fmt: skip


def _resonance() -> Formula:
    return row(
        under(_CIRCULAR, symbol("i")), "+-", under(_CIRCULAR, symbol("j")), "=", symbol("k"), symbol("Omega"), space(),
        symbol("Omega"), "=", over(row(_TWO, Formula("<mi>π</mi>", "pi", r"\pi", "pi"), symbol("v")), symbol("L")),
    )  # fmt: skip


def _variance() -> Formula:
    spread, entry = symbol("Sigma", bold=True), symbol("B", bold=True)
    return row(
        _A, spread, "+", spread, transposed(_A), "+", entry, transposed(entry), "=", _ZERO, space(),
        power(under(symbol("sigma"), symbol("y")), _TWO, spoken="squared"), "=", _C, spread, transposed(_C),
    )  # fmt: skip


def _stated(target: str, formula: Formula, before: str, source: str, after: tuple[str | Reference, ...]) -> list[Block]:
    key = target.partition(":")[2]
    return [Passage((before,)), Equation(key, formula, source), Passage(after)]


def equation_blocks(comparison: Comparison) -> list[Block]:
    """The equations behind the kinds of number that this comparison holds, each introduced and explained."""
    options = comparison.options
    blocks = _stated(
        MOTION, _motion(), "Small motion about an equilibrium, with internal states ξ of lags, actuators and laws:",
        "paper, Eqs. (10) to (12), signs corrected",
        ("An eigenvalue s = λ + jω of it is a mode: λ is its growth rate, ω its circular frequency.",),
    )  # fmt: skip
    blocks += _stated(
        LEDGER, _ledger(), "The energy ledger splits the growth rate of a mode of shape a over the elements e:",
        "paper, Eqs. (13) and (14)",
        ("into a damping part (d) and a circulatory part (c); n divides both in ", Reference(SHARES), "."),
    )  # fmt: skip
    blocks += _stated(
        SHARES, _shares(), "The two parts are, with 1 for the symmetric and 2 for the antisymmetric part of a matrix:",
        "paper, Eqs. (13) and (14)",
        ("Z is the dynamic stiffness of an element with internal states. Nothing is left out: the residual of ",
         Reference(LEDGER), " is told in report.json."),
    )  # fmt: skip
    blocks += _stated(
        LYAPUNOV, _lyapunov(), "Stability is confirmed without eigenvalues, by the inertia of a Lyapunov solution:",
        "theory, Stability", ("If P has a negative direction the system is unstable, whatever its eigenvalues say.",),
    )  # fmt: skip
    if any(o.margins is not None for o in options):
        blocks += _stated(
            DISK, _disk(), "A disk margin multiplies every channel k by a complex factor of gain and phase at once:",
            "Seiler, Packard and Gahinet, 2020",
            (f"with the skew {SIGMA}, 0 where nothing else is said. Its size is the inverse of a peak:",),
        )  # fmt: skip
        blocks += [
            Equation("disk-peak", _disk_peak(), "Seiler, Packard and Gahinet, 2020"),
            Passage(("S is the sensitivity and μ the structured singular value. The worst perturbation is the one "
                     "that reaches it: put into the loop it leaves a pole on the axis.",)),
        ]  # fmt: skip
    if any(o.floquet is not None for o in options):
        blocks += _stated(
            FLOQUET, _floquet(), "Periodic forces with the period T = L/v of a guideway of wavelength L at speed v:",
            "theory, Floquet", ("Unstable where an eigenvalue μ of Φ (a Floquet multiplier) has |μ| > 1.",),
        )  # fmt: skip
        blocks += _stated(
            RESONANCE, _resonance(),
            "A tongue begins where a multiple of the forcing's frequency is the sum or difference of two modes':",
            "paper, text after Eq. (14), corrected",
            ("i = j is parametric resonance, i ≠ j combination resonance; the order of a tongue is k.",),
        )  # fmt: skip
    if any(o.ride is not None for o in options):
        blocks += _stated(
            VARIANCE, _variance(), "The ride's variances are exact, from the loop's states together with the filter "
            "that shapes the irregularity from white noise:", "theory, Ride",
            (f"Σ is the covariance of the states and {SIGMA} the standard deviation of a signal y.",),
        )  # fmt: skip
    return blocks
