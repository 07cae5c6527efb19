"""The process behind what a page shows after its fast view: the checked map, margins, the text, the comparison.

Orders come as pickles on its input and answers go as pickles to its output, both of the workbench alone. A newer order
takes the place of an older one, and it ends when the input is closed.
"""

from __future__ import annotations

import os
import pickle
import queue
import sys
import threading
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, BinaryIO, Literal

if TYPE_CHECKING:
    from maglev_ctrl.scenario import Scenario
    from maglev_ctrl.study.live import LiveStudy

_POLITE = 15  # how far this process stands back behind the one that answers the sliders
_KEPT = 3

AnswerKind = Literal["settled", "text", "compared", "refused", "fault"]


@dataclass(frozen=True, slots=True)
class SlowOrder:
    """What is to be looked at: a text that counts as lying at `path`, its option, values (SI) by name.

    `serial`: told with every answer; an order without text only says that the one before is not wanted any more.
    """

    serial: int
    text: str = ""
    path: str = ""
    option: str = ""
    values: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True, slots=True)
class SlowAnswer:
    """A part of what was ordered: a LiveView, a text, a LiveComparison, or words."""

    serial: int
    kind: AnswerKind
    found: Any


class _Desk:
    """Answers orders one after the other; keeps a few studies."""

    def __init__(self, out: BinaryIO) -> None:
        self.orders: queue.SimpleQueue[SlowOrder] = queue.SimpleQueue()
        self.newest = 0
        self._out = out
        self._studies: dict[tuple[str, str, str], tuple[Scenario, LiveStudy]] = {}

    def hear(self, stream: BinaryIO) -> None:
        """Take orders until the input is closed, which ends the process whatever it computes."""
        with suppress(EOFError, OSError, pickle.UnpicklingError):
            while True:
                order = pickle.load(stream)
                self.newest = order.serial
                self.orders.put(order)
        os._exit(0)

    def work(self) -> None:
        """Answer for ever."""
        while True:
            order = self.orders.get()
            if order.serial == self.newest and order.text:
                self._answered(order)

    def _answered(self, order: SlowOrder) -> None:
        from maglev_ctrl.errors import MaglevError

        def tell(kind: AnswerKind, found: object) -> None:
            pickle.dump(SlowAnswer(order.serial, kind, found), self._out, protocol=pickle.HIGHEST_PROTOCOL)
            self._out.flush()

        try:
            self._look(order, tell)
        except MaglevError as fault:
            tell("refused", str(fault))
        except Exception:  # the page says a sentence, the terminal everything
            traceback.print_exc()
            tell("fault", "")

    def _look(self, order: SlowOrder, tell: Callable[[AnswerKind, object], None]) -> None:
        from maglev_ctrl.study.live import compare_options

        def cancelled() -> bool:
            return self.newest != order.serial

        scenario, study = self._study(order)
        values = dict(order.values)
        view = study.preview(values)
        if not view.failure:
            settled = study.settle(view, cancelled=cancelled)
            if cancelled():
                return
            tell("settled", settled)
        tell("text", study.scenario_text(values))
        if view.failure or cancelled():
            return
        comparison = compare_options(scenario, values, cancelled=cancelled)
        if not cancelled():
            tell("compared", comparison)

    def _study(self, order: SlowOrder) -> tuple[Scenario, LiveStudy]:
        from maglev_ctrl.scenario.reader import load_text
        from maglev_ctrl.study import solve_forces
        from maglev_ctrl.study.live import LiveStudy

        key = (order.text, order.path, order.option)
        found = self._studies.pop(key, None)
        if found is None:
            scenario = solve_forces(load_text(order.text, order.path))
            found = scenario, LiveStudy(scenario, order.option)
        self._studies[key] = found
        while len(self._studies) > _KEPT:
            del self._studies[next(iter(self._studies))]
        return found


def main() -> int:
    """Answer orders until the input is closed."""
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever a library prints goes to the terminal and not between the answers
    nice = getattr(os, "nice", None)  # not on Windows
    if nice is not None:
        with suppress(OSError):
            nice(_POLITE)
    desk = _Desk(out)
    threading.Thread(target=desk.hear, args=(sys.stdin.buffer,), daemon=True).start()
    desk.work()
    return 0
