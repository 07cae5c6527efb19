"""Formulas from one small source: the same composition writes MathML, Typst, LaTeX and words read aloud.

A formula is put together from symbols, fractions, scripts and sums; every piece carries its four forms, so that the
page, the paper, the plain text and the screen reader can never show different equations.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

_GREEK: Final = {
    "alpha": "\u03b1", "delta": "\u03b4", "lambda": "\u03bb", "mu": "\u03bc", "xi": "\u03be", "sigma": "\u03c3",
    "omega": "\u03c9", "Phi": "\u03a6", "Omega": "\u03a9", "Sigma": "\u03a3",
}  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class Formula:
    """A piece of a formula in its four forms.

    mathml : presentation MathML elements; typst : math mode; latex : without dollar signs; words : as it is read aloud
    """

    mathml: str
    typst: str
    latex: str
    words: str


@dataclass(frozen=True, eq=False, slots=True)
class _Operator:
    """An operator as each form writes it."""

    sign: str
    typst: str
    latex: str
    words: str


_OPERATORS: Final[dict[str, _Operator]] = {
    "=": _Operator("=", "=", "=", "equals"),
    "+": _Operator("+", "+", "+", "plus"),
    "-": _Operator("\N{MINUS SIGN}", "-", "-", "minus"),
    "+-": _Operator("±", "plus.minus", r"\pm", "plus or minus"),
    "<": _Operator("&lt;", "<", "<", "is less than"),
    "<=": _Operator("≤", "<=", r"\le", "is at most"),
    ">": _Operator("&gt;", ">", ">", "is greater than"),
    "(": _Operator("(", "(", "(", "open bracket"),
    ")": _Operator(")", ")", ")", "close bracket"),
    "|": _Operator("|", "|", r"\lvert ", "the modulus of"),
    "/|": _Operator("|", "|", r"\rvert ", ""),
    ",": _Operator(",", ",", ",", ","),
    "iff": _Operator("⟺", "<==>", r"\iff", "exactly when"),
}


def sign(name: str) -> Formula:
    """An operator or bracket by its plain name.

    Examples
    --------
    >>> sign("<=").mathml, sign("<=").latex
    ('<mo>≤</mo>', '\\\\le')
    """
    one = _OPERATORS[name]
    bracket = ' stretchy="false"' if name in ("(", ")", "|", "/|") else ""
    typst = rf"\{one.typst}" if name in ("(", ")") else one.typst  # an escaped bracket needs no partner
    return Formula(f"<mo{bracket}>{one.sign}</mo>", typst, one.latex, one.words)


def symbol(name: str, *, bold: bool = False) -> Formula:
    """A letter, Latin or Greek by its name; bold for matrices and vectors.

    Examples
    --------
    >>> symbol("lambda").mathml, symbol("M", bold=True).typst
    ('<mi>λ</mi>', 'bold(upright(M))')
    """
    letter = _GREEK.get(name, name)
    latex = rf"\{name}" if name in _GREEK else name
    spoken = f"capital {name}" if name[0].isupper() else name
    if bold:
        return Formula(
            f'<mi mathvariant="normal" class="matrix">{letter}</mi>', f"bold(upright({name}))", rf"\mathbf{{{latex}}}",
            f"matrix {name}" if name[0].isupper() else f"vector {name}",
        )  # fmt: skip
    return Formula(f"<mi>{letter}</mi>", name, latex, spoken)


def digits(text: str) -> Formula:
    """A number."""
    return Formula(f"<mn>{text}</mn>", text, text, text)


def named(text: str) -> Formula:
    """An upright name such as that of a function: Im, ln, max.

    Examples
    --------
    >>> named("Im").typst
    'op("Im")'
    """
    return Formula(f'<mi mathvariant="normal">{text}</mi>', f'op("{text}")', rf"\operatorname{{{text}}}", text)


def row(*parts: Formula | str) -> Formula:
    """Pieces side by side; a text is the name of an operator.

    Examples
    --------
    >>> row(symbol("a"), "=", digits("1")).words
    'a equals 1'
    """
    made = [part if isinstance(part, Formula) else sign(part) for part in parts]
    words = " ".join(part.words for part in made if part.words)
    return Formula(
        "<mrow>" + "".join(part.mathml for part in made) + "</mrow>", " ".join(part.typst for part in made),
        " ".join(part.latex for part in made), words,
    )  # fmt: skip


def over(top: Formula, bottom: Formula) -> Formula:
    """A fraction."""
    return Formula(
        f"<mfrac>{top.mathml}{bottom.mathml}</mfrac>", f"frac({top.typst}, {bottom.typst})",
        rf"\frac{{{top.latex}}}{{{bottom.latex}}}", f"the fraction {top.words} over {bottom.words}, end of fraction",
    )  # fmt: skip


def under(base: Formula, index: Formula) -> Formula:
    """A letter with an index."""
    return Formula(
        f"<msub>{base.mathml}{index.mathml}</msub>", f"{base.typst}_({index.typst})",
        f"{base.latex}_{{{index.latex}}}", f"{base.words} sub {index.words}",
    )  # fmt: skip


def power(base: Formula, exponent: Formula, *, spoken: str = "") -> Formula:
    """A letter with an exponent; `spoken` where it is read in another way, such as a transpose."""
    return Formula(
        f"<msup>{base.mathml}{exponent.mathml}</msup>", f"{base.typst}^({exponent.typst})",
        f"{base.latex}^{{{exponent.latex}}}", f"{base.words} {spoken or f'to the power {exponent.words}'}",
    )  # fmt: skip


def transposed(base: Formula) -> Formula:
    """A matrix transposed."""
    return power(
        base, Formula('<mi mathvariant="normal">T</mi>', "upright(T)", r"\mathsf{T}", "T"), spoken="transposed"
    )


def adjoint(base: Formula) -> Formula:
    """A vector conjugated and transposed."""
    mark = Formula('<mi mathvariant="normal">H</mi>', "upright(H)", r"\mathsf{H}", "H")
    return power(base, mark, spoken="conjugate transposed")


def rate(base: Formula, *, order: int = 1) -> Formula:
    """A derivative with respect to time as dots over the letter.

    Examples
    --------
    >>> rate(symbol("q"), order=2).latex
    '\\\\ddot{q}'
    """
    mark, typst, latex, words = {
        1: ("˙", "dot", r"\dot", "rate of"), 2: ("¨", "dot.double", r"\ddot", "second rate of"),
    }[order]  # fmt: skip
    return Formula(
        f'<mover accent="true">{base.mathml}<mo>{mark}</mo></mover>', f"{typst}({base.typst})",
        f"{latex}{{{base.latex}}}", f"{words} {base.words}",
    )  # fmt: skip


def total(index: Formula) -> Formula:
    """The sign of a sum with its index beneath."""
    return Formula(
        f"<munder><mo>∑</mo>{index.mathml}</munder>", f"sum_({index.typst})", rf"\sum_{{{index.latex}}}",
        f"sum over {index.words} of",
    )  # fmt: skip


def largest(index: Formula) -> Formula:
    """The supremum with its index beneath."""
    return Formula(
        f'<munder><mi mathvariant="normal">sup</mi>{index.mathml}</munder>', f"sup_({index.typst})",
        rf"\sup_{{{index.latex}}}", f"largest over {index.words} of",
    )  # fmt: skip


def space() -> Formula:
    """Room between two statements of one line."""
    return Formula('<mspace width="1.6em"/>', "quad", r"\quad", ";")
