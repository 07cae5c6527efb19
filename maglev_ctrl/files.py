"""Files that appear whole or not at all: made beside their place under a passing name, then moved into it."""

from __future__ import annotations

import errno
import os
import re
import secrets
import time
from contextlib import suppress
from pathlib import Path
from typing import Final

MARK: Final = "maglev-ctrl"
"""In the names of everything that passes: `.NAME.maglev-ctrl-0123abcd`, beside what NAME will be."""
_STALE: Final = 3600.0  # [s] nothing is being written for an hour
_LONG: Final = 200  # bytes of a name; file systems take 255
_TRIES: Final = 20


def passing_name(name: str) -> str:
    """A fresh name for what will be `name`; hidden, and told from everything that people make.

    Examples
    --------
    >>> belongs_to(passing_name("report.html"), "report.html"), belongs_to(passing_name("a"), "b")
    (True, False)
    """
    return f"{_head(name)}{secrets.token_hex(4)}"


def belongs_to(passing: str, name: str) -> bool:
    """Whether a name was made by `passing_name` for `name`.

    Examples
    --------
    >>> belongs_to(".report.maglev-ctrl-notes", "report")
    False
    """
    head = _head(name)
    return passing.startswith(head) and re.fullmatch("[0-9a-f]{8}", passing[len(head) :]) is not None


def _head(name: str) -> str:
    while len(name.encode()) > _LONG:
        name = name[:-1]
    return f".{name}.{MARK}-"


def put_file(file: Path, content: bytes, *, durable: bool = True) -> None:
    """Write a file, or leave the one of before: whoever reads meets one of both, never a part.

    Parameters
    ----------
    file : its folder is made when it does not exist
    durable : the content is on the disk before it gets its name, so that a power cut leaves no empty file; not needed
        where a reader finds out and makes it anew

    Raises
    ------
    OSError : it cannot be written; nothing is left behind

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     put_file(Path(folder) / "a.txt", b"first")
    ...     put_file(Path(folder) / "a.txt", b"second")
    ...     [(one.name, one.read_bytes()) for one in Path(folder).iterdir()]
    [('a.txt', b'second')]
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    passing = file.with_name(passing_name(file.name))
    try:
        write_bytes(passing, content, durable=durable)
        _replace(passing, file)
    except BaseException:  # an interrupt too
        with suppress(OSError):
            passing.unlink(missing_ok=True)
        raise
    if durable:
        settle_folder(file.parent)
        clear_leftovers(file.parent)


def put_new_file(file: Path, content: bytes) -> None:
    """Write a file that does not exist yet, whole; one that somebody else made meanwhile is never touched.

    Raises
    ------
    FileExistsError : there is something of this name
    OSError : it cannot be written; nothing is left behind
    """
    if os.path.lexists(file):
        raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(file))
    passing = file.with_name(passing_name(file.name))
    try:
        write_bytes(passing, content)
        _name_if_free(passing, file)
        with suppress(OSError):
            passing.unlink(missing_ok=True)
    except BaseException:  # an interrupt too
        with suppress(OSError):
            passing.unlink(missing_ok=True)
        raise
    settle_folder(file.parent)
    clear_leftovers(file.parent)


def _name_if_free(passing: Path, file: Path) -> None:
    """A second name is given in one step and only where it is free; without links a rename after a look must do."""
    try:
        os.link(passing, file)
    except FileExistsError:
        raise
    except (OSError, NotImplementedError, AttributeError):
        if os.path.lexists(file):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(file)) from None
        passing.rename(file)  # on Windows it refuses a name that is taken


def write_bytes(file: Path, content: bytes, *, durable: bool = True) -> None:
    """Write a new file, with the rights that new files get here.

    Raises
    ------
    OSError : it exists, or cannot be written
    """
    with file.open("xb") as stream:
        stream.write(content)
        if durable:
            stream.flush()
            os.fsync(stream.fileno())


def _replace(passing: Path, file: Path) -> None:
    """On Windows a file that somebody reads just now cannot be replaced: wait a moment."""
    for left in reversed(range(_TRIES)):
        try:
            passing.replace(file)
        except PermissionError:
            if os.name != "nt" or left == 0:
                raise
            time.sleep(0.05)
        else:
            return


def settle_file(file: Path) -> None:
    """The content of a file that another library wrote on the disk.

    Raises
    ------
    OSError : the disk refuses
    """
    with file.open("rb+") as stream:
        os.fsync(stream.fileno())


def settle_folder(folder: Path) -> None:
    """The names in a folder on the disk, where the system can be asked for it."""
    if os.name == "nt":
        return
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def clear_leftovers(folder: Path, *, stale: float = _STALE) -> None:
    """Remove passing files that a killed process left; those of the last hour may still be written.

    Parameters
    ----------
    stale : age from which they are nobody's [s]
    """
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            mark, _, rest = entry.name.rpartition(f".{MARK}-")
            if not (mark.startswith(".") and re.fullmatch("[0-9a-f]{8}", rest)):
                continue
            with suppress(OSError):
                if entry.is_file(follow_symlinks=False) and time.time() - entry.stat().st_mtime > stale:
                    Path(entry.path).unlink()
