"""Arrays in an npz file that somebody else may have written: bounded before they are unpacked, and nothing pickled."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any, Final

import numpy as np

LARGEST: Final = 2**29
"""Bytes of all arrays of a file together, unpacked."""


def load_arrays(file: Path, *, largest: int = LARGEST) -> dict[str, np.ndarray[Any, Any]]:
    """Every array of a file by name.

    Raises
    ------
    OSError : the file cannot be read
    ValueError : it would unpack to more than `largest` bytes, or it holds objects instead of numbers
    zipfile.BadZipFile, EOFError, KeyError, MemoryError : a damaged file
    """
    with file.open("rb") as stream:
        with zipfile.ZipFile(stream) as packed:
            size = sum(one.file_size for one in packed.infolist())
        if size > largest:
            raise ValueError(f"{file}: expected at most {largest} bytes unpacked, got {size}")
        stream.seek(0)
        with np.load(stream, allow_pickle=False) as kept:
            return {name: kept[name] for name in kept.files}
