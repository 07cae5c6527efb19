"""run_sweep(scenario, request, folder) -> SweepStudy: every point of a sweep, kept as it goes."""

from __future__ import annotations

import re
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from maglev_ctrl.scenario import Scenario
from maglev_ctrl.study.run import versions, with_forces
from maglev_ctrl.study.sweep.block import SweepTask, block_size, seconds_per_point
from maglev_ctrl.study.sweep.cluster import on_cluster, require_scheduler
from maglev_ctrl.study.sweep.local import on_this_machine
from maglev_ctrl.study.sweep.records import (
    FAILED,
    MET_WORDS,
    STATE_WORDS,
    STATUS_WORDS,
    Column,
    OptionCount,
    SweepBlock,
    SweepStudy,
)
from maglev_ctrl.study.sweep.request import SweepRequest
from maglev_ctrl.study.sweep.store import SweepStore
from maglev_ctrl.study.workers import Lost

Progress = Callable[[str, float], None]
_COMMON = 5  # reasons that are told of an option
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
_CHECKED = 2000  # blocks between two words while the kept part is read


def run_sweep(
    scenario: Scenario, request: SweepRequest, folder: Path, *, jobs: int = 1, cluster: str = "",
    block: int | None = None, progress: Progress | None = None,
) -> tuple[SweepStudy, SweepStore]:  # fmt: skip
    """Compute every point of a sweep that the folder's store does not hold yet.

    Call it inside `store.alone(folder)`. The store stays; `store.remove_store` removes it.

    Parameters
    ----------
    folder : holds the store; the same call goes on where an interrupted one was, to the same numbers
    jobs : processes of this machine; with more than one, call from under `if __name__ == "__main__":`
    cluster : address of a Dask scheduler, used instead of this machine's processes
    block : points of a block; None: so many as take about 0.7 s
    progress : told what is done and the fraction of the whole, 0 to 1

    Raises
    ------
    ScenarioError : the store is of another sweep, or damaged
    ModelError : the forces cannot be solved, nobody can compute, the store cannot be written or went away
    """
    if jobs < 1 or (block is not None and block < 1):
        raise ValueError(f"jobs, block: expected one or more, got {jobs}, {block}")
    started = time.perf_counter()
    scenario, tell = with_forces(scenario, jobs, progress or (lambda what, fraction: None))
    size = SweepStore.begun_in(folder) or block
    if size is None:
        tell("measuring what a point costs", 0.0)
        cost = seconds_per_point(scenario, request)
        size = block_size(request.points, cost, workers=4 if cluster else jobs)
    if cluster:
        require_scheduler(cluster)  # before anything is written
    task = SweepTask(scenario, request, size)
    store = SweepStore.open(folder, task)
    tally = Tally(task)
    missing, damaged = _kept(store, tally, tell)
    resumed = task.blocks - len(missing)

    def share() -> float:
        return tally.points / request.points

    def say(words: str) -> None:
        tell(words, share())

    say(f"{request.points} points in {task.blocks} blocks" + (f", {resumed} of them kept" if resumed else ""))
    results: Iterator[tuple[int, SweepBlock | Lost]] = (
        on_cluster(task, missing, address=cluster, say=say) if cluster else
        on_this_machine(task, missing, jobs=min(jobs, max(1, len(missing))))
    )  # fmt: skip
    with closing(results):  # type: ignore[type-var]
        for index, found in results:
            done = lost_block(task, index, found.reason) if isinstance(found, Lost) else found
            store.put(done)
            tally.add(done)
            say(f"{tally.points} of {request.points} points" + tally.trouble())
    return SweepStudy(
        title=scenario.title, name=scenario.name, scenario_path=str(scenario.path), scenario_hash=scenario.hash,
        request=request, options=tally.options(), block=size, blocks=task.blocks, resumed=resumed, damaged=damaged,
        workers=cluster or f"{jobs} process{'es' if jobs > 1 else ''} of this machine",
        notes=notes_of(scenario, request), versions=versions(), created=datetime.now(UTC).isoformat(timespec="seconds"),
        seconds=time.perf_counter() - started, busy=tally.seconds,
    ), store  # fmt: skip


def _kept(store: SweepStore, tally: Tally, tell: Progress) -> tuple[list[int], int]:
    """The blocks that are missing, and how many were there and could not be trusted."""
    missing: list[int] = []
    damaged, blocks = 0, store.task.blocks
    for index in range(blocks):
        found = store.get(index)
        if found is None:
            missing.append(index)
            damaged += store.has(index)
        else:
            tally.add(found)
        if index % _CHECKED == _CHECKED - 1:
            tell(f"reading what is kept: {index + 1} of {blocks} blocks", 0.0)
    return missing, damaged


def lost_block(task: SweepTask, index: int, reason: str) -> SweepBlock:
    """The block that nobody could compute: every point failed, for the same reason."""
    quantities = task.request.values(*task.span(index))
    blank = np.array([column.blank for column in task.columns])
    count = len(task.request.options)
    figures = np.tile(blank, (len(quantities), count, 1))
    remarks = tuple((k, j, reason) for k in range(len(quantities)) for j in range(count))
    return SweepBlock(index, quantities, figures, remarks)


@dataclass(eq=False)
class Tally:
    """How the points came out so far."""

    task: SweepTask
    points: int = 0
    seconds: float = 0.0
    _codes: dict[tuple[int, str], Counter[float]] = field(default_factory=dict)
    _remarks: dict[int, Counter[str]] = field(default_factory=dict)

    def add(self, block: SweepBlock) -> None:
        """Count a block."""
        self.points += len(block.quantities)
        self.seconds += block.seconds
        for k, column in enumerate(self.task.columns):
            if column.codes:
                for j in range(block.figures.shape[1]):
                    self._codes.setdefault((j, column.name), Counter()).update(block.figures[:, j, k].tolist())
        for _, j, words in block.remarks:
            kinds = self._remarks.setdefault(j, Counter())
            # Reasons with their numbers left out are few; should they be many after all, memory stays bounded.
            kind = _NUMBER.sub("#", words)
            kinds[kind if kind in kinds or len(kinds) < 1000 else "other reasons"] += 1

    def trouble(self) -> str:
        """What went wrong so far, in words for a line of progress."""
        failed = sum(counts[FAILED] for (_, name), counts in self._codes.items() if name == "status")
        return f", {failed} could not be computed" if failed else ""

    def options(self) -> tuple[OptionCount, ...]:
        """The counts of every option."""
        known = {one.name: one for one in self.task.scenario.options}
        return tuple(
            OptionCount(
                name=name, label=known[name].label or name, states=self._named(j, "state", STATE_WORDS) or {},
                statuses=self._named(j, "status", STATUS_WORDS) or {},
                modulated=self._named(j, "modulated_state", STATE_WORDS),
                verdicts=self._named(j, "requirements", MET_WORDS),
                remarks=tuple(self._remarks.get(j, Counter()).most_common(_COMMON)),
            )
            for j, name in enumerate(self.task.request.options)
        )  # fmt: skip

    def _named(self, j: int, name: str, words: tuple[tuple[str, float], ...]) -> dict[str, int] | None:
        counts = self._codes.get((j, name))
        return None if counts is None else {word: counts[value] for word, value in words}


def notes_of(scenario: Scenario, request: SweepRequest) -> tuple[str, ...]:
    """What the reader must know about the points."""
    notes: list[str] = []
    for one in request.ranges:
        unit = one.quantity.unit
        if one.bare and unit:
            notes.append(f"{one.quantity.name} came without a unit and is read in {unit}.")
    controlled = any(option.control is not None for option in scenario.options if option.name in request.options)
    stays = [one.quantity.name for one in request.ranges if one.quantity.path and not one.quantity.of_law]
    if stays and controlled:
        notes.append(
            f"Control laws stay as designed at the scenario's own values; {', '.join(stays)} changes only what they "
            "meet."
        )
    anew = [one.quantity.name for one in request.ranges if one.quantity.of_law]
    if anew:
        notes.append(f"The control law is designed anew at every value of {', '.join(anew)}.")
    if scenario.periodic is not None and "floquet" not in request.parts:
        notes.append(
            "The scenario's periodic forces are left out: a point that is stable here may grow under modulation."
        )
    left_out = [option.name for option in scenario.options if option.name not in request.options]
    if left_out:
        notes.append(f"Not computed: {', '.join(left_out)}.")
    return tuple(notes)


def columns_in(columns: Sequence[Column], name: str) -> int | None:
    """Position of a column; None where it was not computed."""
    return next((k for k, column in enumerate(columns) if column.name == name), None)


def no_answer(study: SweepStudy) -> str:
    """Why a sweep has not one single answer, for then its range or the scenario is wrong; '' where it has some."""
    if any(one.statuses.get("failed", 0) < study.request.points for one in study.options):
        return ""
    reason = next((one.remarks[0][0] for one in study.options if one.remarks), "no reason is known")
    return f"no point of the sweep could be computed: {reason}"
