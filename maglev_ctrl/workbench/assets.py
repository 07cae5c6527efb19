"""The page's own files and Bokeh's scripts, packed once and kept by the browser as long as they are the same."""

from __future__ import annotations

import gzip
import hashlib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Final

_TYPES: Final = {
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
}
_OWN: Final = ("theme.js", "figures.js", "workbench.js", "controls.js", "editor.js", "workbench.css", "icon.svg")


@dataclass(frozen=True, slots=True)
class Asset:
    """A file for the browser: `packed` with gzip, `tag` its hash."""

    content: bytes
    packed: bytes
    kind: str
    tag: str


@cache
def assets() -> dict[str, Asset]:
    """Every file the page is made of, by name."""
    import bokeh

    from maglev_ctrl.workbench.style import PAGE_STYLE

    scripts = Path(bokeh.__file__).parent / "server" / "static" / "js"
    own = files("maglev_ctrl.workbench").joinpath("templates")
    contents = {name: own.joinpath(name).read_bytes() for name in _OWN}
    contents["workbench.css"] = PAGE_STYLE.encode() + contents["workbench.css"]
    contents |= {name: (scripts / name).read_bytes() for name in SCRIPTS}
    return {name: _asset(name, content) for name, content in contents.items()}


SCRIPTS: Final = ("bokeh.min.js", "bokeh-widgets.min.js")
"""Bokeh's scripts the page loads: no tables, no formulas, no WebGL."""


def _asset(name: str, content: bytes) -> Asset:
    tag = hashlib.sha256(content).hexdigest()[:16]
    return Asset(content, gzip.compress(content, 6, mtime=0), _TYPES[Path(name).suffix], tag)


def page_template() -> str:
    """The page's HTML with its places for addresses and the document."""
    return files("maglev_ctrl.workbench").joinpath("templates", "workbench.html.j2").read_text(encoding="utf-8")
