"""The views of a page in its document: shown together, each in the place the page's HTML gives it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

from bokeh.core.properties import String
from bokeh.model import DataModel

from maglev_ctrl.workbench.style import dress, theme_switch
from maglev_ctrl.workbench.views.comparison import WAITING, ComparisonView
from maglev_ctrl.workbench.views.cursor import Cursor
from maglev_ctrl.workbench.views.eigenvalues import EigenvalueView
from maglev_ctrl.workbench.views.ledger import LedgerView
from maglev_ctrl.workbench.views.map import MapView
from maglev_ctrl.workbench.views.margins import MarginsView
from maglev_ctrl.workbench.views.shape import ShapeView

if TYPE_CHECKING:
    from maglev_ctrl.study.live.records import LiveComparison, LiveView
    from maglev_ctrl.workbench.views.downloads import FileKind, Which

PLACE = "place:"
"""How the tag of a root begins that says which place of the page is its own."""


class Bridge(DataModel):  # type: ignore[misc]
    """What the page's own script and the server say to each other, one JSON text at a time."""

    inbox = String(default="")
    outbox = String(default="")


class Arrangement:
    """Every view of one page and its `bridge` to the browser; made ahead, and put into the page's document later."""

    def __init__(self) -> None:
        cursor = Cursor()
        self._document: Any = None
        self._cursor, self.bridge = cursor, Bridge(name="bridge")
        self._view: LiveView | None = None
        self._comparison: LiveComparison | None = None
        self._live: dict[str, EigenvalueView | MapView | LedgerView | ShapeView | MarginsView] = {
            "eigenvalues": EigenvalueView(cursor), "map": MapView(cursor), "ledger": LedgerView(cursor),
            "shape": ShapeView(cursor), "margins": MarginsView(),
        }  # fmt: skip
        self._compared = ComparisonView()
        for figure in self._figures():
            dress(figure, False)
        self._switch = theme_switch(self._figures())
        self._switch.name = "theme-switch"

    def _figures(self) -> list[Any]:
        views: list[Any] = [*self._live.values(), self._compared]
        return [figure for view in views for figure in view.figures]

    def attach(self, document: Any) -> None:
        """Put everything into a document, which looks through all of it once."""
        self._document = document
        with document.models.freeze():
            places: list[tuple[str, Any]] = [*self._live.items(), ("comparison", self._compared)]
            for place, view in places:
                view.root.tags = [*view.root.tags, PLACE + place]
                document.add_root(view.root)  # in the order of the places: Bokeh counts roots
            for model in (self._cursor.source, self.bridge, self._switch):
                document.add_root(model)
        if hasattr(document.config, "notify_connection_status"):  # the page tells it by itself, and loads itself again
            document.config.notify_connection_status = document.config.reconnect_session = False

    def show(self, view: LiveView) -> None:
        """Draw a view in every figure, in one go; the map of one that is still followed stays as it is."""
        if not view.following:
            self._view = view
        self._document.hold("combine")
        try:
            self._cursor.move(speed=view.speed, depth=view.depth)
            for place, one in self._live.items():
                if not (view.following and place == "map"):
                    one.show(view)
        finally:
            self._document.unhold()

    def compare(self, comparison: LiveComparison) -> None:
        """Draw the comparison of the options."""
        self._comparison = comparison
        self._document.hold("combine")
        try:
            if self._compared.draw():
                self._switch.args = theme_switch(self._figures()).args
            self._compared.show(comparison, "" if self._view is None else self._view.option)
        finally:
            self._document.unhold()

    def forget_comparison(self) -> None:
        """Another scenario has other options."""
        if self._comparison is not None:
            self._comparison = None
            self._compared.clear(WAITING)

    def clear(self, reason: str) -> None:
        """Nothing to show, and why."""
        self._view = self._comparison = None
        self._document.hold("combine")
        try:
            views: list[Any] = [*self._live.values(), self._compared]
            for one in views:
                one.clear(reason)
        finally:
            self._document.unhold()

    def file(self, which: str, kind: str) -> bytes:
        """A view as a file to download.

        Raises
        ------
        ValueError : in words, why there is none
        """
        from maglev_ctrl.workbench.views.downloads import figure_files

        shown = self._comparison if which == "comparison" else self._view
        if shown is None:
            raise ValueError("nothing is shown there yet")
        named = cast("Which", which), cast("FileKind", kind)  # the server's patterns know no others
        return figure_files(shown, *named, mode=max(self._cursor.mode, 0))
