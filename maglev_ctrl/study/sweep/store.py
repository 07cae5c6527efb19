"""The blocks of a sweep on disk while it runs: a Zarr store that every reader of Zarr opens, checked when it is read.

One file a block, moved into place when it is complete and with a checksum in it; the values of the swept quantities
stand in it too, so that a block in a wrong place is seen. Whatever does not fit counts as not computed.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from maglev_ctrl.errors import ModelError, ScenarioError
from maglev_ctrl.study.sweep.block import SweepTask
from maglev_ctrl.study.sweep.identity import WORDS, identity_of
from maglev_ctrl.study.sweep.records import SweepBlock

if TYPE_CHECKING:
    import zarr

STORE: Final = "sweep.zarr"
LOCK: Final = ".sweep.lock"
REMARK: Final = 200
"""Bytes kept of a remark."""
_FIGURES, _REMARKS = "figures", "remarks"
_ABOUT = "zarr.json"
_ABOUT_LIMIT = 2**20
_NEEDED: Final = ("zarr", "filelock")
_RESTART = "choose another folder with --out, or --restart to throw the finished part away"


def require_libraries(*further: str) -> None:
    """Say which extra is missing before any work.

    Raises
    ------
    ModelError : a library of the extra `dist` is not installed
    """
    from importlib.util import find_spec

    missing = [name for name in (*_NEEDED, *further) if find_spec(name) is None]
    if missing:
        raise ModelError(f'sweeps need {", ".join(missing)}: pip install "maglev-ctrl[dist]"')


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """While the block runs no other process writes the sweep of a folder; the lock goes with the process.

    Raises
    ------
    ScenarioError : another process does
    """
    from filelock import FileLock, Timeout

    folder.mkdir(parents=True, exist_ok=True)
    lock = FileLock(folder / LOCK, timeout=0)
    try:
        lock.acquire()
    except Timeout:
        raise ScenarioError(
            f"{folder}: another sweep is writing into this folder; wait for it, or choose another with --out"
        ) from None
    try:
        yield
    finally:
        with suppress(OSError):  # before it is released: afterwards it may be somebody else's
            (folder / LOCK).unlink()
        lock.release()
        with suppress(OSError):  # where nothing came of it, nothing stays
            folder.rmdir()


@dataclass(frozen=True, eq=False, slots=True)
class SweepStore:
    """The store of one sweep; write with `put`, one process at a time, inside `alone`."""

    path: Path
    task: SweepTask
    figures: zarr.Array[Any]
    remarks: zarr.Array[Any]

    @classmethod
    def begun_in(cls, folder: Path) -> int | None:
        """Points of a block in the store that is there; None where there is none.

        Raises
        ------
        ScenarioError : it cannot be read
        """
        about = _about(folder / STORE)
        return None if about is None else int(about["block"])

    @classmethod
    def open(cls, folder: Path, task: SweepTask) -> SweepStore:
        """The store in a folder, made where there is none.

        Raises
        ------
        ScenarioError : the store is of another sweep, or damaged
        """
        path, said = folder / STORE, identity_of(task.scenario, task.request)
        about = _about(path)
        if about is None:
            _make(path, task, said)
            about = _about(path)
            assert about is not None
        other = [WORDS[name] for name in WORDS if about["identity"].get(name) != said[name]]
        if other:
            raise ScenarioError(
                f"{path}: holds the finished part of another sweep, which differs in {' and '.join(other)}; {_RESTART}"
            )
        import zarr

        try:
            for name in (_FIGURES, _REMARKS):
                _require_plain(path / name / _ABOUT)
            group = zarr.open_group(path, mode="r+", zarr_format=3)
            made = cls(path, task, group[_FIGURES], group[_REMARKS])  # type: ignore[arg-type]
            fits = made.figures.shape == made._shape() and made.figures.chunks[0] == task.size
        except Exception as fault:  # a damaged store may raise anything
            raise ScenarioError(f"{path}: the store is damaged ({_short(fault)}); {_RESTART}") from None
        if not fits:
            raise ScenarioError(f"{path}: the store is damaged (its arrays have another shape); {_RESTART}")
        return made

    def get(self, index: int) -> SweepBlock | None:
        """A block as it was put; None where there is none, or it cannot be trusted."""
        first, last = self.task.span(index)
        if not self.has(index):
            return None
        try:
            values = np.asarray(self.figures[first:last])
            words = np.asarray(self.remarks[first:last])
        except Exception:  # a damaged file may raise anything
            return None
        wanted = self.task.request.values(first, last)
        count = wanted.shape[1]
        if not np.array_equal(values[:, :count], wanted):
            return None
        table = values[:, count:].reshape(last - first, len(self.task.request.options), -1)
        remarks: list[tuple[int, int, str]] = []
        for k, j in np.argwhere(table[:, :, -1] > 0.0).tolist():
            text = bytes(words[k, j]).rstrip(b"\0")
            if len(text) != int(table[k, j, -1]):
                return None
            remarks.append((k, j, text.decode("utf-8", "replace")))
        figures = np.ascontiguousarray(table[:, :, :-1])
        return SweepBlock(index, wanted, figures, tuple(remarks))

    def has(self, index: int) -> bool:
        """Whether there is a file of a block; `get` says whether it can be trusted."""
        return self._file(index).is_file()

    def put(self, block: SweepBlock) -> None:
        """Keep a block: whole, or not at all.

        Raises
        ------
        ModelError : it cannot be written, or the store is gone
        """
        self._require_there()
        first, last = self.task.span(block.index)
        texts = np.zeros((last - first, len(self.task.request.options), REMARK), dtype=np.uint8)
        length = np.zeros((*block.figures.shape[:2], 1))
        for k, j, words in block.remarks:
            text = _cut(words)
            texts[k, j, : len(text)] = np.frombuffer(text, dtype=np.uint8)
            length[k, j, 0] = len(text)
        table = np.concatenate([block.figures, length], axis=2).reshape(last - first, -1)
        try:
            if block.remarks:
                self.remarks[first:last] = texts
            self.figures[first:last] = np.concatenate([block.quantities, table], axis=1)
        except OSError as fault:
            raise ModelError(
                f"{self.path}: cannot be written: {fault.strerror or fault}; what is done is kept; mend it and give "
                "the same command again"
            ) from None
        self._require_there()

    def _require_there(self) -> None:
        """A folder that was removed must not come to life again with half of its blocks."""
        if not (self.path / _ABOUT).is_file():
            raise ModelError(
                f"{self.path}: the store was removed while the sweep ran; its points are lost; begin it again"
            )

    def _file(self, index: int) -> Path:
        return self.path / _FIGURES / "c" / str(index) / "0"

    def _shape(self) -> tuple[int, int]:
        request = self.task.request
        return request.points, len(request.ranges) + len(request.options) * (len(self.task.columns) + 1)


def remove_store(folder: Path) -> None:
    """Remove the store of a folder.

    It is moved away first: one that is removed in part would be taken for a damaged one.
    """
    path = folder / STORE
    gone = path.with_name(f".{STORE}-gone")
    shutil.rmtree(gone, ignore_errors=True)
    with suppress(FileNotFoundError):
        path.rename(gone)
    shutil.rmtree(gone, ignore_errors=True)


def _make(path: Path, task: SweepTask, said: dict[str, str]) -> None:
    """A store without blocks, moved into place when it is complete."""
    import zarr
    from zarr.codecs import Crc32cCodec

    request = task.request
    partial = path.with_name(f".{path.name}-new")
    shutil.rmtree(partial, ignore_errors=True)
    try:
        group = zarr.open_group(partial, mode="w", attributes={"about": json.dumps({
            "identity": said, "block": task.size, "options": list(request.options),
            "quantities": [[one.quantity.name, one.quantity.unit] for one in request.ranges],
            "columns": [[column.name, column.unit, column.words] for column in task.columns],
        })})  # fmt: skip
        wide = len(request.ranges) + len(request.options) * (len(task.columns) + 1)
        group.create_array(
            _FIGURES, shape=(request.points, wide), chunks=(task.size, wide), dtype="float64", fill_value=np.nan,
            compressors=[Crc32cCodec()],
        )  # fmt: skip
        group.create_array(
            _REMARKS, shape=(request.points, len(request.options), REMARK), dtype="uint8", fill_value=0,
            chunks=(task.size, len(request.options), REMARK), compressors=[Crc32cCodec()],
        )  # fmt: skip
        partial.rename(path)
    except OSError as fault:
        raise ScenarioError(f"{path}: cannot be written: {fault.strerror or fault}") from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _about(path: Path) -> dict[str, Any] | None:
    """What the store says of itself; None where there is no store.

    Raises
    ------
    ScenarioError : there is something that is no store of a sweep, or a damaged one
    """
    if not path.exists():
        return None
    import zarr

    try:
        about = json.loads(str(zarr.open_group(path, mode="r", zarr_format=3).attrs["about"]))
        if not isinstance(about["identity"], dict) or not isinstance(about["block"], int) or about["block"] < 1:
            raise ValueError("its description is not one of a sweep")
        return dict(about)
    except Exception as fault:  # a damaged store, or one of a stranger, may raise anything
        raise ScenarioError(f"{path}: the store is damaged ({_short(fault)}); {_RESTART}") from None


def _require_plain(about: Path) -> None:
    """Arrays of a stranger may name codecs that take any amount of memory, or worse; ours are bytes and a checksum.

    Raises
    ------
    ValueError : another codec
    """
    with about.open("rb") as stream:
        said = json.loads(stream.read(_ABOUT_LIMIT))
    names = [codec["name"] for codec in said["codecs"]]
    if names != ["bytes", "crc32c"]:
        raise ValueError(f"codecs {', '.join(names)}")


def _cut(words: str) -> bytes:
    """Words in at most `REMARK` bytes, no letter cut in two."""
    text = " ".join(words.replace("\0", " ").split()).encode("utf-8", "replace")
    return text if len(text) <= REMARK else text[: REMARK - 4].decode("utf-8", "ignore").encode() + b" ..."


def _short(fault: Exception) -> str:
    return f"{type(fault).__name__}: {' '.join(str(fault).split())}"[:120]
