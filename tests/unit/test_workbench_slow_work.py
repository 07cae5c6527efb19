"""Slow work is done by a process of its own: newer orders replace older ones, and nothing outlives the page."""

from __future__ import annotations

import queue
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from maglev_ctrl.errors import Verdict
from maglev_ctrl.study.live.records import LiveView
from maglev_ctrl.workbench.live_thread import Compared, LiveThread, Refused, Shelf, Shown, Told, Written
from maglev_ctrl.workbench.slow_process import SlowAnswer, SlowOrder
from maglev_ctrl.workbench.slow_work import SlowWork
from maglev_ctrl.workbench.sources import find_sources
from maglev_ctrl.workbench.state import PageState

SCENARIO = Path(__file__).resolve().parents[2] / "scenarios" / "periodic" / "girder_passing.toml"
PATIENCE = 60.0


def answers(heard: queue.SimpleQueue[SlowAnswer], last: str) -> list[SlowAnswer]:
    """Everything up to the answer of a kind."""
    found: list[SlowAnswer] = []
    while not found or found[-1].kind != last:
        found.append(heard.get(timeout=PATIENCE))
    return found


def test_a_process_answers_the_newest_order_and_ends_with_its_input() -> None:
    heard: queue.SimpleQueue[SlowAnswer] = queue.SimpleQueue()
    work = SlowWork(heard.put)
    text = SCENARIO.read_text(encoding="utf-8")
    work.order(SlowOrder(1, text, str(SCENARIO), "windings", (("speed", 90.0),)))
    work.order(SlowOrder(2, text, str(SCENARIO), "windings", (("speed", 100.0),)))
    process = work._process
    assert process is not None
    found = answers(heard, "compared")
    assert {one.serial for one in found} == {2}
    by_kind = {one.kind: one.found for one in found}
    assert by_kind["settled"].settled and by_kind["settled"].speed == 100.0
    assert "360 km/h" in by_kind["text"] or "100" in by_kind["text"]
    assert "windings" in by_kind["compared"].options
    work.order(SlowOrder(3, "format = 1", str(SCENARIO), "windings"))
    refused = answers(heard, "refused")[-1]
    assert refused.serial == 3 and "forces" in refused.found
    work.close()
    process.wait(PATIENCE)


def test_a_process_that_died_is_begun_again() -> None:
    heard: queue.SimpleQueue[SlowAnswer] = queue.SimpleQueue()
    work = SlowWork(heard.put, command=(sys.executable, "-c", "pass"))
    work.order(SlowOrder(1, "x"))
    first = work._process
    assert first is not None
    first.wait(PATIENCE)
    work.order(SlowOrder(2, "x"))
    assert work._process is not None and work._process is not first
    work.close()
    assert heard.empty()


def test_the_page_hears_the_fast_view_first_and_then_all_that_is_slow(tmp_path: Path) -> None:
    told: queue.SimpleQueue[Told] = queue.SimpleQueue()
    sources = find_sources(SCENARIO, shipped=None, here=tmp_path, empty_folder=tmp_path)
    shelf = Shelf()
    live = LiveThread(sources, shelf, told.put)
    first = sources.first
    assert first is not None
    state = PageState(first.key, "girder_passing", sources.text(first.key), "windings", (("speed", 100.0),))
    live.show(state)
    seen: list[Told] = []
    while not any(isinstance(one, Compared | Refused) for one in seen):
        seen.append(told.get(timeout=PATIENCE))
    views = [one.view for one in seen if isinstance(one, Shown)]
    assert [one.settled for one in views] == [False, True]
    assert views[1].modes is views[0].modes and views[1].vehicle is views[0].vehicle
    assert views[0].verdict is Verdict.NOT_EVALUATED
    assert [one.purpose for one in seen if isinstance(one, Written)] == ["shown"]
    assert isinstance(seen[-1], Compared)
    # What belongs to a wish that has gone by is dropped.
    live.show(state)
    while not isinstance(told.get(timeout=PATIENCE), Shown):
        pass
    live._heard(SlowAnswer(-1, "text", "older"))
    assert not any(isinstance(one, Written) and one.text == "older" for one in drained(told))
    live.close()
    until = time.monotonic() + PATIENCE
    while not shelf.idle and time.monotonic() < until:
        time.sleep(0.01)
    assert len(shelf.idle) == 1
    # The next page takes the process over, and everything it orders reaches it and not the page that is gone.
    later: queue.SimpleQueue[Told] = queue.SimpleQueue()
    second = LiveThread(sources, shelf, later.put)
    assert not shelf.idle
    second.show(state)
    seen = []
    while not any(isinstance(one, Compared | Refused) for one in seen):
        seen.append(later.get(timeout=PATIENCE))
    assert [one.view.settled for one in seen if isinstance(one, Shown)] == [False, True]
    second.close()
    until = time.monotonic() + PATIENCE
    while not shelf.idle and time.monotonic() < until:
        time.sleep(0.01)
    shelf.idle[0].close()


def test_the_operating_point_comes_first_and_lines_and_map_follow(tmp_path: Path) -> None:
    told: queue.SimpleQueue[Told] = queue.SimpleQueue()
    sources = find_sources(SCENARIO, shipped=None, here=tmp_path, empty_folder=tmp_path)
    live = LiveThread(sources, Shelf(), told.put)
    first = sources.first
    assert first is not None
    state = PageState(first.key, "girder_passing", sources.text(first.key), "windings", ())

    def shown(state: PageState, count: int) -> list[LiveView]:
        live.show(state)
        views: list[LiveView] = []
        while len(views) < count:
            one = told.get(timeout=PATIENCE)
            if isinstance(one, Shown) and not one.view.settled and one.state == state:
                views.append(one.view)
                one.sent.set()
        return views

    (before,) = shown(state, 1)
    assert not before.following  # there is nothing it could be shown with
    (faster,) = shown(replace(state, values=(("speed", 0.9 * before.speed),)), 1)
    assert not faster.following and faster.map is before.map  # the map does not follow the speed
    point, whole = shown(replace(state, values=(("payload", 4_500.0),)), 2)
    assert point.following and not whole.following
    assert point.map is before.map and point.tracks is before.tracks  # still of the values before, and said so
    assert point.modes is not None and whole.modes is not None and before.modes is not None
    np.testing.assert_allclose(point.modes.s, whole.modes.s, rtol=1e-12)
    assert np.max(np.abs(point.modes.s - before.modes.s)) > 1e-3
    assert whole.map is not None and before.map is not None
    assert np.max(np.abs(whole.map.growth - before.map.growth)) > 1e-3
    live.close()


def drained(told: queue.SimpleQueue[Told]) -> list[Told]:
    """What has come by now."""
    found: list[Told] = []
    with pytest.raises(queue.Empty):
        while True:
            found.append(told.get_nowait())
    return found
