"""Results of several files: a writer that is killed, interrupted or refused leaves the old ones or the new ones."""

from __future__ import annotations

import os
import signal
import time
from contextlib import suppress
from pathlib import Path

import pytest
from atomic_moments import (
    CALLS,
    NUMBERS,
    State,
    Work,
    blow,
    in_a_process,
    interrupt,
    killed,
    moments,
    refusing,
    set_up,
    state,
)

from maglev_ctrl.errors import ScenarioError
from maglev_ctrl.files import passing_name, write_bytes
from maglev_ctrl.report import folder as folder_module
from maglev_ctrl.report import swap
from maglev_ctrl.report.folder import require_writable, write_whole

posix = pytest.mark.skipif(os.name == "nt", reason="processes are forked and killed")
unclosed = pytest.mark.filterwarnings(
    # An interrupt between the opening of a file and its `with` leaves the closing to the interpreter.
    "ignore::pytest.PytestUnraisableExceptionWarning", "ignore::ResourceWarning",
)  # fmt: skip

OLD: State = {
    "report.html": b"old page", "report.pdf": b"old paper", "figures": b"/", "figures/a.svg": b"old figure",
    "notes.txt": b"mine", "kept": b"/", "kept/data.csv": b"1,2",
}  # fmt: skip
MADE = {"report.html": b"new page", "report.json": b"new numbers", "figures/b.svg": b"new figure"}
NEW: State = {
    "report.html": b"new page", "report.json": b"new numbers", "figures": b"/", "figures/b.svg": b"new figure",
    "notes.txt": b"mine", "kept": b"/", "kept/data.csv": b"1,2",
}  # fmt: skip
FRESH: State = {name: NEW[name] for name in ("report.html", "report.json", "figures", "figures/b.svg")}
WAYS = ["exchange", "each", "fresh"]


class Case:
    """A folder with an earlier report, and the writing of the next one, in one of the ways it goes."""

    def __init__(self, way: str, tmp_path: Path) -> None:
        self.way = way
        self.folder = tmp_path / "results" / "out"
        self.before: State = {} if way == "fresh" else OLD
        self.after: State = FRESH if way == "fresh" else NEW

    def prepare(self) -> None:
        set_up(self.folder, None if self.way == "fresh" else OLD)

    def write(self) -> None:
        write_whole(MADE, self.folder, replaced=["report.pdf", "report.html", "report.json", "figures"])

    def state(self) -> State:
        return state(self.folder)

    def beside(self) -> list[str]:
        return sorted(one.name for one in self.folder.parent.iterdir() if one != self.folder)


@pytest.fixture(params=WAYS)
def case(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Case:
    if request.param == "exchange" and swap._exchanger() is None:
        pytest.skip("this system exchanges no two folders in one step")
    if request.param == "each":
        monkeypatch.setattr(swap, "_exchangeable", lambda _target: False)
    else:
        monkeypatch.setattr(swap, "_stands_in", lambda _target: False)  # a look at every process of this machine
    # A disk in memory settles at once; what is settled, and when, has its own test.
    monkeypatch.setattr(os, "fsync", lambda _handle: None)
    return Case(request.param, tmp_path)


def faults_of_kills(case: Case, step: int = 1) -> list[str]:
    """What is wrong after a writer was killed at its moments."""
    case.prepare()
    found = []
    whole = (case.before, case.after)
    for at in range(1, moments(case.write) + 1, step):
        case.prepare()
        assert killed(case.write, at)
        left = case.state()
        if case.way == "each":  # files are whole; what of the set was moved is taken back by the next run
            if any(left[name] not in (OLD.get(name), NEW.get(name)) for name in left):
                found.append(f"moment {at}: a file that is neither: {left}")
        elif left not in whole:
            found.append(f"moment {at}: neither old nor new: {left}")
        require_writable(case.folder)
        if case.state() not in whole:
            found.append(f"moment {at}: the next run found neither: {case.state()}")
        if case.beside():
            found.append(f"moment {at}: left behind: {case.beside()}")
    return found


@posix
def test_a_killed_writer_leaves_the_old_or_the_new(case: Case) -> None:
    assert faults_of_kills(case, step=4) == []


@posix
def test_kills_show_a_writer_that_moves_without_a_plan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The mutant: nothing is taken back after a kill."""
    monkeypatch.setattr(swap, "_exchangeable", lambda _target: False)
    monkeypatch.setattr(folder_module, "recover", lambda _work, _place: None)
    assert any("the next run found neither" in one for one in faults_of_kills(Case("each", tmp_path), step=5))


@posix
def test_kills_show_a_writer_that_moves_one_by_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The mutant: what is called one step is several."""
    monkeypatch.setattr(swap, "_exchangeable", lambda _target: False)
    assert any("neither old nor new" in one for one in faults_of_kills(Case("exchange", tmp_path), step=5))


def faults_of_interrupts(case: Case, step: int = 1) -> list[str]:
    """What is wrong after Ctrl-C at every moment."""
    case.prepare()
    found = []
    for at in range(1, moments(case.write) + 1, step):
        case.prepare()
        ended = False
        with suppress(KeyboardInterrupt), blow(at, interrupt):
            case.write()
            ended = True
        left = case.state()
        if left not in ((case.after,) if ended else (case.before, case.after)):
            found.append(f"moment {at}: ended {ended}: {left}")
        if case.beside():
            found.append(f"moment {at}: left behind: {case.beside()}")
    return found


@unclosed
def test_an_interrupted_writer_leaves_the_old_or_the_new_and_nothing_else(case: Case) -> None:
    assert faults_of_interrupts(case, step=2) == []


@unclosed
@pytest.mark.parametrize("way", ["each"])
def test_interrupts_show_a_writer_that_takes_nothing_back(
    way: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The mutant: the way back is gone."""
    monkeypatch.setattr(swap, "_exchangeable", lambda _target: False)
    monkeypatch.setattr(swap, "_put_back", lambda *_: None)
    assert faults_of_interrupts(Case(way, tmp_path), step=3)


def faults_of_refusals(case: Case, number: int, *, ever: bool, only: tuple[str, ...] = CALLS) -> list[str]:
    """What is wrong after the system refused a call, or all from one on."""
    case.prepare()
    with refusing(0, number, only=only) as calls:
        case.write()
    found = []
    for at in range(1, len(calls) + 1):
        case.prepare()
        ended = False
        with suppress(OSError, KeyboardInterrupt), refusing(at, number, ever=ever, only=only) as made:
            case.write()
            ended = True
        where = f"call {at} ({made[at - 1]}), ended {ended}"
        left = case.state()
        if not ever and left not in ((case.after,) if ended else (case.before, case.after)):
            found.append(f"{where}: {left}")
        require_writable(case.folder)  # the disk is well again
        if case.state() not in (case.before, case.after):
            found.append(f"{where}: the next run found neither: {case.state()}")
        if case.beside():
            found.append(f"{where}: left behind: {case.beside()}")
    return found


@pytest.mark.parametrize("number", NUMBERS)
@pytest.mark.parametrize("ever", [False, True], ids=["once", "from then on"])
def test_a_refused_call_leaves_the_old_or_the_new(case: Case, number: int, ever: bool) -> None:
    if ever and number < 0:
        pytest.skip("nobody interrupts every call")
    assert faults_of_refusals(case, number, ever=ever) == []


def test_refusals_show_a_writer_that_drops_the_old_when_the_way_back_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The mutant: what had been moved away goes with the passing folder in any case."""
    monkeypatch.setattr(swap, "_exchangeable", lambda _target: False)
    monkeypatch.setattr(folder_module, "has_plan", lambda _work: False)
    found = faults_of_refusals(Case("each", tmp_path), NUMBERS[0], ever=True, only=("rename",))
    assert any("the next run found neither" in one for one in found)


@posix
def test_two_writers_leave_one_of_both(case: Case) -> None:
    """And whoever looks meanwhile, through one opened folder, sees one of both as well."""
    contents = [{name: f"{name} of {who}".encode() * 200 for name in ("a", "b", "c/d")} for who in (1, 2)]
    wholes = [{**made, "c": b"/"} for made in contents]
    case.prepare()

    def writer(made: dict[str, bytes]) -> Work:
        def write() -> None:
            for _ in range(25):
                write_whole(made, case.folder)

        return write

    children = []
    for made in contents:
        child = os.fork()
        if child == 0:
            status = 1
            with suppress(BaseException):
                writer(made)()
                status = 0
            os._exit(status)
        children.append(child)
    statuses = [os.waitpid(child, 0)[1] for child in children]
    left = case.state()
    assert statuses == [0, 0]
    assert {name: left[name] for name in wholes[0]} in wholes
    assert case.beside() == []


@posix
def test_a_stopped_writer_is_named_after_a_while(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(folder_module, "_PATIENCE", 0.05)
    with folder_module._lock(tmp_path / "out") as sure:
        assert sure
        with pytest.raises(ScenarioError, match="another process has been writing here for"):
            write_whole(MADE, tmp_path / "out")
        assert not (tmp_path / "out").exists()
        with monkeypatch.context() as mutant:  # it is the lock that kept it away
            mutant.setattr(folder_module, "_locked", lambda _handle, _place: False)
            write_whole(MADE, tmp_path / "out")
    write_whole(MADE, tmp_path / "out")


def test_without_locks_only_what_is_a_day_old_is_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(folder_module, "_locked", lambda _handle, _place: False)
    fresh, stale, theirs = (tmp_path / name for name in (passing_name("out"), passing_name("out"), ".out.backup"))
    for one in (fresh, stale, theirs):
        (one / "new").mkdir(parents=True)
    os.utime(stale, (time.time() - 1e5,) * 2)
    os.utime(theirs, (time.time() - 1e5,) * 2)
    write_whole(MADE, tmp_path / "out")
    assert (fresh.exists(), stale.exists(), theirs.exists()) == (True, False, True)


@pytest.mark.parametrize("name", ["../victim", "..", "", "a/b"])
def test_a_plan_that_leads_elsewhere_is_no_plan(name: str, tmp_path: Path) -> None:
    (tmp_path / "victim").write_text("mine")
    work = tmp_path / passing_name("out")
    (work / "old").mkdir(parents=True)
    (work / "new").mkdir()
    (work / "plan.json").write_text(f'{{"made": ["{name}"], "earlier": []}}')
    (tmp_path / "out").mkdir()
    require_writable(tmp_path / "out")
    assert (tmp_path / "victim").read_text() == "mine"
    assert not work.exists()


@pytest.mark.skipif(swap._exchanger() is None, reason="this system exchanges no two folders in one step")
def test_a_folder_is_exchanged_unless_somebody_stands_in_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case = Case("exchange", tmp_path)
    case.prepare()
    number = case.folder.stat().st_ino
    case.write()
    assert case.folder.stat().st_ino != number
    number = case.folder.stat().st_ino
    monkeypatch.chdir(case.folder / "kept")
    case.write()
    assert case.folder.stat().st_ino == number
    assert case.state() == NEW
    write_whole(MADE, Path(os.pardir))
    assert case.state() == NEW


@posix
def test_links_rights_and_times_of_what_stays(tmp_path: Path) -> None:
    case = Case("exchange", tmp_path)
    case.prepare()
    notes, link = case.folder / "notes.txt", case.folder / "kept" / "link"
    notes.chmod(0o640)
    os.utime(notes, (1e9, 1e9))
    case.folder.chmod(0o750)
    link.symlink_to("../notes.txt")
    earlier = notes.stat()
    (tmp_path / "name").symlink_to(case.folder, target_is_directory=True)
    assert write_whole(MADE, tmp_path / "name")[0] == tmp_path / "name" / "report.html"
    assert (tmp_path / "name").is_symlink() and case.beside() == []
    assert notes.samefile(case.folder / "notes.txt") and notes.stat().st_mtime == 1e9
    assert (notes.stat().st_ino, notes.stat().st_mode) == (earlier.st_ino, earlier.st_mode)
    assert case.folder.stat().st_mode & 0o777 == 0o750
    assert link.readlink() == Path("../notes.txt")


@pytest.mark.skipif(swap._exchanger() is None, reason="this system exchanges no two folders in one step")
def test_what_others_write_meanwhile_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case = Case("exchange", tmp_path)
    case.prepare()
    exchange = swap._exchange

    def late(new: Path, target: Path) -> None:
        (target / "late.txt").write_text("late")
        (target / "kept" / "late.csv").write_text("3,4")
        passing = target / "kept" / "passing"
        passing.write_text("5,6")
        passing.replace(target / "kept" / "data.csv")
        exchange(new, target)

    monkeypatch.setattr(swap, "_exchange", late)
    case.write()
    assert case.state() == {**NEW, "late.txt": b"late", "kept/late.csv": b"3,4", "kept/data.csv": b"5,6"}


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="nothing tells which file a number stands for")
def test_everything_is_on_the_disk_before_it_has_its_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A power cut keeps what was settled: each file made must be, before the folder gets its name."""
    case = Case("fresh", tmp_path)
    case.prepare()
    told: list[str] = []
    fsync, rename = os.fsync, Path.rename

    def settled(handle: int) -> None:
        told.append(Path(f"/proc/self/fd/{handle}").resolve().name)
        fsync(handle)

    def renamed(self: Path, target: Path) -> Path:
        told.append("RENAME")
        return rename(self, target)

    monkeypatch.setattr(os, "fsync", settled)
    monkeypatch.setattr(Path, "rename", renamed)
    with monkeypatch.context() as mutant:
        mutant.setattr(folder_module, "write_bytes", lambda file, content: write_bytes(file, content, durable=False))
        case.write()
    assert "report.html" not in told
    told.clear()
    case.prepare()
    case.write()
    assert sorted(told[: told.index("RENAME")]) == sorted(["report.html", "report.json", "b.svg", "figures"])
    assert "results" in told[told.index("RENAME") :]


@posix
def test_a_killed_process_is_seen_to_die(tmp_path: Path) -> None:
    """The instrument itself: a process struck at a moment dies of it, one that is not comes to its end."""
    write = Case("fresh", tmp_path).write
    assert not killed(write, 10**6)
    assert in_a_process(lambda: os.kill(os.getpid(), signal.SIGTERM)) == signal.SIGTERM
