"""The page's state: undo, address, uploads, where files may be read and handed out, reports as processes."""

from __future__ import annotations

import base64
import json
import os
import sys
import time
import zlib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maglev_ctrl.scenario.limits import SIZE_LIMIT
from maglev_ctrl.scenario.problems import ScenarioProblems
from maglev_ctrl.workbench.jobs import ReportJobs, report_folder
from maglev_ctrl.workbench.listening import PortTaken, bound_socket, loopback, own_hosts
from maglev_ctrl.workbench.share import ADDRESS_LIMIT, address_of, packed, state_of
from maglev_ctrl.workbench.sources import UPLOADED, file_stem, find_sources
from maglev_ctrl.workbench.state import History, PageState, read_values, with_value

FIRST = PageState("paper/double_l", "double_l", "format = 1\n")
VALUES = st.dictionaries(st.text(min_size=1, max_size=20), st.floats(allow_nan=False, allow_infinity=False, width=32))


def drag(history: History, gesture: str, *speeds: float) -> None:
    for speed in speeds:
        history.put(with_value(history.now, {"speed": speed}), gesture=gesture)


def test_a_drag_is_one_step_and_undo_leads_back_through_every_step() -> None:
    history = History(FIRST)
    drag(history, "a", 1.0, 2.0, 3.0)
    drag(history, "b", 4.0)
    history.put(PageState(UPLOADED, "mine", "other"))
    assert [history.undo().values for _ in range(3)] == [(("speed", 4.0),), (("speed", 3.0),), ()]
    assert not history.can_undo and history.undo() == FIRST
    assert [history.redo().values for _ in range(3)] == [(("speed", 3.0),), (("speed", 4.0),), ()]
    assert not history.can_redo and history.now.name == "mine"


def test_a_gesture_does_not_go_on_after_an_undo_and_a_new_step_ends_redo() -> None:
    history = History(FIRST)
    drag(history, "a", 1.0)
    drag(history, "b", 2.0)
    history.undo()
    drag(history, "a", 5.0)
    assert not history.can_redo
    assert history.undo().values == (("speed", 1.0),)


def test_history_is_bounded() -> None:
    history = History(FIRST)
    for step in range(1000):
        drag(history, str(step), float(step + 1))
    steps = 0
    while history.can_undo:
        history.undo()
        steps += 1
    assert 100 < steps < 400


@settings(max_examples=60, deadline=None)
@given(text=st.text(max_size=300), name=st.text(max_size=40), option=st.text(max_size=40), values=VALUES)
def test_an_edited_state_comes_back_from_its_address(
    text: str, name: str, option: str, values: dict[str, float]
) -> None:
    state = PageState("paper/double_l", name, text, option, tuple(sorted(values.items())), edited=True)
    address = address_of(state)
    assert address is not None and address.startswith("#s=") and address.isascii()
    assert state_of("", address) == state


def test_a_shipped_state_comes_back_with_its_values() -> None:
    state = PageState("paper/double_l", "double_l", "", "passive & co", (("depth", 0.05), ("vehicle.a.damping", 1e-7)))
    address = address_of(state)
    assert address is not None and address.startswith("?scenario=paper%2Fdouble_l&option=passive+%26+co")
    assert state_of(address, "") == state
    assert state_of("", "") is None


def squeezed(content: bytes) -> str:
    return "#s=" + base64.urlsafe_b64encode(zlib.compress(content, 9)).decode().rstrip("=")


@pytest.mark.parametrize(
    ("search", "fragment", "words"),
    [
        ("", "#s=%%%%", "cut or changed"),
        ("", "#s=AAAA", "cut or changed"),
        ("", packed(PageState("", "a", "b"))[:-6], "cut or changed"),
        ("", squeezed(b"[" * 30_000), "cut or changed"),
        ("", squeezed(b"[1, 2]"), "cut or changed"),
        ("", squeezed(b'{"source": 1, "name": "", "text": ""}'), "cut or changed"),
        ("", squeezed(b'{"source": "", "name": "", "text": "", "values": {"a": "b"}}'), "finite number"),
        ("", squeezed(b'{"source": "", "name": "", "text": "", "values": {"a": 1e999}}'), "finite number"),
        ("", "#s=" + "A" * (ADDRESS_LIMIT + 1), "too long"),
        ("?scenario=paper/double_l&speed=fast", "", 'gives speed as "fast"'),
        ("?scenario=paper/double_l&speed=nan", "", "finite"),
        ("?scenario=" + "x" * 9000, "", "too long"),
    ],
)
def test_a_broken_address_is_told_in_words(search: str, fragment: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        state_of(search, fragment)


def test_a_bomb_is_not_unpacked() -> None:
    """Thousand million zeros pack into an address; what comes out is bounded by what a scenario may have."""
    squeeze = zlib.compressobj(9)
    content = b"".join(squeeze.compress(bytes(10**6)) for _ in range(30)) + squeeze.flush()
    bomb = "#s=" + base64.urlsafe_b64encode(content).decode().rstrip("=")
    assert len(bomb) < ADDRESS_LIMIT
    import tracemalloc

    tracemalloc.start()
    with pytest.raises(ValueError, match="cut or changed"):
        state_of("", bomb)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 8 * SIZE_LIMIT
    whole = squeezed(json.dumps({"source": "", "name": "", "text": "x" * (SIZE_LIMIT + 1)}).encode())
    with pytest.raises(ValueError, match="1 MiB"):
        state_of("", whole)


def test_a_text_too_long_for_an_address_has_none() -> None:
    state = PageState("", "noise", os.urandom(90_000).hex(), edited=True)
    assert address_of(state) is None
    assert state_of("", packed(state), limit=4 * SIZE_LIMIT) == state


@pytest.mark.parametrize("values", [[1], {"a": "1"}, {"a": True}, {"a": float("nan")}, {1: 2}, {"a": 10**400}, None])
def test_values_that_are_none(values: object) -> None:
    with pytest.raises(ValueError, match="expected"):
        read_values(values)


TABLE = """format = 1
title = "x"
[forces]
model = "table"
file = "{file}"
"""


@pytest.mark.parametrize("file", ["/etc/passwd", "../secret.csv", "a/../../secret.csv"])
def test_an_uploaded_text_reads_no_file(tmp_path: Path, file: str) -> None:
    """Whatever path it names: only the empty folder counts."""
    (tmp_path / "empty").mkdir()
    (tmp_path / "secret.csv").write_text("speed,height\n1,2\n")
    shipped = Path("scenarios")
    sources = find_sources(None, shipped=shipped, here=tmp_path, empty_folder=tmp_path / "empty")
    base = sources.text("periodic/girder_passing")
    head, _, rest = base.partition("[forces]")
    after = rest[rest.index("\n[") :]
    text = f'{head}[forces]\nmodel = "table"\nfile = "{file}"\n{after}'
    with pytest.raises(ScenarioProblems) as told:
        sources.read(text, key=UPLOADED, name="../../evil.toml")
    said = str(told.value)
    assert "expected a file in the scenario's folder or below it" in said
    assert str(tmp_path) not in said and "root:" not in said


def test_a_text_over_a_mebibyte_and_a_nest_of_tables_are_refused(tmp_path: Path) -> None:
    sources = find_sources(None, shipped=None, here=tmp_path, empty_folder=tmp_path)
    for text, words in (("#" * (SIZE_LIMIT + 1), "1 MiB"), ("a = " + "[" * 15_000, "nested"), ("", "empty")):
        with pytest.raises(ScenarioProblems, match=words):
            sources.read(text, key=UPLOADED, name="bomb")


def test_sources_of_a_folder_are_scenarios_only(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("format = 1\n")
    (tmp_path / "tool.toml").write_text("[tool]\n")
    given = tmp_path / "given.toml"
    given.write_text("format = 1\n")
    sources = find_sources(given, shipped=None, here=tmp_path, empty_folder=tmp_path)
    assert [one.key for one in sources.listed] == ["file/given", "here/mine"]
    assert "upload" in sources.words
    with pytest.raises(ScenarioProblems, match="no scenario of this name"):
        sources.text("../../etc/passwd")


def test_names_of_files_lead_nowhere_else() -> None:
    for name in ("../x", "..\\x", "/abs/x", "C:\\x", "x\0y", "...", "<script>", "a/b"):
        stem = file_stem(name)
        assert stem and not set(stem) & set('/\\<>:\0 "') and ".." not in stem.strip(".") and not stem.startswith(".")


# Reports as processes ----------------------------------------------------------------------------------------------

ECHO = """
import json, sys, pathlib
order = json.loads(sys.stdin.readline())
print(json.dumps({"what": "half", "fraction": 0.5}), flush=True)
folder = pathlib.Path(order["folder"]); folder.mkdir(parents=True)
(folder / "report.html").write_text("made")
print("a library talks", flush=True)
print(json.dumps({"done": ["report.html"]}), flush=True)
"""
WAIT = """
import json, os, sys
sys.stdin.readline()
print(json.dumps({"what": str(os.getpid()), "fraction": 0.1}), flush=True)
sys.stdin.read()
"""
STUBBORN = WAIT + "import time; time.sleep(60)\n"
FAULT = """
import json, sys
sys.stdin.readline()
print(json.dumps({"fault": "option a: no equilibrium"}), flush=True)
sys.exit(2)
"""


def jobs_of(tmp_path: Path, code: str) -> ReportJobs:
    return ReportJobs(tmp_path / "reports", command=(sys.executable, "-c", code))


def begun(jobs: ReportJobs, key: str = "0123456789abcdef"):
    return jobs.start("text", path=Path("x.toml"), name="car", scenario_hash=key)


def until(jobs: ReportJobs, wanted, key: str = "0123456789abcdef"):
    end = time.monotonic() + 20.0
    while time.monotonic() < end:
        view = jobs.view("car", key)
        if wanted(view):
            return view
        time.sleep(0.02)
    raise AssertionError(view)


def test_a_report_is_found_again_by_its_hash(tmp_path: Path) -> None:
    jobs = jobs_of(tmp_path, ECHO)
    assert jobs.view("car", "0123456789abcdef").status == "none"
    begun(jobs)
    done = until(jobs, lambda view: view.status != "running")
    assert (done.status, done.fraction, done.files) == ("done", 0.5, ("report.html",))
    later = ReportJobs(tmp_path / "reports").view("car", "0123456789abcdef")  # another server, another day
    assert (later.status, later.files) == ("done", ("report.html",))
    assert jobs.view("car", "ffff").status == "none"


def test_two_pages_share_one_process(tmp_path: Path) -> None:
    jobs = jobs_of(tmp_path, WAIT)
    begun(jobs)
    first = until(jobs, lambda view: view.fraction > 0.0)
    begun(jobs)
    assert jobs.view("car", "0123456789abcdef").words == first.words  # the process's own number
    jobs.close()


@pytest.mark.skipif(os.name == "nt", reason="processes are ended from outside in another way there")
def test_a_process_ended_from_outside_is_told(tmp_path: Path) -> None:
    jobs = jobs_of(tmp_path, WAIT)
    begun(jobs)
    os.kill(int(until(jobs, lambda view: view.fraction > 0.0).words), 9)
    lost = until(jobs, lambda view: view.status != "running")
    assert (lost.status, lost.files) == ("failed", ())
    assert "ended from outside" in lost.words and "nothing was written" in lost.words


def test_the_reason_of_a_failure_is_the_process_s_own(tmp_path: Path) -> None:
    jobs = jobs_of(tmp_path, FAULT)
    begun(jobs)
    assert until(jobs, lambda view: view.status == "failed").words == "option a: no equilibrium"


def gone(process: int) -> bool:
    try:
        os.kill(process, 0)
    except OSError:
        return True
    return False


@pytest.mark.parametrize("code", [WAIT, STUBBORN])
def test_no_process_outlives_the_server(tmp_path: Path, code: str) -> None:
    jobs = jobs_of(tmp_path, code)
    begun(jobs)
    process = int(until(jobs, lambda view: view.fraction > 0.0).words)
    jobs.close()
    assert os.name == "nt" or gone(process)
    with pytest.raises(ValueError, match="being made already"):
        begun(jobs, "ffff")


def test_cancelling_ends_the_process_and_says_so(tmp_path: Path) -> None:
    jobs = jobs_of(tmp_path, WAIT)
    begun(jobs)
    until(jobs, lambda view: view.fraction > 0.0)
    jobs.cancel("car", "0123456789abcdef")
    assert jobs.view("car", "0123456789abcdef").status == "cancelled"
    jobs.close()


def test_only_so_many_at_once(tmp_path: Path) -> None:
    jobs = jobs_of(tmp_path, WAIT)
    begun(jobs, "a" * 12)
    begun(jobs, "b" * 12)
    with pytest.raises(ValueError, match="2 reports"):
        begun(jobs, "c" * 12)
    jobs.close()


def test_only_reports_are_handed_out(tmp_path: Path) -> None:
    jobs = ReportJobs(tmp_path / "reports")
    folder = tmp_path / "reports" / report_folder("car", "0" * 12)
    folder.mkdir(parents=True)
    (folder / "report.html").write_text("x")
    (folder / "other.txt").write_text("x")
    (tmp_path / "report.html").write_text("outside")
    assert jobs.file(folder.name, "report.html") == (folder / "report.html").resolve()
    for place, name in ((folder.name, "other.txt"), ("..", "report.html"), (".", "report.html"), ("", "report.html"),
                        (folder.name, "../report.html"), (f"../reports/{folder.name}", "report.html")):  # fmt: skip
        assert jobs.file(place, name) is None
    if os.name != "nt":
        (tmp_path / "reports" / "link").symlink_to(tmp_path)
        assert jobs.file("link", "report.html") is None


# Where the page listens --------------------------------------------------------------------------------------------


def test_a_taken_port_is_told_or_passed_over() -> None:
    with bound_socket("127.0.0.1", None) as taken:
        number = taken.getsockname()[1]
        with pytest.raises(PortTaken, match=f"port {number} cannot be used"):
            bound_socket("127.0.0.1", number)
        with bound_socket("127.0.0.1", None) as other:
            assert other.getsockname()[1] != number
    with pytest.raises(PortTaken, match="address of this machine"):
        bound_socket("no such address", 5006)


def test_who_may_ask() -> None:
    assert own_hosts("127.0.0.1", 80) >= {"localhost:80", "127.0.0.1:80", "localhost", "127.0.0.1"}
    assert "evil.example:5006" not in own_hosts("127.0.0.1", 5006)
    assert own_hosts("::1", 5006) == {"localhost:5006", "[::1]:5006"}
    assert "192.0.2.1:5006" in own_hosts("192.0.2.1", 5006) and not loopback("192.0.2.1")
