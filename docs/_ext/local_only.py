"""The built site is whole and local: nothing is loaded from outside, and no link into the site leads nowhere.

Both are looked for in the pages as they were written, whatever made them. A finding fails the build.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

from sphinx.application import Sphinx
from sphinx.errors import ExtensionError

OUTSIDE = re.compile(r"\s*(?:[a-z][a-z0-9+.-]*:)?//", re.IGNORECASE)
LOADED = ("src", "srcset", "poster", "background", "data", "action", "formaction", "manifest")
NAMED_ONLY = {"canonical", "alternate", "author", "license", "next", "prev", "index", "search", "help"}
"""Relations of a link element that browsers do not follow by themselves."""
IN_STYLE = re.compile(r"url\(\s*['\"]?([^'\")]+)|@import\s+['\"]([^'\"]+)", re.IGNORECASE)
IN_SCRIPT = re.compile(r"""["'`](?:https?|wss?):?//(?!www\.w3\.org/)[^"'`\s]*|["'`]//[\w-]+\.[\w.-]+/""")


@dataclass(slots=True)
class Page(HTMLParser):
    """What a page loads, where it links to, and the places in it that can be linked to."""

    loads: list[str] = field(default_factory=list)
    links: list[str] = field(default_factory=list)
    anchors: set[str] = field(default_factory=set)
    within: str = ""

    def __post_init__(self) -> None:
        HTMLParser.__init__(self, convert_charrefs=True)

    def __hash__(self) -> int:
        return id(self)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Collect what one element refers to."""
        given = {name: value or "" for name, value in attrs}
        self.anchors |= {given[name] for name in ("id", "name") if name in given}
        self.loads += [place for name in LOADED if name in given for place in given[name].split(",")]
        for name in ("href", "xlink:href"):
            if name not in given:
                continue
            relations = set(given.get("rel", "").lower().split())
            if tag in ("a", "area"):
                self.links.append(given[name])
            elif tag != "link" or not relations <= NAMED_ONLY:
                self.loads.append(given[name])
        self.loads += style_loads(given.get("style", ""))
        if tag == "meta" and given.get("http-equiv", "").lower() == "refresh":
            self.loads.append(given.get("content", "").partition("=")[2])
        if tag in ("script", "style"):
            self.within = tag

    def handle_endtag(self, tag: str) -> None:
        """Leave a script or a style."""
        if tag == self.within:
            self.within = ""

    def handle_data(self, data: str) -> None:
        """Look into scripts and styles."""
        if self.within == "style":
            self.loads += style_loads(data)
        elif self.within == "script":
            self.loads += script_loads(data)


def style_loads(text: str) -> list[str]:
    """Addresses that a style sheet loads."""
    return [first or second for first, second in IN_STYLE.findall(text)]


def script_loads(text: str) -> list[str]:
    """Addresses on other machines that a script holds as text, namespaces left out."""
    bare = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
    return [found.strip("\"'`") for found in IN_SCRIPT.findall(bare)]


def read_page(text: str) -> Page:
    """A page's loads, links and anchors."""
    page = Page()
    page.feed(text)
    page.close()
    return page


def read_site(folder: Path) -> dict[Path, Page]:
    """Every page of a built site."""
    return {path: read_page(path.read_text(encoding="utf-8")) for path in sorted(folder.rglob("*.html"))}


def outside_loads(folder: Path, pages: dict[Path, Page]) -> Iterator[str]:
    """Everything in a built site that a browser would fetch from another machine: page and address."""
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path in pages:
            loads = pages[path].loads
        elif path.suffix == ".css":
            loads = style_loads(path.read_text(encoding="utf-8"))
        elif path.suffix == ".js":
            loads = script_loads(path.read_text(encoding="utf-8"))
        else:
            continue
        yield from (f"{name}: loads {place.strip()}" for place in loads if OUTSIDE.match(place))


def dead_links(folder: Path, pages: dict[Path, Page]) -> Iterator[str]:
    """Links of a built site to pages, files or places in pages that are not there: page and link."""
    for path, page in pages.items():
        for link in dict.fromkeys(page.links):
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            target = target / "index.html" if target.is_dir() else target
            name = path.relative_to(folder).as_posix()
            if not target.exists():
                yield f"{name}: no such page: {link}"
            elif parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].anchors:
                yield f"{name}: no such place: {link}"


def check(app: Sphinx, problem: Exception | None) -> None:
    """Fail a build that loads from outside or has dead links."""
    if problem is not None or app.builder.format != "html":
        return
    folder = Path(app.outdir).resolve()
    pages = read_site(folder)
    found = [*outside_loads(folder, pages), *dead_links(folder, pages)]
    if found:
        raise ExtensionError("the site is not whole and local:\n  " + "\n  ".join(found))


def setup(app: Sphinx) -> dict[str, object]:
    """Register the check."""
    app.connect("build-finished", check, priority=900)  # after the theme has written its files
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
