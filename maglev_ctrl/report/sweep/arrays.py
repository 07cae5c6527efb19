"""A sweep's arrays as NetCDF, written block by block: memory does not grow with the number of points."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from maglev_ctrl._version import __version__
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import ModelError
from maglev_ctrl.study.sweep.records import Column, SweepBlock, SweepStudy
from maglev_ctrl.study.sweep.store import SweepStore

if TYPE_CHECKING:
    import h5netcdf

POINT: Final = "point"
OTHER: Final = "one of the reasons beyond those that are kept by their words"
_MOST_WORDS: Final = 50_000
_AT_ONCE: Final = 200_000  # points written at once
Watch = Callable[[SweepBlock], None]


def write_netcdf(path: Path, study: SweepStudy, store: SweepStore, *, watch: Watch = lambda block: None) -> None:
    """Write every figure of every point: (option, quantities) for a grid, (option, point) for a sample; SI.

    `remark` holds the number of the words in `remark_text` that say why something is missing, 0 for none.

    Parameters
    ----------
    watch : shown every block on its way

    Raises
    ------
    ModelError : a block that was kept cannot be read any more
    """
    import h5netcdf

    columns = store.task.columns
    with h5netcdf.File(path, "w") as file:
        axes = _axes(file, study)
        dims = ("option", *axes)
        names = [column.name for column in columns]
        made = [_variable(file, column, dims) for column in columns]
        remark = file.create_variable("remark", dims, np.int32, compression="gzip", chunks=_chunks(study, dims))
        remark.attrs.update({"units": "1", "long_name": "number of the words in remark_text; 0: none"})
        words: dict[str, int] = {"": 0}
        for first, figures, remarks, quantities in _slabs(study, store, words, watch):
            place = _place(study, first, len(figures))
            for j in range(len(study.request.options)):
                for k, name in enumerate(names):
                    _put(made[k], j, place, figures[:, j, k], as_code=bool(columns[k].codes), name=name)
                _put(remark, j, place, remarks[:, j], as_code=True, name="remark")
            if study.request.method != "grid":
                for k, axis in enumerate(_axis_names(study)):
                    file.variables[axis][first : first + len(figures)] = quantities[:, k]
        file.dimensions["words"] = len(words)
        texts = file.create_variable("remark_text", ("words",), dtype=_text())
        texts[:] = np.array(list(words), dtype=object)
        texts.attrs["long_name"] = "what is missing at a point, and why"
        for name, value in _attributes(study).items():
            file.attrs[name] = value


@dataclass(frozen=True, slots=True)
class _Place:
    """Where a slab of points belongs: whole steps of the first quantity, or points of a sample."""

    first: int
    last: int
    shape: tuple[int, ...]


def _axes(file: h5netcdf.File, study: SweepStudy) -> tuple[str, ...]:
    """The dimensions, with the options and the values of the quantities as their coordinates."""
    request, names = study.request, _axis_names(study)
    file.dimensions["option"] = len(request.options)
    option = file.create_variable("option", ("option",), dtype=_text())
    option[:] = np.array(list(request.options), dtype=object)
    option.attrs["long_name"] = "option of the scenario"
    grid = request.method == "grid"
    if not grid:
        file.dimensions[POINT] = request.points
    for name, one in zip(names, request.ranges, strict=True):
        if grid:
            file.dimensions[name] = one.count
        variable = file.create_variable(name, (name if grid else POINT,), np.float64)
        if grid:
            variable[:] = one.steps()
        unit, scale = one.shown()
        variable.attrs.update({
            "units": one.quantity.unit or "1", "long_name": one.quantity.label, "quantity": one.quantity.name,
            "display_unit": unit, "display_scale": scale, "design": one.quantity.value,
        })  # fmt: skip
    return names if grid else (POINT,)


def _axis_names(study: SweepStudy) -> tuple[str, ...]:
    """Names that every reader of NetCDF takes, all different."""
    taken = {"option", POINT, "words", "remark", "remark_text"}
    taken |= {column.name for column in _columns(study)}
    found: list[str] = []
    for one in study.request.ranges:
        base = "".join(c if c.isascii() and c.isalnum() else "_" for c in one.quantity.name).strip("_") or "quantity"
        name, count = base, 2
        while name in taken:
            name, count = f"{base}_{count}", count + 1
        taken.add(name)
        found.append(name)
    return tuple(found)


def _columns(study: SweepStudy) -> tuple[Column, ...]:
    from maglev_ctrl.study.sweep.records import columns_of

    return columns_of(study.request.parts)


def _text() -> Any:
    """The type of texts of any length."""
    import h5py

    return h5py.string_dtype()


def _variable(file: h5netcdf.File, column: Column, dims: tuple[str, ...]) -> Any:
    kind: Any = np.int8 if column.codes else np.float64
    made = file.create_variable(column.name, dims, kind)
    made.attrs.update({"units": column.unit, "long_name": column.words})
    if column.codes:
        made.attrs["flag_values"] = np.array([value for _, value in column.codes], dtype=np.int8)
        made.attrs["flag_meanings"] = " ".join(word for word, _ in column.codes)
    return made


def _chunks(study: SweepStudy, dims: tuple[str, ...]) -> tuple[int, ...]:
    """Chunks of the compressed array: one option, at most a million points."""
    shape = list(study.request.shape)
    for k in range(len(shape)):
        while np.prod(shape, dtype=object) > 1_000_000 and shape[k] > 1:
            shape[k] = -(-shape[k] // 2)
    return (1, *shape)


def _slabs(
    study: SweepStudy, store: SweepStore, words: dict[str, int], watch: Watch
) -> Iterator[tuple[int, FloatArray, np.ndarray[Any, np.dtype[np.int32]], FloatArray]]:
    """The points in order, in slabs of whole steps along the first quantity: what NetCDF can take as a block."""
    step = int(np.prod(study.request.shape[1:], dtype=object))
    wanted = max(1, _AT_ONCE // step) * step
    first, waiting, count = 0, list[tuple[FloatArray, Any, FloatArray]](), 0
    for index in range(study.blocks):
        block = store.get(index)
        if block is None:
            raise ModelError(f"{store.path}: block {index} cannot be read any more; give the same command again")
        watch(block)
        waiting.append((block.figures, _numbered(block, words), block.quantities))
        count += len(block.quantities)
        while count >= wanted or (index == study.blocks - 1 and count):
            parts = [np.concatenate(one) for one in zip(*waiting, strict=True)]
            cut = min(wanted, count)
            yield first, parts[0][:cut], parts[1][:cut], parts[2][:cut]
            waiting = [(parts[0][cut:], parts[1][cut:], parts[2][cut:])]
            first, count = first + cut, count - cut


def _numbered(block: SweepBlock, words: dict[str, int]) -> np.ndarray[Any, np.dtype[np.int32]]:
    """The numbers (n, options) of a block's remarks; new words get the next number."""
    found = np.zeros(block.figures.shape[:2], dtype=np.int32)
    for k, j, text in block.remarks:
        known = text if text in words or len(words) < _MOST_WORDS else OTHER
        found[k, j] = words.setdefault(known, len(words))
    return found


def _place(study: SweepStudy, first: int, count: int) -> _Place:
    shape = study.request.shape
    step = int(np.prod(shape[1:], dtype=object))
    return _Place(first // step, (first + count) // step, (count // step, *shape[1:]))


def _put(variable: Any, option: int, place: _Place, values: FloatArray | Any, *, as_code: bool, name: str) -> None:
    table = np.asarray(values).reshape(place.shape)
    variable[option, place.first : place.last] = table.astype(variable.dtype) if as_code else table


def _attributes(study: SweepStudy) -> dict[str, Any]:
    request = study.request
    return {
        "title": study.title, "scenario": study.name, "scenario_hash": study.scenario_hash,
        "maglev_ctrl_version": __version__, "created": study.created, "method": request.method,
        "seed": str(request.seed) if request.method != "grid" else "", "notes": "\n".join(study.notes),
        "computed": " ".join(request.parts), "versions": "; ".join(f"{name} {v}" for name, v in study.versions),
    }  # fmt: skip
