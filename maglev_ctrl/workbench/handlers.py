"""What the server answers besides the live document: the page, its files, downloads, reports; and who may ask."""

from __future__ import annotations

import asyncio
import json
import mimetypes
from typing import TYPE_CHECKING, Any

from bokeh.server.views.session_handler import SessionHandler
from tornado.web import ErrorHandler, HTTPError, RequestHandler

from maglev_ctrl.errors import MaglevError
from maglev_ctrl.workbench.arrangement import PLACE
from maglev_ctrl.workbench.assets import SCRIPTS, assets, page_template
from maglev_ctrl.workbench.faults import INTERNAL, tell_terminal
from maglev_ctrl.workbench.jobs import FILES
from maglev_ctrl.workbench.site import Site

if TYPE_CHECKING:
    from maglev_ctrl.workbench.page import Page

LIVE = "/live"
"""Where the document's connection is."""
_KNOWN = ("/alive", "/assets/", "/files/", "/reports/")
_REPORT_POLICY = (
    "sandbox allow-scripts allow-downloads; default-src 'none'; script-src 'unsafe-inline'; "
    "style-src 'unsafe-inline'; img-src data: blob:; font-src data:"
)
_KIND_WORDS = {"svg": "SVG", "png": "PNG", "csv": "CSV", "nc": "NetCDF"}
VIEWS = (
    ("eigenvalues", "Eigenvalues", ("svg", "png", "csv", "nc")),
    ("map", "Resonance map", ("svg", "png", "csv", "nc")),
    ("ledger", "Energy ledger", ("svg", "png", "csv", "nc")),
    ("shape", "Mode shape", ("svg", "png", "csv", "nc")),
    ("margins", "Margins and requirements", ("csv", "nc")),
    ("comparison", "Options compared", ("svg", "png", "csv", "nc")),
)
"""The views of the page in their order: name, title, what each can be downloaded as."""


def patterns(site: Site) -> list[tuple[str, type[RequestHandler], dict[str, Any]]]:
    """What the server answers, by path."""
    return [
        ("/", _PageHandler, {"site": site}),
        ("/alive", _Alive, {}),
        (r"/assets/([\w.-]+)", _Assets, {}),
        (r"/files/([\w-]+)/([\w-]+)\.([a-z]+)", _Files, {"site": site}),
        (r"/reports/([\w.-]+)/([\w.]+)", _Reports, {"site": site}),
    ]


class Guarded:
    """Looks at every request before it is answered: only under the page's own name, only what the page needs."""

    hosts: frozenset[str] = frozenset()

    def find_handler(self, request: Any) -> Any:
        """The handler of a request, or a refusal."""
        if request.host.lower() not in self.hosts:
            return self.get_handler_delegate(request, ErrorHandler, {"status_code": 403})  # type: ignore[attr-defined]
        path = request.path
        if path not in ("/", f"{LIVE}/ws") and not path.startswith(_KNOWN):
            return self.get_handler_delegate(request, ErrorHandler, {"status_code": 404})  # type: ignore[attr-defined]
        return super().find_handler(request)  # type: ignore[misc]


class _Careful(RequestHandler):  # type: ignore[misc]
    """Headers that keep other sites out, and words instead of a trace."""

    def set_default_headers(self) -> None:
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("Referrer-Policy", "no-referrer")
        self.set_header("X-Frame-Options", "DENY")
        self.set_header("Cross-Origin-Resource-Policy", "same-origin")
        self.set_header("Cache-Control", "no-store")
        self.clear_header("Server")

    def write_error(self, status_code: int, **details: Any) -> None:
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        words = {403: "Not allowed.", 404: "There is nothing here.", 409: str(self._reason)}
        self.finish(words.get(status_code, INTERNAL) + "\n")

    def log_exception(self, kind: Any, fault: Any, trace: Any) -> None:
        if not isinstance(fault, HTTPError):
            tell_terminal("request")


class _PageHandler(_Careful, SessionHandler):  # type: ignore[misc]
    """The page itself, with a document of its own."""

    def __init__(self, application: Any, request: Any, **options: Any) -> None:
        self.site: Site = options.pop("site")
        context = application._applications[LIVE]
        super().__init__(application, request, application_context=context, bokeh_websocket_path=f"{LIVE}/ws")

    async def get(self) -> None:
        """A new page; what it shows it learns from its own address."""
        from jinja2 import Environment, StrictUndefined

        session = await self.get_session()
        item = {
            "token": session.token,
            "roots": _places(session.document.roots),
        }
        item["root_ids"] = list(item["roots"])
        template = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
        page = template.from_string(page_template()).render(
            address=lambda name: f"/assets/{name}?v={assets()[name].tag}", scripts=SCRIPTS,
            item=json.dumps(item), live=LIVE, views=VIEWS, kind_words=_KIND_WORDS,
        )  # fmt: skip
        host = self.request.host
        self.set_header("Content-Security-Policy", (
            "default-src 'none'; script-src 'self' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
            f"img-src 'self' data: blob:; font-src 'self'; connect-src 'self' ws://{host}; base-uri 'none'; "
            "form-action 'none'; frame-ancestors 'none'"
        ))  # fmt: skip  # Bokeh's callbacks are functions made of text: 'unsafe-eval'
        self.set_header("Content-Type", "text/html; charset=utf-8")
        self.finish(page)


def _places(roots: list[Any]) -> dict[str, str]:
    """Where each root with a place belongs, by its id, in the document's order."""
    found = {}
    for root in roots:
        for tag in root.tags:
            if isinstance(tag, str) and tag.startswith(PLACE):
                found[root.id] = f"host-{tag.removeprefix(PLACE)}"
    return found


class _Alive(_Careful):
    """Whether the server is there, for a page that lost its connection."""

    def get(self) -> None:
        self.set_header("Content-Type", "text/plain")
        self.finish("alive")


class _Assets(_Careful):
    """Scripts and style sheets, packed."""

    def get(self, name: str) -> None:
        found = assets().get(name)
        if found is None:
            raise HTTPError(404)
        self.set_header("Content-Type", found.kind)
        self.set_header("Etag", f'"{found.tag}"')
        self.set_header("Vary", "Accept-Encoding")
        self.set_header(
            "Cache-Control", "max-age=31536000, immutable" if self.get_argument("v", "") == found.tag else "no-cache"
        )
        if self.check_etag_header():
            self.set_status(304)
            self.finish()
        elif "gzip" in self.request.headers.get("Accept-Encoding", ""):
            self.set_header("Content-Encoding", "gzip")
            self.finish(found.packed)
        else:
            self.finish(found.content)


class _Files(_Careful):
    """What a page offers to download: its scenario, its figures, its numbers. The key is the page's own secret."""

    def initialize(self, site: Site) -> None:
        self.site = site

    async def get(self, key: str, which: str, kind: str) -> None:
        page = self.site.pages.get(key)
        if page is None:
            raise HTTPError(404)
        try:
            content = await self._content(page, which, kind)
        except (MaglevError, ValueError) as fault:
            self.set_status(409)
            self.set_header("Content-Type", "text/plain; charset=utf-8")
            self.finish(f"{fault}\n")
            return
        name = f"{page.name}.toml" if which == "scenario" else f"{page.name}-{which}.{kind}"
        self.set_header("Content-Type", _content_type(name))
        self.set_header("Content-Disposition", f'attachment; filename="{_ascii(name)}"')
        self.set_header("Content-Security-Policy", "sandbox; default-src 'none'; style-src 'unsafe-inline'")
        self.finish(content)

    async def _content(self, page: Page, which: str, kind: str) -> bytes:
        if (which, kind) == ("scenario", "toml"):
            return (await asyncio.wrap_future(page.text_now())).encode()
        if kind not in next((kinds for name, _, kinds in VIEWS if name == which), ()):
            raise HTTPError(404)
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self.site.pool, page.arrangement.file, which, kind)


class _Reports(_Careful):
    """Files of the reports made on the page, and no others; a report can do nothing but show itself."""

    def initialize(self, site: Site) -> None:
        self.site = site

    def get(self, folder: str, name: str) -> None:
        found = self.site.jobs.file(folder, name)
        if found is None:
            raise HTTPError(404)
        self.set_header("Content-Type", FILES[name])
        if name == "report.html":
            self.set_header("Content-Security-Policy", _REPORT_POLICY)
        elif name != "report.pdf":
            self.set_header("Content-Disposition", f'attachment; filename="{_ascii(folder)}-{name}"')
        self.finish(found.read_bytes())


def _content_type(name: str) -> str:
    if name.endswith((".toml", ".csv")):
        return "text/plain; charset=utf-8" if name.endswith(".toml") else "text/csv; charset=utf-8"
    return mimetypes.guess_type(name)[0] or "application/octet-stream"


def _ascii(name: str) -> str:
    return "".join(letter if letter.isascii() and (letter.isalnum() or letter in "._-") else "_" for letter in name)
