"""One look for every view of the page, light and dark, switched in the browser without asking the server."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from bokeh.models import ColorBar, ColorMapper, CustomJS, GlyphRenderer, Legend, Plot
from bokeh.models.axes import Axis
from bokeh.models.grids import Grid

from maglev_ctrl.report.style import INK, PALETTE

FONT: Final = 'system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif'
FONT_SIZE: Final = "12px"


@dataclass(frozen=True, slots=True)
class Theme:
    """Colours of one theme: words and strokes, grid, quiet words, good and bad, and those of modes and bodies."""

    ink: str
    grid: str
    faded: str
    paper: str
    good: str
    bad: str
    palette: tuple[str, ...]


# Light: the palette of the printed figures without ink and yellow, which are those of the words and of the paper; the
# light ones darker, so that thin lines stand out from white. Dark: the same hues in the same order, lighter.
_HUES: Final = tuple(tint for tint in PALETTE if tint not in (INK, "#f0e442"))
_DARKER: Final = {"#cc79a7": "#b3588b", "#e69f00": "#b87a00", "#56b4e9": "#2b8cc4", "#009e73": "#00855f"}
LIGHT: Final = Theme(
    ink=INK, grid="#e3e5e8", faded="#5f6670", paper="#ffffff", good="#007a58", bad="#b84a00",
    palette=tuple(_DARKER.get(tint, tint) for tint in _HUES),
)  # fmt: skip
DARK: Final = Theme(
    ink="#e8eaed", grid="#30353c", faded="#a3abb5", paper="#15181c", good="#3fcf9e", bad="#ff9a57",
    palette=("#5aa9e6", "#ff8c4a", "#35c79a", "#e79ac4", "#f2b53c", "#a5d8f7", "#c79a72", "#b79ae0"),
)  # fmt: skip
MARKERS: Final[tuple[str, ...]] = (
    "circle", "square", "diamond", "triangle", "inverted_triangle", "hex", "star", "plus", "x", "cross",
    "asterisk", "circle_dot",
)  # fmt: skip

INKED: Final = "inked"  # tags of glyphs whose colour the theme decides
FADED: Final = "faded"
PAPERED: Final = "papered"
SOLID: Final = "solid"  # with one of them: the face as well
GOOD: Final = "good"
BAD: Final = "bad"


def _variables(one: Theme) -> str:
    roles = ("ink", "grid", "faded", "paper", "good", "bad")
    named = [f"--wb-{role}: {getattr(one, role)};" for role in roles]
    return " ".join(named + [f"--wb-tint-{k}: {tint};" for k, tint in enumerate(one.palette)])


PAGE_STYLE: Final = (
    f":root {{ {_variables(LIGHT)} color-scheme: light; }}\n"
    f':root[data-theme="dark"] {{ {_variables(DARK)} color-scheme: dark; }}\n'
)
"""Style sheet of the page itself: the variables that tables, legends and words in the views are coloured by."""


def theme(*, dark: bool) -> Theme:
    """The colours of a theme.

    Examples
    --------
    >>> theme(dark=False).paper
    '#ffffff'
    """
    return DARK if dark else LIGHT


def dress(figure: Plot, dark: bool) -> None:
    """Give a figure, its axes, legends, scales of colours and themed glyphs the colours of a theme.

    Examples
    --------
    >>> from bokeh.plotting import figure
    >>> drawn = figure()
    >>> dress(drawn, True)
    >>> drawn.xaxis[0].axis_label_text_color == DARK.ink
    True
    """
    for model, names in _tinted(figure):
        for name, role in names.items():
            setattr(model, name, getattr(theme(dark=dark), role))
    for mapper in _mappers(figure):
        mapper.palette = list(theme(dark=dark).palette)


def theme_switch(figures: Sequence[Plot]) -> CustomJS:
    """What a toggle calls to make the page dark (its `active`) and light again, in the browser alone.

    For `toggle.js_on_change("active", theme_switch(figures))`; the root element gets `data-theme`, see `PAGE_STYLE`.
    """
    models: list[Any] = []
    names: list[dict[str, str]] = []
    for figure in figures:
        for model, roles in _tinted(figure):
            models.append(model)
            names.append(roles)
    mappers = [mapper for figure in figures for mapper in _mappers(figure)]
    tints = {name: {role: getattr(one, role) for role in _ROLES} for name, one in (("light", LIGHT), ("dark", DARK))}
    palettes = {"light": list(LIGHT.palette), "dark": list(DARK.palette)}
    return CustomJS(
        args={"models": models, "names": names, "mappers": mappers, "tints": tints, "palettes": palettes},
        code=_SWITCH,
    )  # fmt: skip


_TAGS: Final = {INKED: "ink", FADED: "faded", PAPERED: "paper", GOOD: "good", BAD: "bad"}
_ROLES: Final = ("ink", "grid", "faded", "paper", "good", "bad")
_SWITCH: Final = """
const name = cb_obj.active ? "dark" : "light"
const read = (table, key) => table instanceof Map ? table.get(key) : table[key]
const tint = read(tints, name)
document.documentElement.dataset.theme = name
models.forEach((model, i) => {
  const entries = names[i] instanceof Map ? [...names[i]] : Object.entries(names[i])
  const changes = {}
  for (const [key, role] of entries) changes[key] = key.endsWith("_color") && model.type !== undefined
    && ["Text", "Line", "MultiLine", "Segment", "Scatter", "Quad", "HBar", "Patches"].includes(model.type)
    ? {value: read(tint, role)} : read(tint, role)
  model.setv(changes, {sync: false})
})
for (const mapper of mappers) mapper.setv({palette: read(palettes, name)}, {sync: false})
"""


def _tinted(figure: Plot) -> list[tuple[Any, dict[str, str]]]:
    """Models of a figure and which of their colours belong to which role of the theme."""
    found: list[tuple[Any, dict[str, str]]] = [
        (figure, {"outline_line_color": "grid"}),
        (figure.title, {"text_color": "ink"}),
    ]
    for axis in _parts(figure, Axis):
        found.append((axis, {
            "axis_line_color": "faded", "major_tick_line_color": "faded", "minor_tick_line_color": "grid",
            "major_label_text_color": "ink", "axis_label_text_color": "ink",
        }))  # fmt: skip
    found += [(grid, {"grid_line_color": "grid"}) for grid in _parts(figure, Grid)]
    for legend in _parts(figure, Legend):
        found.append((legend, {"label_text_color": "ink", "title_text_color": "ink"}))
    for bar in _parts(figure, ColorBar):
        found.append((bar, {
            "major_label_text_color": "ink", "title_text_color": "ink", "major_tick_line_color": "faded",
            "bar_line_color": "grid",
        }))  # fmt: skip
    glyphs = [renderer.glyph for renderer in _parts(figure, GlyphRenderer)]
    for model in (*glyphs, *figure.center):
        role = next((role for tag, role in _TAGS.items() if tag in model.tags), None)
        if role is not None:
            found.append((model, dict.fromkeys(_own_colours(model), role)))
    return [
        (model, {name: role for name, role in roles.items() if getattr(model, name) is not None})
        for model, roles in found
    ]  # what is not drawn in one theme is not drawn in the other


def _parts(figure: Plot, kind: type[Any]) -> list[Any]:
    """What stands in a figure itself; `Plot.select` would search every view that a callback links it to."""
    held = (*figure.left, *figure.right, *figure.above, *figure.below, *figure.center, *figure.renderers)
    return [part for part in held if isinstance(part, kind)]


def _own_colours(model: Any) -> tuple[str, ...]:
    """The colours that a theme sets: of words, or of strokes, and of faces where the model is tagged solid."""
    wanted: tuple[str, ...] = ("text_color",) if "text_color" in model.properties() else ("line_color",)
    wanted += ("fill_color",) if SOLID in model.tags else ()
    return tuple(name for name in wanted if name in model.properties())


def _mappers(figure: Plot) -> list[ColorMapper]:
    """Mappers that give modes and bodies their colours; those of maps keep theirs in both themes."""
    found: dict[str, ColorMapper] = {}
    for renderer in _parts(figure, GlyphRenderer):
        for name in ("line_color", "fill_color"):
            spec = getattr(renderer.glyph, name, None)
            mapper = getattr(spec, "transform", None)
            if isinstance(mapper, ColorMapper) and "themed" in mapper.tags:
                found[mapper.id] = mapper
    return list(found.values())
