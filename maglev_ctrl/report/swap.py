"""New entries of a folder put in the place of the old ones: in one step of the system where it has one."""

from __future__ import annotations

import ctypes
import json
import os
import shutil
import stat
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Final

from maglev_ctrl.files import put_file, settle_folder

NEW: Final = "new"
_OLD: Final = "old"
_PLAN: Final = "plan.json"
_LINKS: Final = 1000
_AT_FDCWD: Final = -100
_EXCHANGE: Final = 2  # RENAME_EXCHANGE of Linux and RENAME_SWAP of macOS


def settle(work: Path, target: Path, *, made: Sequence[str], every: Sequence[str]) -> None:
    """Let what stands in `work/new` be in `target`, and what of before is in `every` no longer.

    A folder that holds little else is exchanged as a whole, which is one step: a process that is killed leaves the old
    state or the new one. Where that cannot be (it is somebody's working directory or a mounted one, it holds much else,
    or the system has no such step) entries are moved one by one; what is needed to take that back is written before.

    Parameters
    ----------
    work : beside `target`, on the same file system; what it holds afterwards is of no use to anybody
    made : names of the entries of `work/new`
    every : these and the names that go

    Raises
    ------
    OSError : it cannot be done; `target` is as it was
    """
    new = work / NEW
    if not os.path.lexists(target):
        new.rename(target)
        settle_folder(target.parent)
        return
    earlier = [name for name in every if os.path.lexists(target / name)]
    touched = [name for name in every if name in made or name in earlier]
    if len(touched) == 1 and (new / touched[0]).is_file() and not (target / touched[0]).is_dir():
        (new / touched[0]).replace(target / touched[0])
    elif not (_exchangeable(target) and _exchange_whole(new, target, every)):
        _move_each(work, target, made, earlier)
    to_the_end(lambda: settle_folder(target))
    to_the_end(lambda: settle_folder(target.parent))


def recover(work: Path, target: Path) -> None:
    """Take back what a killed process had half done, after which `work` is of no use.

    Raises
    ------
    OSError : it cannot be done; `work` has to stay
    """
    plan = _plan(work)
    if plan is not None:
        _put_back(work, target, *plan)


def has_plan(work: Path) -> bool:
    """Whether old entries are in there, on their way."""
    return (work / _PLAN).exists()


def _exchangeable(target: Path) -> bool:
    return _exchanger() is not None and target.is_dir() and not target.is_mount() and not _stands_in(target)


def _stands_in(target: Path) -> bool:
    """Whether it holds the working directory of a process, which would go on standing in the old one."""
    places = []
    with suppress(OSError):  # our own may be gone
        places.append(Path.cwd())
    if sys.platform == "linux":
        for one in Path("/proc").iterdir():
            with suppress(OSError):  # it has ended meanwhile, or is somebody else's
                if one.name.isdigit():
                    places.append((one / "cwd").readlink())
    return any(place.is_relative_to(target) for place in places)


def _exchange_whole(new: Path, target: Path, every: Sequence[str]) -> bool:
    """Give `new` all that `target` keeps and exchange both; False where that cannot be, with nothing changed."""
    own = {one.name for one in new.iterdir()}
    before = new.stat()
    try:
        _bring_along(target, new, skipped=set(every), left=_LINKS)
        _same_rights(target, new)
        settle_folder(new)
        _exchange(new, target)
    except (OSError, NotImplementedError):
        for one in new.iterdir():
            if one.name not in own:
                remove(one)
        return False
    except BaseException:  # an interrupt, perhaps a moment too late
        if os.path.samestat(target.stat(), before):
            _exchange(new, target)
        raise
    to_the_end(lambda: _bring_late(new, target, skipped=set(every)))
    return True


def _bring_along(source: Path, place: Path, *, skipped: set[str], left: int) -> int:
    """Second names for all files of a folder and of those in it; how many more there may be."""
    with os.scandir(source) as entries:
        found = [entry for entry in entries if entry.name not in skipped]
    for entry in found:
        left -= 1
        kind = entry.stat(follow_symlinks=False).st_mode
        if left < 0 or not (stat.S_ISREG(kind) or stat.S_ISLNK(kind) or stat.S_ISDIR(kind)):
            raise NotImplementedError(entry.path)
        if stat.S_ISDIR(kind):
            (place / entry.name).mkdir()
            left = _bring_along(Path(entry.path), place / entry.name, skipped=set(), left=left)
            _same_rights(Path(entry.path), place / entry.name)
        else:
            os.link(entry.path, place / entry.name, follow_symlinks=False)
    return left


def _same_rights(source: Path, place: Path) -> None:
    old, now = source.stat(), place.stat()
    if (old.st_uid, old.st_gid) != (now.st_uid, now.st_gid):
        os.chown(place, old.st_uid, old.st_gid)
    shutil.copystat(source, place)
    os.utime(place)


def _bring_late(old: Path, target: Path, *, skipped: set[str]) -> None:
    """What others wrote into the folder while it was being made anew."""
    for entry in old.iterdir():
        if entry.name in skipped:
            continue
        here = target / entry.name
        with suppress(OSError):
            if not os.path.lexists(here):
                entry.rename(here)
            elif entry.is_dir() and not entry.is_symlink():
                if here.is_dir():
                    _bring_late(entry, here, skipped=set())
            elif not os.path.samestat(entry.lstat(), here.lstat()):
                entry.replace(here)


def to_the_end(work: Callable[[], None]) -> None:
    """The new files are it already: an interrupt that comes now has nothing to stop, and must leave no half of this."""
    try:
        work()
    except KeyboardInterrupt:
        work()


def _exchange(one: Path, other: Path) -> None:
    call = _exchanger()
    if call is None:
        raise NotImplementedError("no exchange")
    ctypes.set_errno(0)
    if call(os.fsencode(one), os.fsencode(other)) != 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number), str(other))


@cache
def _exchanger() -> Callable[[bytes, bytes], int] | None:
    """The system's call that exchanges two names in one step; None where it has none."""
    system: str = sys.platform  # a type checker, too, looks at all of them
    try:
        library = ctypes.CDLL(None, use_errno=True)
        if system == "linux":
            at = library.renameat2
            at.argtypes = [ctypes.c_int, ctypes.c_char_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_uint]
            return lambda one, other: int(at(_AT_FDCWD, one, _AT_FDCWD, other, _EXCHANGE))
        if system == "darwin":
            swap = library.renamex_np
            swap.argtypes = [ctypes.c_char_p, ctypes.c_char_p, ctypes.c_uint]
            return lambda one, other: int(swap(one, other, _EXCHANGE))
    except (OSError, AttributeError, TypeError):
        return None
    return None


def _move_each(work: Path, target: Path, made: Sequence[str], earlier: Sequence[str]) -> None:
    plan = work / _PLAN
    (work / _OLD).mkdir()
    put_file(plan, json.dumps({"made": list(made), "earlier": list(earlier)}).encode())
    try:
        for name in dict.fromkeys((*made, *earlier)):
            if name in earlier:
                (target / name).rename(work / _OLD / name)
            if name in made:
                (work / NEW / name).rename(target / name)
        settle_folder(target)
        plan.unlink()  # from here on the new ones are it
    except BaseException:  # an interrupt too
        if plan.exists():
            _put_back(work, target, made, earlier)
            raise


def _put_back(work: Path, target: Path, made: Sequence[str], earlier: Sequence[str]) -> None:
    """The old entries where they were; may be done twice, or after half of it."""
    for name in dict.fromkeys((*made, *earlier)):
        moved_away = os.path.lexists(work / _OLD / name)
        if os.path.lexists(target / name) and (moved_away or name not in earlier):
            remove(work / NEW / name)
            (target / name).rename(work / NEW / name)
        if moved_away:
            (work / _OLD / name).rename(target / name)
    (work / _PLAN).unlink(missing_ok=True)


def _plan(work: Path) -> tuple[list[str], list[str]] | None:
    """What a killed process was about to move; None where it was moving nothing, or somebody else wrote the file."""
    try:
        found = json.loads((work / _PLAN).read_text(encoding="utf-8"))
        made, earlier = ([str(name) for name in found[key]] for key in ("made", "earlier"))
    except (OSError, ValueError, KeyError, TypeError):
        return None
    plain = all(name == Path(name).name and name not in ("", os.pardir) for name in (*made, *earlier))
    return (made, earlier) if plain else None


def remove(path: Path) -> None:
    """A file, a link or a folder with all in it."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
