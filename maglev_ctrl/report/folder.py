"""Several files put into a folder together: all of them, or those of before."""

from __future__ import annotations

import hashlib
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from maglev_ctrl.errors import ScenarioError
from maglev_ctrl.files import MARK, belongs_to, passing_name, settle_file, settle_folder, write_bytes
from maglev_ctrl.report.swap import NEW, has_plan, recover, settle, to_the_end

_PATIENCE: Final = 60.0  # [s] a folder is written in much less
_STALE: Final = 86400.0  # [s] where nobody can be asked whether a folder is being written


def write_whole(made: Mapping[str, bytes | Path], target: Path, *, replaced: Sequence[str] = ()) -> tuple[Path, ...]:
    """Files that stand in `target` when all are written, or else those of before; other files there are kept.

    Everything is made in a hidden folder beside `target` and is on the disk before it gets its place: a failure, an
    interrupt, a killed process or a power cut leaves it as it was. Two that write at once do so one after the other.

    Parameters
    ----------
    made : content by file name, or by "folder/file" for a folder that is exchanged as a whole; a path is a finished
        file on the same file system, which is moved
    target : made when it does not exist
    replaced : names of an earlier run that go even where none of their name is made now

    Returns
    -------
    paths of what stands in `target` now, folders for their files, in the order of `made`

    Raises
    ------
    OSError : it cannot be written; `target` is as it was
    ScenarioError : another process has been writing there for a minute

    Examples
    --------
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [path.name for path in write_whole({"a.txt": b"1", "data/b.txt": b"2"}, Path(folder) / "out")]
    ['a.txt', 'data']
    """
    names = tuple(dict.fromkeys(name.partition("/")[0] for name in made))
    place = target.resolve()
    place.parent.mkdir(parents=True, exist_ok=True)
    with _alone(place):
        work = place.with_name(passing_name(place.name))
        try:
            _write_beside(made, names, work, place, (*names, *replaced))
        finally:  # an interrupt has no moment in which the passing folder would stay
            if not has_plan(work):  # else a disk failed on the way back, too: the old files are in there
                shutil.rmtree(work, ignore_errors=True)
    return tuple(target / name for name in names)


def _write_beside(
    made: Mapping[str, bytes | Path], names: Sequence[str], work: Path, place: Path, every: Sequence[str]
) -> None:
    try:
        (work / NEW).mkdir(parents=True)
        for name, content in made.items():
            (work / NEW / name).parent.mkdir(exist_ok=True)
            if isinstance(content, Path):
                content.replace(work / NEW / name)
                settle_file(work / NEW / name)
            else:
                write_bytes(work / NEW / name, content)
        for name in names:
            if (work / NEW / name).is_dir():
                settle_folder(work / NEW / name)
        settle(work, place, made=names, every=tuple(dict.fromkeys(every)))
    except BaseException:  # an interrupt too
        recover(work, place)
        raise
    to_the_end(lambda: shutil.rmtree(work, ignore_errors=True))


@contextmanager
def _alone(place: Path) -> Iterator[None]:
    """Write while no other process does; what a killed one left is taken back and removed before."""
    with _lock(place) as sure:
        _clear(place, sure=sure)
        yield


def _clear(place: Path, *, sure: bool) -> None:
    for work in place.parent.iterdir():
        if not belongs_to(work.name, place.name):
            continue
        with suppress(OSError):
            found = work.lstat()
            mine = os.name == "nt" or found.st_uid == os.geteuid()
            if not mine or not (sure or time.time() - found.st_mtime > _STALE) or not work.is_dir():
                continue
            recover(work, place)
            shutil.rmtree(work)


@contextmanager
def _lock(place: Path) -> Iterator[bool]:
    """Hold the folder around it, which leaves no file behind; False where the file system knows no locks."""
    handle = -1
    with suppress(OSError):
        if sys.platform == "win32":
            name = hashlib.sha256(os.fsencode(place)).hexdigest()[:16]
            handle = os.open(Path(tempfile.gettempdir()) / f"{MARK}-{name}.lock", os.O_RDWR | os.O_CREAT)
        else:
            handle = os.open(place.parent, os.O_RDONLY)
    try:
        yield handle >= 0 and _locked(handle, place)
    finally:
        if handle >= 0:
            os.close(handle)


def _locked(handle: int, place: Path) -> bool:
    end = time.monotonic() + _PATIENCE
    while True:
        try:
            if sys.platform == "win32":
                import msvcrt

                msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
            else:
                import fcntl

                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except (BlockingIOError, PermissionError):
            if time.monotonic() > end:
                raise ScenarioError(
                    f"{place}: another process has been writing here for {_PATIENCE:g} s; end it, or choose another"
                    " folder with --out"
                ) from None
            time.sleep(0.01)
        except OSError:
            return False
        else:
            return True


def require_writable(folder: Path, *, results: str = "") -> None:
    """Find out before minutes of work whether results can be written; nothing is left behind.

    What a killed run left there half done is taken back.

    Parameters
    ----------
    results : what they are, in the words of the message

    Raises
    ------
    ScenarioError : it is a file, or it or the folder it stands in cannot be written
    """
    if folder.exists() and not folder.is_dir():
        purpose = f" for the {results}" if results else ""
        raise ScenarioError(f"{folder}: expected a folder{purpose}, got a file; choose another with --out")
    # Results are made beside their folder and moved into place, so both have to be writable.
    whole = folder.resolve()
    for place in {_nearest(whole), _nearest(whole.parent)}:
        try:
            Path(tempfile.mkdtemp(prefix=".maglev-ctrl-", dir=place)).rmdir()
        except OSError as error:
            what = f"the {results} cannot" if results else "cannot"
            raise ScenarioError(
                f"{folder}: {what} be written ({place}: {error.strerror or error}); choose another folder with --out"
            ) from None
    if whole.parent.is_dir():
        with _alone(whole):
            pass


def _nearest(path: Path) -> Path:
    return next((one for one in (path.absolute(), *path.absolute().parents) if one.exists()), Path.cwd())
