"""One browser page: what it asks for becomes wishes, what is found becomes its figures and words."""

from __future__ import annotations

import json
import secrets
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import TYPE_CHECKING, Any

from tornado.ioloop import IOLoop

from maglev_ctrl.errors import MaglevError
from maglev_ctrl.scenario.limits import SIZE_LIMIT
from maglev_ctrl.scenario.problems import Problem, ScenarioProblems
from maglev_ctrl.workbench.arrangement import Arrangement
from maglev_ctrl.workbench.faults import INTERNAL, tell_terminal
from maglev_ctrl.workbench.live_thread import Busy, Compared, LiveThread, Opened, Refused, Shown, Told, Written
from maglev_ctrl.workbench.share import address_of, packed, state_of
from maglev_ctrl.workbench.site import Site
from maglev_ctrl.workbench.sources import UPLOADED, file_stem
from maglev_ctrl.workbench.state import History, PageState, read_values, with_value
from maglev_ctrl.workbench.told import Event, job_event, opened_event, problems_event, sources_event, view_event

if TYPE_CHECKING:
    from maglev_ctrl.scenario import Scenario

_KEPT_LIMIT = 4 * SIZE_LIMIT
_POLL = 400  # ms
_DESIGN, _REPORT, _SHOWN, _DOWNLOAD = "design point", "report", "shown", "download"


class Page:
    """One page and its document; all methods but `_from_thread` run on the server's loop."""

    def __init__(self, document: Any, site: Site) -> None:
        self.key = secrets.token_urlsafe(18)
        self._document, self._site = document, site
        self.arrangement = site.spares.pop() if site.spares else Arrangement()
        self.arrangement.attach(document)
        self._bridge = self.arrangement.bridge
        self._history: History | None = None
        self._scenario: Scenario | None = None
        self._sliders: frozenset[str] = frozenset()
        self._count = 0
        self._last_heard = 0  # serial of what the browser said last
        self._text_told: str | None = None
        self._newest: Shown | None = None
        self._job: tuple[str, str] | None = None  # name and hash of the scenario whose report is watched
        self._job_told: Event = {}
        self._downloads: list[Future[str]] = []
        self._gone = False
        self._bridge.on_change("inbox", self._heard)
        self._live = LiveThread(site.sources, site.shelf, self._from_thread)
        site.pages[self.key] = self
        document.on_session_destroyed(self._destroyed)
        document.add_periodic_callback(self._poll, _POLL)

    def text_now(self) -> Future[str]:
        """The scenario's text with the sliders' values in it, as soon as it is written."""
        wanted: Future[str] = Future()
        if self._history is None:
            wanted.set_exception(ValueError("no scenario is open"))
        else:
            self._downloads.append(wanted)
            self._live.write(self._history.now, _DOWNLOAD)
        return wanted

    @property
    def name(self) -> str:
        """Name of the scenario shown, fit for a file."""
        return "scenario" if self._history is None else file_stem(self._history.now.name)

    # What the browser says -----------------------------------------------------------------------------------------

    def _heard(self, attribute: str, old: str, new: str) -> None:
        try:
            said = json.loads(new)
            heard = _HEARD.get(said.get("kind")) if isinstance(said, dict) else None
            self._last_heard = int(said["serial"]) if heard is not None else self._last_heard
            if heard is not None:
                heard(self, said)
        except (MaglevError, ValueError) as fault:
            self._say({"kind": "message", "words": str(fault)})
        except Exception:
            tell_terminal("page")
            self._say({"kind": "message", "words": INTERNAL})

    def _hello(self, said: Event) -> None:
        """The page is there: show what its address asks for, or the first scenario."""
        self._say({"kind": "hello", "key": self.key, "limit": SIZE_LIMIT})
        self._say(sources_event(self._site.sources))
        asked: PageState | None = None
        try:
            kept = said.get("kept")
            if isinstance(kept, str) and kept and said.get("hash") == "#kept":
                asked = state_of("", kept, limit=_KEPT_LIMIT)
            else:
                asked = state_of(str(said.get("search", "")), str(said.get("hash", "")))
            asked = None if asked is None else self._with_text(asked)
        except (MaglevError, ValueError) as fault:
            self._say({"kind": "message", "words": f"This address could not be shown: {_sentence(fault)}"})
            asked = None
        first = self._site.sources.first
        if asked is None and first is not None:
            asked = self._with_text(PageState(first.key, first.path.stem, ""))
        if asked is None:
            self._say({"kind": "empty", "words": self._site.sources.words or "Upload a scenario to begin."})
            return
        self._go(asked)

    def _with_text(self, state: PageState) -> PageState:
        """A state with its source's text; one whose source this server does not offer stands for itself."""
        if state.edited:
            source = state.source if self._site.sources.find(state.source) is not None else UPLOADED
            return PageState(source, state.name, state.text, state.option, state.values, edited=True)
        text = self._site.sources.text(state.source)
        found = self._site.sources.find(state.source)
        assert found is not None
        return PageState(state.source, found.path.stem, text, state.option, state.values)

    def _choose(self, said: Event) -> None:
        self._go(self._with_text(PageState(str(said.get("key", "")), "", "")))

    def _upload(self, said: Event) -> None:
        text, name = said.get("text"), str(said.get("name", "scenario"))
        _require_size(text, what=name[:80])
        self._go(PageState(UPLOADED, file_stem(name), str(text), edited=True))

    def _edit(self, said: Event) -> None:
        now, text = self._now(), said.get("text")
        _require_size(text, what="the text")
        self._go(PageState(now.source, now.name, str(text), now.option, (), edited=True))

    def _check(self, said: Event) -> None:
        """Look for faults in a text that is being written; its number tells the page which one was checked."""
        now, text, count = self._now(), said.get("text"), int(said.get("count", 0))
        _require_size(text, what="the text")
        read = partial(_problems, self._site, str(text), now)
        self._later(read, lambda problems: self._say(problems_event(problems, count)))

    def _option(self, said: Event) -> None:
        now = self._now()
        self._go(PageState(now.source, now.name, now.text, str(said.get("name", "")), now.values, now.edited))

    def _values(self, said: Event) -> None:
        values = read_values(said.get("values"))
        unknown = sorted(set(values) - self._sliders)
        if unknown:
            return  # of sliders just taken away
        self._go(with_value(self._now(), values), gesture=str(said.get("gesture", ""))[:40])

    def _reset(self, said: Event) -> None:
        now = self._now()
        self._go(PageState(now.source, now.name, now.text, now.option, (), now.edited))

    def _make_design_point(self, said: Event) -> None:
        self._live.write(self._now(), _DESIGN)

    def _undo(self, said: Event) -> None:
        if self._history is not None and self._history.can_undo:
            self._show(self._history.undo())

    def _redo(self, said: Event) -> None:
        if self._history is not None and self._history.can_redo:
            self._show(self._history.redo())

    def _report(self, said: Event) -> None:
        self._say({"kind": "job", "status": "running", "words": "writing the scenario", "fraction": 0.0, "left": None,
                   "folder": "", "files": []})  # fmt: skip
        self._job_told = {}
        self._live.write(self._now(), _REPORT)

    def _cancel_report(self, said: Event) -> None:
        if self._job is not None:
            self._site.jobs.cancel(*self._job)

    def _now(self) -> PageState:
        if self._history is None:
            raise ValueError("no scenario is open; choose one or upload one")
        return self._history.now

    # What is shown -------------------------------------------------------------------------------------------------

    def _go(self, state: PageState, *, gesture: str = "") -> None:
        """A new state, which undo leads back from."""
        if self._history is None:
            self._history = History(state)
        else:
            self._history.put(state, gesture=gesture)
        self._show(state)

    def _show(self, state: PageState) -> None:
        assert self._history is not None
        address = address_of(state)
        text = {} if state.text == self._text_told else {"text": state.text}
        self._text_told = state.text
        self._say({
            "kind": "state", "source": state.source, "name": state.name, **text, "edited": state.edited,
            "values": dict(state.values), "undo": self._history.can_undo, "redo": self._history.can_redo,
            "address": "#kept" if address is None else address, "kept": packed(state) if address is None else "",
        })  # fmt: skip
        self._live.show(state)

    def _from_thread(self, told: Told) -> None:
        """Called from the thread of the live study. Of views only the newest is drawn, however many come."""
        if self._gone:
            return
        if isinstance(told, Shown):
            pending, self._newest = self._newest, told
            if pending is not None:
                return
            self._document.add_next_tick_callback(self._draw)
        else:
            self._document.add_next_tick_callback(partial(self._guarded, partial(self._tell, told)))

    def _guarded(self, work: Callable[[], None]) -> None:
        try:
            work()
        except Exception:
            tell_terminal("page")
            self._say({"kind": "message", "words": INTERNAL})

    def _draw(self) -> None:
        newest, self._newest = self._newest, None
        if newest is not None and self._scenario is not None:
            self._guarded(partial(self._drawn, newest, self._scenario))
            IOLoop.current().add_callback(newest.sent.set)  # after the message of what is drawn here

    def _drawn(self, shown: Shown, scenario: Scenario) -> None:
        self.arrangement.show(shown.view)
        # A page rests only when it shows what it asked for last; an older view is drawn on the way there.
        answers = self._last_heard if self._is_now(shown.state) and not shown.view.following else 0
        self._say({**view_event(shown.view, scenario, shown.seconds), "answers": answers})

    def _tell(self, told: Told) -> None:
        match told:
            case Opened():
                fresh = self._scenario is None or self._scenario.hash != told.scenario.hash
                if fresh:
                    self.arrangement.forget_comparison()
                self._scenario = told.scenario
                self._sliders = frozenset(one.name for one in told.quantities)
                self._say({**opened_event(told.scenario, told.option, told.quantities), "fresh": fresh})
                if told.words:
                    self._say({"kind": "message", "words": told.words})
                if not told.state.values:  # as its file has it: a report of it may be there, or on its way
                    self._job = (told.state.name, told.scenario.hash)
                    self._poll()
            case Busy():
                self._say({"kind": "busy", "words": told.words})
            case Compared():
                if self._is_now(told.state):
                    self.arrangement.compare(told.comparison)
                    self._say({"kind": "compared"})
            case Written():
                self._written(told)
            case Refused():
                self._refused(told)
            case Shown():
                pass  # drawn by `_draw`

    def _written(self, told: Written) -> None:
        state = told.state
        if told.purpose == _DESIGN:
            if self._is_now(state):
                self._go(PageState(state.source, state.name, told.text, state.option, (), edited=True))
        elif told.purpose == _DOWNLOAD:
            for wanted in self._downloads:
                wanted.set_result(told.text)
            self._downloads = []
        elif told.purpose in (_REPORT, _SHOWN):
            if told.purpose == _SHOWN and self._is_now(state):
                self._text_told = None  # what the browser's editor has now is another text
                self._say({"kind": "written", "text": told.text})
            read = partial(_hash, self._site, told.text, state)
            self._later(read, partial(self._hashed, told))

    def _hashed(self, told: Written, scenario_hash: str) -> None:
        """The scenario of a text is known by its hash now: its report is watched, or begun."""
        state = told.state
        if not scenario_hash:
            return
        if told.purpose == _REPORT:
            try:
                self._site.jobs.start(
                    told.text, path=self._site.sources.place(state.source, state.name), name=state.name,
                    scenario_hash=scenario_hash,
                )  # fmt: skip
            except ValueError as fault:
                self._job_told = {}
                self._say({"kind": "message", "words": _sentence(fault)})
        elif not self._is_now(state):
            return
        self._job = (state.name, scenario_hash)
        self._poll()

    def _refused(self, told: Refused) -> None:
        if told.purpose == _DOWNLOAD:
            for wanted in self._downloads:
                wanted.set_exception(ValueError(told.words))
            self._downloads = []
        elif told.purpose:
            self._job_told = {}
            self._say({"kind": "message", "words": _sentence(told.words)})
        elif self._is_now(told.state):
            self.arrangement.clear(told.words)
            self._say({"kind": "refused", "words": told.words, "open": bool(told.problems)})
            self._say(problems_event(told.problems, 0))

    def _is_now(self, state: PageState) -> bool:
        return self._history is not None and self._history.now == state

    def _poll(self) -> None:
        """Tell how the report stands, when that has changed."""
        if self._job is None:
            return
        event = job_event(self._site.jobs.view(*self._job))
        if event != self._job_told:
            self._job_told = event
            self._say(event)

    def _later(self, work: Callable[[], Any], then: Callable[[Any], None]) -> None:
        """Work beside the loop, and what is done with its result on it."""

        def done(future: Future[Any]) -> None:
            if self._gone or future.cancelled():
                return
            if future.exception() is None:
                self._document.add_next_tick_callback(partial(self._guarded, partial(then, future.result())))

        self._site.pool.submit(work).add_done_callback(done)

    def _say(self, event: Event) -> None:
        if not self._gone:
            self._count += 1
            self._bridge.outbox = json.dumps({**event, "serial": self._count})

    def _destroyed(self, context: Any) -> None:
        self._gone = True
        self._site.pages.pop(self.key, None)
        self._live.close()


_HEARD: dict[object, Callable[[Page, Event], None]] = {
    "hello": Page._hello, "choose": Page._choose, "upload": Page._upload, "edit": Page._edit, "check": Page._check,
    "option": Page._option, "values": Page._values, "reset": Page._reset, "design": Page._make_design_point,
    "undo": Page._undo, "redo": Page._redo, "report": Page._report, "cancel": Page._cancel_report,
}  # fmt: skip


def _require_size(text: object, *, what: str) -> None:
    if not isinstance(text, str):
        raise ValueError(f"{what}: expected text")
    if len(text.encode(errors="replace")) > SIZE_LIMIT:
        raise ValueError(f"{what}: expected at most 1 MiB of text; nothing was changed")


def _problems(site: Site, text: str, state: PageState) -> tuple[Problem, ...]:
    try:
        site.sources.read(text, key=state.source, name=state.name)
    except ScenarioProblems as fault:
        return fault.problems
    except MaglevError as fault:
        return (Problem(0, 0, "", str(fault)),)
    except Exception:
        tell_terminal("check of a text")
        return (Problem(0, 0, "", INTERNAL),)
    return ()


def _hash(site: Site, text: str, state: PageState) -> str:
    """Hash of the scenario of a text; "" where it has none."""
    try:
        return site.sources.read(text, key=state.source, name=state.name).hash
    except MaglevError:
        return ""


def _sentence(fault: object) -> str:
    text = str(fault)
    return text if text.endswith((".", "!", "?")) else f"{text}."
