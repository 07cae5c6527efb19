"""Single files and what is kept between runs: whole or not at all, whatever stops the writer; nobody writes else."""

from __future__ import annotations

import ast
import os
import re
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from atomic_moments import NUMBERS, Work, blow, interrupt, killed, moments, refusing

from maglev_ctrl.cli import main
from maglev_ctrl.files import belongs_to, clear_leftovers, passing_name, put_file, put_new_file
from maglev_ctrl.study import force_cache
from maglev_ctrl.study.map.store import FolderStore

posix = pytest.mark.skipif(os.name == "nt", reason="processes are forked and killed")
unclosed = pytest.mark.filterwarnings(
    "ignore::pytest.PytestUnraisableExceptionWarning", "ignore::ResourceWarning",
)  # fmt: skip
OLD, NEW = b"old", b"new" * 1000


class One:
    """A file, how it is written, and what may be found of it."""

    def __init__(self, folder: Path, write: Work, read: Callable[[], object], whole: object) -> None:
        self.folder, self.write, self.read, self.whole = folder, write, read, whole


def replaced(folder: Path) -> One:
    file = folder / "a.json"
    file.write_bytes(OLD)
    return One(folder, lambda: put_file(file, NEW), file.read_bytes, NEW)


def fresh(folder: Path) -> One:
    file = folder / "a.toml"
    return One(folder, lambda: put_new_file(file, NEW), lambda: file.read_bytes() if file.exists() else None, NEW)


def store(folder: Path) -> One:
    kept = FolderStore(folder)

    def read() -> object:
        found = kept.get("part")
        return None if found is None else float(found["values"][-1])

    return One(folder, lambda: kept.put("part", {"values": np.arange(500.0)}), read, 499.0)


def cache(folder: Path) -> One:
    key = "a" * 64
    return One(folder, lambda: force_cache.keep_error(key, 0.5), lambda: force_cache.kept_error(key), 0.5)


def faults(
    make: Callable[[Path], One], folder: Path, strike: Callable[[One, int], None], count: int, step: int = 1
) -> list[str]:
    """What is wrong after a writer was stopped at each moment: neither nothing nor all, or something left behind."""
    found = []
    for at in range(1, count + 1, step):
        place = folder / str(at)
        place.mkdir(parents=True)
        os.environ[force_cache.FOLDER] = str(place)
        one = make(place)
        before = one.read()
        strike(one, at)
        now = one.read()
        if before == one.whole or now not in (before, one.whole):
            found.append(f"moment {at}: {now!r}")
    return found


@pytest.fixture(params=[replaced, fresh, store, cache], ids=lambda make: make.__name__)
def make(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[[Path], One]:
    monkeypatch.setenv(force_cache.FOLDER, str(tmp_path))
    return request.param


def count_of(make: Callable[[Path], One], folder: Path) -> int:
    folder.mkdir()
    os.environ[force_cache.FOLDER] = str(folder)
    return moments(make(folder).write)


@posix
def test_a_killed_writer_leaves_nothing_or_all(make: Callable[[Path], One], tmp_path: Path) -> None:
    def strike(one: One, at: int) -> None:
        assert killed(one.write, at)
        for left in one.folder.iterdir():
            assert left.name.startswith(".") or one.read() is not None
        clear_leftovers(one.folder, stale=-1.0)
        assert not [left.name for left in one.folder.iterdir() if left.name.startswith(".")]

    assert faults(make, tmp_path / "kills", strike, count_of(make, tmp_path / "count"), 2) == []


@unclosed
def test_an_interrupted_writer_leaves_nothing_or_all_and_nothing_else(
    make: Callable[[Path], One], tmp_path: Path
) -> None:
    left_behind = []

    def strike(one: One, at: int) -> None:
        with suppress(KeyboardInterrupt), blow(at, interrupt):
            one.write()
        left_behind.extend(left.name for left in one.folder.iterdir() if left.name.startswith("."))

    count = count_of(make, tmp_path / "count")
    assert faults(make, tmp_path / "interrupts", strike, count) == []
    assert left_behind == []


@pytest.mark.parametrize("number", NUMBERS)
def test_a_refused_call_leaves_nothing_or_all(make: Callable[[Path], One], number: int, tmp_path: Path) -> None:
    (tmp_path / "count").mkdir()
    os.environ[force_cache.FOLDER] = str(tmp_path / "count")
    with refusing(0, number) as calls:
        make(tmp_path / "count").write()

    def strike(one: One, at: int) -> None:
        with suppress(OSError, KeyboardInterrupt), refusing(at, number):
            one.write()

    assert faults(make, tmp_path / "refusals", strike, len(calls)) == []


def test_the_moments_show_a_writer_that_writes_in_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The mutant: what `new` and `schema` once did."""

    def in_place(file: Path, content: bytes, *, durable: bool = True) -> None:
        with file.open("wb") as stream:
            for part in range(0, len(content), 1000):
                stream.write(content[part : part + 1000])
                stream.flush()
                if part == 1000 and broken:
                    raise KeyboardInterrupt

    broken: list[int] = []

    def strike(one: One, _at: int) -> None:
        broken.append(1)
        with suppress(KeyboardInterrupt):
            one.write()
        broken.clear()

    def make(folder: Path) -> One:
        file = folder / "a.json"
        return One(folder, lambda: in_place(file, NEW), lambda: file.read_bytes() if file.exists() else None, NEW)

    assert faults(make, tmp_path, strike, 1) != []


def test_a_file_that_is_cut_counts_as_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is not settled on the disk may be empty after a power cut, so the readers must find it out."""
    monkeypatch.setenv(force_cache.FOLDER, str(tmp_path))
    force_cache.keep_error("a" * 64, 0.5)
    kept = FolderStore(tmp_path / "parts")
    kept.put("part", {"values": np.arange(50.0)})
    (cached,), (part,) = tmp_path.glob("*.npz"), (tmp_path / "parts").glob("*.npz")
    for file, read in ((cached, lambda: force_cache.kept_error("a" * 64)), (part, lambda: kept.get("part"))):
        whole = file.read_bytes()
        assert read() is not None
        for size in (0, 1, 30, len(whole) // 2, len(whole) - 1):
            for content in (whole[:size], whole[:size] + bytes(len(whole) - size)):
                if content == whole:  # it ends with zeros
                    continue
                file.write_bytes(content)
                assert read() is None, (file.name, size)


@posix
def test_a_new_file_never_takes_the_place_of_another(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    put_new_file(file, b"first")
    with pytest.raises(FileExistsError):
        put_new_file(file, b"second")
    assert file.read_bytes() == b"first"
    link = tmp_path / "link.toml"
    link.symlink_to(tmp_path / "nowhere")
    with pytest.raises(FileExistsError):
        put_new_file(link, b"second")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["link.toml", "mine.toml"]


def test_a_file_made_meanwhile_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Between the look and the step, with links and without."""
    file, link = tmp_path / "mine.toml", os.link

    def no_links(_source: Path, _target: Path) -> None:
        raise OSError("no links here")

    for how in (link, no_links):

        def meanwhile(source: Path, target: Path, how: Callable[[Path, Path], None] = how) -> None:
            file.write_bytes(b"theirs")
            how(source, target)

        file.unlink(missing_ok=True)
        monkeypatch.setattr(os, "link", meanwhile)
        with pytest.raises(FileExistsError):
            put_new_file(file, b"ours")
        assert file.read_bytes() == b"theirs"
    monkeypatch.setattr(os, "link", no_links)
    file.unlink()
    put_new_file(file, b"ours")
    assert file.read_bytes() == b"ours"
    assert [path.name for path in tmp_path.iterdir()] == ["mine.toml"]


def test_leftovers_are_told_from_what_people_make(tmp_path: Path) -> None:
    for name in (passing_name("a"), ".a.maglev-ctrl-notes", "a.maglev-ctrl-01234567", ".maglev-ctrl-01234567"):
        (tmp_path / name).write_text("x")
    folder = tmp_path / passing_name("folder")
    folder.mkdir()
    clear_leftovers(tmp_path)
    assert len(list(tmp_path.iterdir())) == 5  # a moment old
    for path in tmp_path.iterdir():
        os.utime(path, (time.time() - 7200.0,) * 2)
    clear_leftovers(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir() if path != folder) == [
        ".a.maglev-ctrl-notes", ".maglev-ctrl-01234567", "a.maglev-ctrl-01234567",
    ]  # fmt: skip
    assert folder.exists()
    long = "ä" * 120
    assert belongs_to(passing_name(long), long) and len(passing_name(long).encode()) < 255


@pytest.mark.parametrize(("words", "name"), [(["new", "car"], "car.toml"), (["schema"], "scenario.schema.json")])
def test_verbs_write_their_file_whole(
    words: list[str], name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    told = [*words, "--out", str(tmp_path / "there")]
    with refusing(1, NUMBERS[0], only=("fsync",)):
        assert main(told) == 2
    assert "No space left on device" in capsys.readouterr().err
    assert list((tmp_path / "there").iterdir()) == []
    killed_long_ago = tmp_path / "there" / passing_name(name)
    killed_long_ago.write_text("half")
    os.utime(killed_long_ago, (time.time() - 7200.0,) * 2)
    assert main(told) == 0
    assert [path.name for path in (tmp_path / "there").iterdir()] == [name]


PACKAGE = Path(__file__).resolve().parents[2] / "maglev_ctrl"
WRITES = {
    "write_text", "write_bytes", "savez", "savez_compressed", "savetxt", "to_zarr", "to_pickle", "copyfile", "copytree",
    "mkstemp", "mkdtemp", "NamedTemporaryFile", "symlink_to", "hardlink_to", "rmtree", "unlink", "rmdir", "touch",
    "tofile", "copy2",
}  # fmt: skip
WRITERS = {
    "files.py": "the pieces that write", "report/folder.py": "a folder of results", "report/swap.py": "its last step",
    "study/force_cache.py": "savez into memory", "study/map/store.py": "savez into memory, and removes its parts",
    "study/sweep/store.py": "a Zarr store, checked when it is read", "report/sweep/arrays.py": "into a passing folder",
    "report/sweep/folder.py": "the folder of a sweep", "study/sweep/cluster.py": "files of a scheduler",
}  # fmt: skip


_WORDS = re.compile(rf"\b(?:{'|'.join([*WRITES, 'open', 'File', 'to_netcdf', 'savefig', 'move', 'rename', 'link'])})\(")


def writers(files: list[tuple[str, str]]) -> set[str]:
    """Files that call what puts something on the disk, or takes it away."""
    found = set()
    for name, text in files:
        if not _WORDS.search(text):
            continue
        for node in ast.walk(ast.parse(text)):
            if not isinstance(node, ast.Call):
                continue
            called = getattr(node.func, "attr", getattr(node.func, "id", ""))
            modes = [value.value for value in (*node.args, *(word.value for word in node.keywords))
                     if isinstance(value, ast.Constant) and isinstance(value.value, str)]  # fmt: skip
            opened = called in ("open", "File") and any(set(mode) & set("wxa+") and len(mode) <= 3 for mode in modes)
            into = called in ("to_netcdf", "savefig") and bool(node.args) and not _in_memory(node)
            moved = called in ("move", "rename", "link") and bool(node.args)
            if called in WRITES or opened or into or moved:
                found.add(name)
    return found


def _in_memory(node: ast.Call) -> bool:
    return isinstance(node.args[0], ast.Name) and node.args[0].id in ("stream", "buffer", "content")


def test_nothing_else_writes() -> None:
    files = [(path.relative_to(PACKAGE).as_posix(), path.read_text(encoding="utf-8")) for path in PACKAGE.rglob("*.py")]
    assert writers(files) - set(WRITERS) == set()


@pytest.mark.parametrize(
    "line",
            ["Path('a').write_text('b')", "open('a', 'w')", "x.open(mode='ab')", "np.savez('a', b=1)", 
             "h5py.File('a', 'w')",
             "figure.savefig(path)", "data.to_netcdf(path)", "shutil.move('a', 'b')"],
)  # fmt: skip
def test_a_writer_is_seen(line: str) -> None:
    assert writers([("a.py", line)]) == {"a.py"}
    assert (
        writers([("a.py", "figure.savefig(stream)\ndata.to_netcdf(engine='scipy')\nx.open('rb')\na.replace('w', 'x')")])
        == set()
    )
