"""The thread behind a page: the newest wish is computed, older ones are dropped; slow work waits for a quiet moment and
is done by a process of its own."""

from __future__ import annotations

import itertools
import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

from maglev_ctrl.errors import MaglevError
from maglev_ctrl.scenario.problems import Problem, ScenarioProblems
from maglev_ctrl.workbench.faults import INTERNAL, tell_terminal
from maglev_ctrl.workbench.slow_process import SlowAnswer, SlowOrder
from maglev_ctrl.workbench.slow_work import SlowWork
from maglev_ctrl.workbench.sources import Sources
from maglev_ctrl.workbench.state import PageState

if TYPE_CHECKING:
    from maglev_ctrl.scenario import Scenario
    from maglev_ctrl.study.live import LiveStudy
    from maglev_ctrl.study.live.records import LiveComparison, LiveQuantity, LiveView

QUIET = 0.25
"""Seconds without a wish after which the slow part begins."""
LONGEST_STALE = 0.4
"""Seconds that tracks and map may stay behind while a slider is dragged."""
_PATIENCE = 0.1  # s that the sending of what is at the operating point is waited for
_KEPT = 4
_SERIALS = itertools.count(1)
"""Numbers of wishes, of all pages together: a process that one page leaves to another answers none of its old ones."""


@dataclass(frozen=True, eq=False, slots=True)
class Opened:
    """A scenario and one of its options are ready; what stands on the sliders."""

    state: PageState
    scenario: Scenario
    option: str
    quantities: tuple[LiveQuantity, ...]
    words: str  # what could not be done as asked; "" mostly


@dataclass(frozen=True, eq=False, slots=True)
class Shown:
    """A view of the state, fast or settled."""

    state: PageState
    view: LiveView
    seconds: float
    sent: threading.Event = field(default_factory=threading.Event)
    """Set when it is on its way to the browser."""


@dataclass(frozen=True, eq=False, slots=True)
class Written:
    """The scenario's text with the sliders' values in it."""

    state: PageState
    text: str
    purpose: str


@dataclass(frozen=True, eq=False, slots=True)
class Compared:
    """All options at the state's point."""

    state: PageState
    comparison: LiveComparison


@dataclass(frozen=True, eq=False, slots=True)
class Busy:
    """What takes longer, in words; "" when it is done."""

    words: str


@dataclass(frozen=True, eq=False, slots=True)
class Refused:
    """Why there is nothing to show; `problems` of the text with their places, where it is the text."""

    state: PageState
    words: str
    problems: tuple[Problem, ...] = ()
    purpose: str = ""  # of the text asked for; "": to be shown


Told = Opened | Shown | Written | Compared | Busy | Refused


@dataclass(eq=False, slots=True)
class Shelf:
    """Studies as they were opened, of which every page gets a twin, and processes that closed pages have left."""

    studies: dict[tuple[str, str, str], tuple[Scenario, LiveStudy]] = field(default_factory=dict)
    idle: list[SlowWork] = field(default_factory=list)
    lock: threading.Lock = field(default_factory=threading.Lock)

    def worker(self, heard: Callable[[SlowAnswer], None]) -> SlowWork:
        """A process for slow work, for the taker alone; one that a closed page left is ready at once."""
        with self.lock:
            found = self.idle.pop() if self.idle else SlowWork(heard)
        found.heard = heard
        return found

    def leave(self, worker: SlowWork) -> None:
        """Leave a process for the next page; one is kept."""
        with self.lock:
            if not self.idle:
                self.idle.append(worker)
                return
        worker.close()

    def take(self, key: tuple[str, str, str]) -> tuple[Scenario, LiveStudy] | None:
        """A twin of the study of a key, for the taker alone."""
        with self.lock:
            found = self.studies.get(key)
            return None if found is None else (found[0], found[1].twin())

    def put(self, key: tuple[str, str, str], study: tuple[Scenario, LiveStudy]) -> None:
        """Keep a twin of a study for whoever wants it next."""
        with self.lock:
            self.studies.pop(key, None)
            self.studies[key] = study[0], study[1].twin()
            while len(self.studies) > _KEPT:
                del self.studies[next(iter(self.studies))]


class LiveThread:
    """Computes what a page wishes to see, one thing at a time.

    Parameters
    ----------
    tell : called from this thread with everything found
    """

    def __init__(self, sources: Sources, shelf: Shelf, tell: Callable[[Told], None]) -> None:
        self._sources, self._shelf, self._tell = sources, shelf, tell
        self._changed = threading.Condition()
        self._wish: PageState | None = None
        self._texts: list[tuple[PageState, str]] = []
        self._serial = 0
        self._closed = False
        self._whole: LiveView | None = None  # shown last with tracks and map of its own
        self._whole_at = -math.inf
        self._own: dict[tuple[str, str, str], tuple[Scenario, LiveStudy]] = {}
        self._telling = threading.Lock()
        self._ordered: tuple[int, PageState, LiveView, float] | None = None
        self._slow = shelf.worker(self._heard)
        self._thread = threading.Thread(target=self._live, name="live study", daemon=True)
        self._thread.start()

    def show(self, state: PageState) -> None:
        """Wish to see a state; takes the place of what is not begun, and stops slow work."""
        with self._changed:
            self._wish = state
            self._serial = next(_SERIALS)
            self._changed.notify()

    def write(self, state: PageState, purpose: str) -> None:
        """Wish for the text of a state, handed back with its purpose."""
        with self._changed:
            self._texts.append((state, purpose))
            self._changed.notify()

    def close(self) -> None:
        """End when what is running is done."""
        with self._changed:
            self._closed = True
            self._serial = next(_SERIALS)
            self._changed.notify()

    def _live(self) -> None:
        rest: tuple[PageState, LiveView] | None = None  # what still has its slow part before it
        while True:
            with self._changed:
                if not (self._wish or self._texts or self._closed):
                    self._changed.wait(None if rest is None else QUIET)
                if self._closed:
                    break
                wish, self._wish = self._wish, None
                texts, self._texts = self._texts, []
                serial = self._serial
            if wish is not None:
                self._slow.cancel(serial)
                rest = self._guarded(wish, partial(self._first, wish))
            for state, purpose in texts:
                self._guarded(state, partial(self._write, state, purpose), purpose=purpose)
            if wish is None and not texts and rest is not None:
                self._guarded(rest[0], partial(self._order, *rest, serial))
                rest = None
        self._slow.cancel(self._serial)
        self._slow.heard = lambda answer: None
        self._shelf.leave(self._slow)

    def _guarded(
        self, state: PageState, work: Callable[[], tuple[PageState, LiveView] | None], *, purpose: str = ""
    ) -> tuple[PageState, LiveView] | None:
        """The work; whatever goes wrong in it becomes words."""
        try:
            return work()
        except ScenarioProblems as fault:
            count = len(fault.problems)
            words = f"The scenario has {count} fault{'' if count == 1 else 's'}: see its text below."
            self._tell(Refused(state, words, fault.problems, purpose))
        except MaglevError as fault:
            self._tell(Refused(state, str(fault), purpose=purpose))
        except Exception:
            tell_terminal("live study")
            self._tell(Refused(state, INTERNAL, purpose=purpose))
        return None

    def _first(self, state: PageState) -> tuple[PageState, LiveView] | None:
        scenario, study, fresh = self._study(state)
        if fresh:
            self._whole = None
            option, words = option_of(scenario, state)
            self._tell(Opened(state, scenario, option, study.quantities(), words))
        began = time.perf_counter()
        values = known_values(study, state)
        before = None if fresh or study.knows_sweep(values) else self._whole
        if before is not None:
            # What stands at the operating point comes at once, tracks and map a moment later.
            point = study.point(values)
            if not point.failure:
                shown = self._show(state, replace(point, tracks=before.tracks, map=before.map, following=True), began)
                shown.sent.wait(_PATIENCE)  # or the thread that sends it would have to share its time with this one
                if self._wished() and time.perf_counter() - self._whole_at < LONGEST_STALE:
                    return None
        self._whole = view = study.preview(values)
        self._whole_at = time.perf_counter()
        self._show(state, view, began)
        return state, view

    def _show(self, state: PageState, view: LiveView, began: float) -> Shown:
        shown = Shown(state, view, time.perf_counter() - began)
        with self._telling:
            self._tell(shown)
        return shown

    def _wished(self) -> bool:
        """Whether something newer waits already."""
        with self._changed:
            return self._wish is not None

    def _order(self, state: PageState, view: LiveView, serial: int) -> None:
        """Have everything slow about a state done: settle, write, compare."""
        _, study, _ = self._study(state)
        self._ordered = serial, state, view, time.perf_counter()
        path = self._sources.place(state.source, state.name)
        values = tuple(known_values(study, state).items())
        self._slow.order(SlowOrder(serial, state.text, str(path), study.option_name, values))

    def _heard(self, answer: SlowAnswer) -> None:
        """An answer of the slow work; one to a wish that has gone by is dropped."""
        with self._telling:  # never after the fast view of a newer wish
            ordered = self._ordered
            if self._closed or ordered is None or answer.serial != ordered[0] or answer.serial != self._serial:
                return
            _, state, view, began = ordered
            found = answer.found
            match answer.kind:
                case "settled":  # what the views keep by identity stays the same
                    whole = replace(
                        found, vehicle=view.vehicle, system=view.system, modes=view.modes, tracks=view.tracks
                    )
                    self._tell(Shown(state, whole, time.perf_counter() - began))
                case "text":
                    self._tell(Written(state, found, "shown"))
                case "compared":
                    self._tell(Compared(state, found))
                case "refused":
                    self._tell(Refused(state, found))
                case "fault":
                    self._tell(Refused(state, INTERNAL))

    def _write(self, state: PageState, purpose: str) -> None:
        """Tell the text of a state."""
        _, study, _ = self._study(state)
        self._tell(Written(state, study.scenario_text(known_values(study, state)), purpose))

    def _study(self, state: PageState) -> tuple[Scenario, LiveStudy, bool]:
        """The study of a state's text and option, and whether the page has not seen it before."""
        key = study_key(self._sources, state)
        newest = next(reversed(self._own), None)
        found = self._own.pop(key, None) or self._shelf.take(key)
        if found is None:
            self._tell(Busy("Reading the scenario and designing the control law ..."))
            try:
                found = open_study(self._sources, state, tell=lambda words: self._tell(Busy(words)))
            finally:
                self._tell(Busy(""))
            self._shelf.put(key, found)
        self._own[key] = found
        while len(self._own) > _KEPT:
            del self._own[next(iter(self._own))]
        return (*found, newest != key)


def study_key(sources: Sources, state: PageState) -> tuple[str, str, str]:
    """What makes two studies the same: text, the place whose data files it may name, option."""
    return (state.text, str(sources.place(state.source, state.name)), state.option)


def open_study(
    sources: Sources, state: PageState, *, tell: Callable[[str], None] = lambda words: None
) -> tuple[Scenario, LiveStudy]:
    """Read a scenario, solve its forces and design its law.

    Raises
    ------
    MaglevError : in words why it cannot be
    """
    from maglev_ctrl.study import solve_forces
    from maglev_ctrl.study.live import LiveStudy

    scenario = sources.read(state.text, key=state.source, name=state.name)

    def solving(what: str, fraction: float) -> None:
        tell(f"Solving the eddy-current forces, kept for the next time: {100.0 * fraction:.0f} %")

    solved = solve_forces(scenario, progress=solving)
    return solved, LiveStudy(solved, option_of(scenario, state)[0])


def option_of(scenario: Scenario, state: PageState) -> tuple[str, str]:
    """The option a state looks at, and words where the scenario does not have the one asked for."""
    names = [option.name for option in scenario.options]
    if not state.option or state.option in names:
        return state.option or names[0], ""
    return names[0], f'The scenario has no option "{state.option[:40]}"; its first one is shown.'


def known_values(study: LiveStudy, state: PageState) -> dict[str, float]:
    """The state's values of those sliders the study has; another option has others."""
    names = {quantity.name for quantity in study.quantities()}
    return {name: value for name, value in state.values if name in names}
