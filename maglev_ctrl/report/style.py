"""One look for every figure: a colour-blind-safe palette in a fixed order, dashes, font sizes, number formats."""

from __future__ import annotations

import math
from typing import Any, Final, Literal

MINUS: Final = "\N{MINUS SIGN}"
ABSENT: Final = "\N{EN DASH}"
ALPHA: Final = "\N{GREEK SMALL LETTER ALPHA}"
SIGMA: Final = "\N{GREEK SMALL LETTER SIGMA}"
TIMES: Final = "\N{MULTIPLICATION SIGN}"

Dash = Literal["solid", "dash", "dot", "dashdot"]
Ramp = Literal["viridis", "growth", "decay"]
Symbol = Literal["circle", "square", "diamond", "cross", "triangle", "open_circle"]

INK: Final = "#1b1b1b"
GRID: Final = "#d9d9d9"
PAPER: Final = "#ffffff"
FADED: Final = "#8a8a8a"
PASS_COLOUR: Final = "#009e73"
FAIL_COLOUR: Final = "#d55e00"
UNKNOWN_COLOUR: Final = "#8a8a8a"
ON_MAP: Final = "#000000"  # ink on the light colours of a map, whatever the page's theme; legends show it as ink

# Okabe and Ito (2008): told apart with every common colour blindness; yellow comes last, it is weak on white paper.
# Brown and violet follow, so that ten options side by side all have a colour of their own.
PALETTE: Final = (
    "#1b1b1b", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#f0e442", "#7f4f24", "#6a3d9a",
)  # fmt: skip
_SAFE: Final = 8  # colours told apart with every colour blindness; lines beyond them are dashed
DASHES: Final[tuple[Dash, ...]] = ("solid", "dash", "dashdot", "dot")

# Colours of maps from low to high, each with even steps of lightness. Growth (matplotlib's inferno from its light end)
# is warm and strong, decay cool and faint: they differ in hue for every colour blindness and in strength on grey paper.
RAMPS: Final[dict[Ramp, tuple[str, ...]]] = {
    "viridis": ("#440154", "#482878", "#3e4989", "#31688e", "#26828e", "#1f9e89", "#35b779", "#6ece58", "#b5de2b",
                "#fde725"),
    "growth": ("#fbe44b", "#fcb418", "#f98c0a", "#ec6826", "#d24644", "#ad305d", "#84206b", "#5a116e", "#2f0a5b"),
    "decay": ("#f2f6fa", "#e3ecf4", "#d4e2ee", "#c4d7e7", "#b4cce0", "#a3c0d9"),
}  # fmt: skip

WIDTH: Final = 6.69  # in: 17 cm, the text width of an A4 page
FONT_SIZE: Final = 8.0  # pt at print size
FONT_FAMILY: Final = "DejaVu Sans"

RC: Final[dict[Any, Any]] = {
    "font.family": FONT_FAMILY,
    "font.size": FONT_SIZE,
    "axes.titlesize": FONT_SIZE + 0.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": FONT_SIZE,
    "xtick.labelsize": FONT_SIZE - 0.5,
    "ytick.labelsize": FONT_SIZE - 0.5,
    "legend.fontsize": FONT_SIZE - 0.5,
    "legend.frameon": False,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.4,
    "hatch.linewidth": 0.6,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "savefig.facecolor": "none",
    "svg.fonttype": "none",
    "text.parse_math": False,  # labels come from scenario files: a dollar sign is a dollar sign
    "path.simplify_threshold": 0.3,
}


def colour(order: int) -> str:
    """Colour of the option or mode with this place in its list.

    Examples
    --------
    >>> colour(1) == colour(11)
    True
    """
    return PALETTE[order % len(PALETTE)]


def curve_colour(order: int) -> str:
    """Colour of a curve beside limits drawn in `FAIL_COLOUR` and sums drawn in ink: neither of the two.

    Examples
    --------
    >>> [curve_colour(order) for order in range(2)]
    ['#0072b2', '#009e73']
    """
    left = [tint for tint in PALETTE if tint not in (INK, FAIL_COLOUR)]
    return left[order % len(left)]


def dash(order: int) -> Dash:
    """Line style that keeps apart what shares a colour.

    Examples
    --------
    >>> dash(0), dash(8)
    ('solid', 'dash')
    """
    return DASHES[(order // _SAFE) % len(DASHES)]


def number(value: float, unit: str = "", *, digits: int = 3) -> str:
    """A number to `digits` significant digits with its unit, for tables and labels.

    Examples
    --------
    >>> number(138.8889, "m/s"), number(float("nan")), number(float("inf"), "dB"), number(0.00001234, "1/s")
    ('139 m/s', '–', '∞ dB', '1.23e−5 1/s')
    >>> number(0.315, "m/s^2")
    '0.315 m/s²'
    """
    if math.isnan(value):
        return ABSENT
    if math.isinf(value):
        text = "∞" if value > 0 else f"{MINUS}∞"
    elif value == 0.0:
        text = "0"
    else:
        size = math.floor(math.log10(abs(value)))
        if -4 <= size < 6:
            text = f"{value:.{max(0, digits - 1 - size)}f}"
        else:
            mantissa, _, exponent = f"{value:.{digits - 1}e}".partition("e")
            text = f"{mantissa}e{int(exponent)}"
        text = text.replace("-", MINUS)
    return f"{text} {unit_words(unit)}".rstrip()


def unit_words(unit: str) -> str:
    """A unit as people write it.

    Examples
    --------
    >>> unit_words("m/s^2")
    'm/s²'
    """
    return unit.replace("^2", "²")


def tick_text(value: float, step: float) -> str:
    """A tick's number with as many decimals as its step needs.

    Examples
    --------
    >>> tick_text(-0.5, 0.25), tick_text(1500.0, 500.0)
    ('−0.50', '1500')
    """
    if step <= 0.0:
        return f"{value:g}".replace("-", MINUS)
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    if abs(step * 10**decimals - round(step * 10**decimals)) > 1e-6:
        decimals += 1
    text = f"{value:.{decimals}f}" if decimals <= 5 else f"{value:.2g}"
    return (text if float(text) != 0.0 else text.replace("-", "")).replace("-", MINUS)
