"""Files kept between runs, in the hands of others: damaged, swapped, foreign or huge ones are never trusted."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from maglev_ctrl.study.array_file import load_arrays
from maglev_ctrl.study.map import store as module
from maglev_ctrl.study.map.store import FolderStore

PART = {"growth": np.linspace(0.0, 1.0, 7), "found": np.array([True, False])}


def packed(name: str, header: bytes, body: bytes, *, deflate: bool = False) -> bytes:
    """An npz whose one array says of itself what it likes."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED if deflate else zipfile.ZIP_STORED) as out:
        length = len(header) + 1
        out.writestr(f"{name}.npy", b"\x93NUMPY\x01\x00" + length.to_bytes(2, "little") + header + b"\n" + body)
    return stream.getvalue()


def test_what_is_kept_comes_back(tmp_path: Path) -> None:
    store = FolderStore(tmp_path / "one")
    store.put("a", PART)
    found = store.get("a")
    assert found is not None and {name: values.tolist() for name, values in found.items()} == {
        name: values.tolist() for name, values in PART.items()
    }
    assert store.get("b") is None


def swapped(folder: Path) -> object:
    """What is found under a name whose file was exchanged for another one's."""
    store = FolderStore(folder)
    store.put("a", PART)
    store.put("b", {"growth": np.zeros(7), "found": np.array([True, True])})
    one, other = store._file("a"), store._file("b")
    one.write_bytes(other.read_bytes())
    return store.get("a")


def test_a_file_under_another_name_is_not_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert swapped(tmp_path / "guarded") is None
    given = load_arrays
    monkeypatch.setattr(module, "load_arrays", lambda file: {**given(file), module._KEY: np.array("a")})
    assert swapped(tmp_path / "bare") is not None  # the mutant: without the name in the file it is taken


@pytest.mark.parametrize(
    "content",
    [
        b"", b"PK\x03\x04", b"\x00" * 4096, b"not an archive",
        packed("x", b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,)}", b""),
        packed("x", b"{'descr': '<f8', 'fortran_order': False, 'shape': (-1,)}", b""),
        packed("x", b"{'descr': '|O', 'fortran_order': False, 'shape': (1,)}", b"\x80\x04."),
        packed("x", b"__import__('os').abort()", b""),
        packed("x", b"{'descr': '<f8', 'fortran_order': False, 'shape': (3,)}", b"\0" * 8),
        packed("../../x", b"{'descr': '<f8', 'fortran_order': False, 'shape': (1,)}", b"\0" * 8),
    ],
    ids=range(10),
)  # fmt: skip
def test_a_damaged_or_foreign_file_counts_as_none_and_goes(tmp_path: Path, content: bytes) -> None:
    store = FolderStore(tmp_path / "one")
    store.put("a", PART)
    store._file("a").write_bytes(content)
    assert store.get("a") is None
    assert not store._file("a").exists()
    store.put("a", PART)
    assert store.get("a") is not None
    assert sorted(one.name for one in tmp_path.rglob("*.npy")) == []


def test_words_instead_of_numbers_are_not_taken(tmp_path: Path) -> None:
    store = FolderStore(tmp_path / "one")
    store.put("a", {"growth": np.array(["<script>"])})
    assert store.get("a") is None


def test_a_bomb_is_refused_before_it_is_unpacked(tmp_path: Path) -> None:
    file = tmp_path / "bomb.npz"
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (4000000,)}"
    file.write_bytes(packed("x", header, bytes(32_000_000), deflate=True))
    assert file.stat().st_size < 100_000
    with pytest.raises(ValueError, match="unpacked"):
        load_arrays(file, largest=10_000_000)
    assert load_arrays(file, largest=40_000_000)["x"].shape == (4_000_000,)  # the mutant: a limit that lets it through


def test_objects_are_never_unpickled(tmp_path: Path) -> None:
    file = tmp_path / "objects.npz"
    with file.open("wb") as stream:
        np.savez(stream, x=np.array([{"a": 1}], dtype=object))
    with pytest.raises(ValueError, match="allow_pickle"):
        load_arrays(file)
