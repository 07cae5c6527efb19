"""Finished parts of a map on disk, so that an interrupted one goes on where it was."""

from __future__ import annotations

import hashlib
import io
import json
import shutil
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from maglev_ctrl._version import __version__
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.files import put_file
from maglev_ctrl.scenario import Scenario
from maglev_ctrl.study.array_file import load_arrays
from maglev_ctrl.study.map.request import AxisRange, MapRequest

FOLDER: Final = ".map-part"
_FORMAT = 2
_REACHED = "reached"
_KEY = "kept under"  # in every file: one that was moved under another name is not taken


@dataclass(frozen=True, slots=True)
class FolderStore:
    """Arrays by name in a folder, one file each, written as a whole or not at all; a file that is damaged counts as
    none. The folder is made with the first file.
    """

    folder: Path

    def get(self, key: str) -> Mapping[str, FloatArray] | None:
        """The arrays kept under a name; None when there are none."""
        file = self._file(key)
        try:
            kept = load_arrays(file)
            if str(kept.pop(_KEY)) != key:
                raise ValueError("another part's file under this name")
            if any(values.dtype.kind not in "biufc" for values in kept.values()):
                raise ValueError("expected numbers")
            return kept
        except FileNotFoundError:
            return None
        except Exception:  # a damaged archive may raise anything
            with suppress(OSError):
                file.unlink(missing_ok=True)
            return None

    def put(self, key: str, arrays: Mapping[str, FloatArray]) -> None:
        """Keep arrays under a name, as a whole or not at all."""
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **{_KEY: np.array(key), **arrays})
        self._write(self._file(key), buffer.getvalue())

    def reach(self, share: float) -> None:
        """Note which share of the whole is done."""
        if self.folder.exists():  # nothing is kept before the first part
            self._write(self.folder / _REACHED, f"{share:.6f}".encode())

    def reached(self) -> float:
        """The share noted last; 0 where there is none."""
        try:
            return min(1.0, max(0.0, float((self.folder / _REACHED).read_text(encoding="ascii"))))
        except (OSError, ValueError):
            return 0.0

    def _file(self, key: str) -> Path:
        return self.folder / f"{hashlib.sha256(key.encode()).hexdigest()[:32]}.npz"

    def _write(self, file: Path, content: bytes) -> None:
        try:
            put_file(file, content, durable=False)
        except FileNotFoundError:  # the folder around it has just been exchanged for one with new results
            put_file(file, content, durable=False)


@dataclass(frozen=True, slots=True)
class MapFolder:
    """What is kept of one map: a store for every option, in a folder of its own for every scenario and request."""

    root: Path
    options: tuple[str, ...]

    @classmethod
    def of(cls, out: Path, scenario: Scenario, request: MapRequest) -> MapFolder:
        """The folder in the folder of the results; nothing is made yet."""
        return cls(out / FOLDER / map_key(scenario, request), request.options)

    def store(self, option: str) -> FolderStore:
        """The store of an option."""
        return FolderStore(self.root / option)

    def reached(self) -> float:
        """The share of all options that is kept."""
        return sum(self.store(name).reached() for name in self.options) / len(self.options)

    def remove(self) -> None:
        """Remove what was kept, and the folder around it where nothing else is in it."""
        shutil.rmtree(self.root, ignore_errors=True)
        with suppress(OSError):
            self.root.parent.rmdir()


def map_key(scenario: Scenario, request: MapRequest) -> str:
    """What tells maps apart: the scenario with its data files, the grid, how it is computed, and by which version."""
    said = {
        "format": _FORMAT, "version": __version__, "scenario": scenario.hash, "x": _said(request.x),
        "y": _said(request.y), "coverage": request.coverage, "backend": request.backend,
        "merge_delays": request.merge_delays,
    }  # fmt: skip
    return hashlib.sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()[:16]


def _said(axis: AxisRange) -> tuple[str, str, str, int]:
    return axis.quantity.name, axis.first.hex(), axis.last.hex(), axis.count
