"""The gallery: a card for every scenario file, and a page with the file's text.

A scenario that cannot be read or whose laws do not exist fails the build.
"""

from __future__ import annotations

from collections.abc import Iterator
from html import escape
from pathlib import Path
from typing import Any

from docutils import nodes
from gallery_pictures import ROOT, looked_for, pictures, scenario_files
from pygments import highlight
from pygments.formatters import HtmlFormatter
from pygments.lexers import TOMLLexer
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.util.docutils import SphinxDirective

from maglev_ctrl.errors import MaglevError
from maglev_ctrl.scenario import load

HEADINGS = {
    "compare": ("Options compared", "report"),
    "periodic": ("Guideways with a period", "map"),
    "design": ("Control laws, designed and proved", "design"),
    "paper": ("Vehicles of the paper", "report"),
}
"""What stands over the cards of each folder, and the command such scenarios are for."""


class Gallery(SphinxDirective):
    """Sections of cards, one section for each folder of scenarios."""

    has_content = False

    def run(self) -> list[nodes.Node]:
        """Build the sections."""
        drawn: dict[Path, str] = self.env.maglev_gallery  # type: ignore[attr-defined]
        sections: list[nodes.Node] = []
        for folder, (heading, verb) in HEADINGS.items():
            section = nodes.section(ids=[nodes.make_id(heading)])
            section += nodes.title(heading, heading)
            self.state.document.note_implicit_target(section, section)
            cards = [card(path, drawn[path], verb) for path in drawn if path.parent.name == folder]
            section += nodes.raw("", f'<div class="gallery">{"".join(cards)}</div>', format="html")
            sections.append(section)
        for path in drawn:
            self.env.note_dependency(str(path))
        return sections


def picture_role(
    name: str, rawtext: str, text: str, lineno: int, inliner: Any, options: Any = None, content: Any = ()
) -> tuple[list[nodes.Node], list[nodes.system_message]]:
    """The picture of one scenario, such as `compare/eds_135t`, linked to its card."""
    drawn: dict[Path, str] = inliner.document.settings.env.maglev_gallery
    path = ROOT / "scenarios" / f"{text}.toml"
    if path not in drawn:
        message = inliner.reporter.error(f"no scenario {text!r} for a picture", line=lineno)
        return [inliner.problematic(rawtext, rawtext, message)], [message]
    link = f'<a class="picture" href="gallery.html#{escape(path.stem)}">{drawn[path]}</a>'
    return [nodes.raw("", link, format="html")], []


def card(path: Path, picture: str, verb: str) -> str:
    """One scenario: title, picture, what to look for, how to run it."""
    scenario = load(path)
    name = path.relative_to(ROOT).as_posix()
    points = looked_for(path.read_text(encoding="utf-8"))
    listed = "".join(f"<li>{code_words(point)}</li>" for point in points)
    told = f"<details open><summary>What to look for</summary><ol>{listed}</ol></details>" if points else ""
    return (
        f'<article class="card" id="{escape(path.stem)}">'
        f'<h3><a href="{escape(page_name(path))}.html">{escape(scenario.title)}</a></h3>'
        f"<figure>{picture}</figure>"
        f"{told}<pre>python3 dev.py {verb} {escape(name)}</pre></article>"
    )


def code_words(text: str) -> str:
    """Text of a comment as HTML, `code` in backquotes."""
    parts = escape(text).split("`")
    return "".join(f"<code>{part}</code>" if k % 2 else part for k, part in enumerate(parts))


def page_name(path: Path) -> str:
    """The page that holds a scenario's text."""
    return path.relative_to(ROOT).with_suffix("").as_posix()


def draw(app: Sphinx) -> None:
    """Compute the pictures before any page is read."""
    try:
        app.env.maglev_gallery = pictures(Path(app.outdir).parent / "gallery")  # type: ignore[attr-defined]
    except MaglevError as fault:
        raise ExtensionError(f"gallery: {fault}") from fault


def scenario_pages(app: Sphinx) -> Iterator[tuple[str, dict[str, Any], str]]:
    """A page with the text of every scenario file."""
    formatter = HtmlFormatter(linenos="inline", lineanchors="line")
    for path in scenario_files():
        name = path.relative_to(ROOT).as_posix()
        code = highlight(path.read_text(encoding="utf-8"), TOMLLexer(), formatter)
        up = "../" * page_name(path).count("/")
        body = (
            f"<h1>{escape(name)}</h1>"
            f"<p>{escape(load(path).title)}. "
            f'Its card in the <a href="{up}gallery.html#{escape(path.stem)}">gallery</a>; '
            f'every key in the <a href="{up}reference/scenario.html">reference of scenario files</a>.</p>{code}'
        )
        yield page_name(path), {"title": name, "body": body, "parents": []}, "page.html"


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directive and the pages."""
    app.add_directive("scenario-gallery", Gallery)
    app.add_role("scenario-picture", picture_role)
    app.connect("env-before-read-docs", lambda app, env, names: draw(app))
    app.connect("html-collect-pages", scenario_pages)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
