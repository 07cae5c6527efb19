"""All views of a page together: what they show at once, and what is downloaded of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("bokeh")

from bokeh.document import Document
from live_fixture import live_comparison, live_view

from maglev_ctrl.workbench.arrangement import Arrangement
from maglev_ctrl.workbench.views.cursor import Cursor
from maglev_ctrl.workbench.views.shown import shown_modes


@pytest.fixture
def arranged() -> Arrangement:
    made = Arrangement()
    made.attach(Document())
    made.show(live_view())
    return made


def test_what_is_downloaded_is_of_the_mode_that_was_picked(arranged: Arrangement) -> None:
    found = {}
    for place, one in enumerate(shown_modes(live_view())):
        arranged._cursor.source.data = {**arranged._cursor.source.data, "mode": [place]}  # as the browser sends it
        found[one.label] = arranged.file("shape", "csv").decode()
        assert one.label in arranged.file("shape", "svg").decode().replace("&#x27;", "'")
    assert len(set(found.values())) == len(found) > 2


def test_a_view_that_is_followed_leaves_the_map_and_the_downloads_as_they_are(arranged: Arrangement) -> None:
    before = arranged.file("eigenvalues", "csv")
    view = live_view()
    moved = replace(view, modes=replace(view.modes, s=view.modes.s - 0.125), following=True)
    status, picture = arranged._live["map"].status.text, arranged._live["map"].image.data
    arranged.show(moved)
    drawn = arranged._live["eigenvalues"].marks.data["own_growth"]
    np.testing.assert_allclose(drawn, moved.modes.s[[one.mode for one in shown_modes(moved)]].real)
    assert arranged._live["map"].status.text == status and arranged._live["map"].image.data is picture
    assert arranged.file("eigenvalues", "csv") == before  # of what was whole last
    arranged.show(replace(moved, following=False))
    assert arranged.file("eigenvalues", "csv") != before


def test_the_comparison_is_dressed_with_the_others_when_it_comes(arranged: Arrangement) -> None:
    before = len(arranged._switch.args["models"])
    arranged.compare(live_comparison())
    own = arranged._compared.figures
    assert own and all(figure in arranged._switch.args["models"] for figure in own)
    assert len(arranged._switch.args["models"]) > before


def test_the_cursor_follows_the_mode_that_matters_until_one_is_picked() -> None:
    cursor, labels = Cursor(), ("heave", "pitch", "sway")
    cursor.keep(labels, 1)
    assert cursor.mode == 1
    cursor.keep(labels, 2)
    assert cursor.mode == 2  # nobody has picked one
    cursor.source.data = {**cursor.source.data, "mode": [0]}
    for _ in range(3):  # every view asks
        cursor.keep(labels, 2)
    assert cursor.mode == 0
    cursor.keep(("sway", "heave", "pitch"), 2)
    assert cursor.mode == 1  # the same name elsewhere
    cursor.keep(("yaw", "sway"), 1)
    assert cursor.mode == 1  # it is gone
    cursor.keep(("yaw", "sway"), 0)
    assert cursor.mode == 0
