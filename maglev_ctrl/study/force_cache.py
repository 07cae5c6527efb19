"""Solved eddy-current forces kept on disk: numbers only, never code; what cannot be trusted is computed anew."""

from __future__ import annotations

import hashlib
import io
import json
import os
import sys
import zipfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, fields
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np

from maglev_ctrl.arrays import read_only
from maglev_ctrl.fields.coil import RectangularCoil
from maglev_ctrl.fields.response import GuidewayResponse
from maglev_ctrl.fields.section import CrossSection
from maglev_ctrl.files import clear_leftovers, put_file
from maglev_ctrl.forces.base import Domain
from maglev_ctrl.forces.eddy_current import FINENESS, Accuracy
from maglev_ctrl.forces.force_map import ForceMap, LogAxis, MapQuality
from maglev_ctrl.study.array_file import load_arrays

FOLDER: Final = "MAGLEV_CTRL_CACHE"
"""Environment variable that names the cache's folder."""
_FORMAT: Final = 1
_METHOD: Final = (
    ("fields", ("coil", "delaunay", "discretize", "mesh", "polygon", "response", "section", "solve", "wavenumbers")),
    ("forces", ("eddy_current", "force_map")),
    ("kernels", ("chebyshev",)),
)
_RESPONSE: Final = ("panels", "wavenumbers", "samples", "projections", "time_constants")
Kept = TypeVar("Kept")


def cache_folder() -> Path:
    """Where solved forces are kept: MAGLEV_CTRL_CACHE, or the platform's folder for caches."""
    given = os.environ.get(FOLDER)
    if given:
        return Path(given)
    home = Path.home()
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local") / "maglev-ctrl" / "cache"
    if sys.platform == "darwin":
        return home / "Library" / "Caches" / "maglev-ctrl"
    return Path(os.environ.get("XDG_CACHE_HOME") or home / ".cache") / "maglev-ctrl"


def cache_key(
    section: CrossSection,
    coils: tuple[RectangularCoil, ...],
    domain: Domain,
    *,
    accuracy: Accuracy,
    frequency: float,
    tolerance: float,
) -> str:
    """SHA-256 of everything a solution depends on: geometry, coils, ranges, fineness, and the method's own text."""
    told = {
        "format": _FORMAT,
        "method": _method_digest(),
        "section": section.digest(),
        "coils": [{name: f"{value:.12g}" for name, value in asdict(coil).items()} for coil in coils],
        "domain": {one.name: _numbers(getattr(domain, one.name)) for one in fields(domain)},
        "fineness": {name: f"{value:.12g}" for name, value in asdict(FINENESS[accuracy]).items()},
        "frequency": f"{frequency:.12g}",
        "tolerance": f"{tolerance:.12g}",
    }
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()


def _numbers(span: tuple[float, float] | None) -> list[str] | None:
    return None if span is None else [f"{value:.12g}" for value in span]


@cache
def _method_digest() -> str:
    """Hash of the modules that compute the forces: a changed method never meets an old result."""
    text = hashlib.sha256()
    for room, names in _METHOD:
        for name in names:
            text.update(files(f"maglev_ctrl.{room}").joinpath(f"{name}.py").read_bytes())
    return text.hexdigest()


def keep_map(key: str, found: ForceMap) -> None:
    """Keep a map; a folder that cannot be written leaves nothing and is no fault."""
    axes = np.array([[axis.low, axis.high, axis.shift] for axis in found.axes])
    quality = found.quality
    _keep(
        "map", key,
        log_energy=found.log_energy, log_drag=found.log_drag, axes=axes, domain=_domain_array(found.domain),
        quality=np.array([quality.forces, quality.drag, quality.stiffness, quality.checks, *quality.nodes]),
    )  # fmt: skip


def kept_map(key: str) -> ForceMap | None:
    """The map kept under a key; None where there is none, or its file is damaged or not ours."""

    def read(data: dict[str, np.ndarray[Any, Any]]) -> ForceMap:
        energy, drag = (_series(data[name], name) for name in ("log_energy", "log_drag"))
        if energy.shape != drag.shape:
            raise ValueError("coefficients: two shapes")
        axes = [LogAxis(float(low), float(high), float(shift)) for low, high, shift in data["axes"]]
        forces, drags, stiffness, checks, *nodes = data["quality"].tolist()
        a, b, c = (int(count) for count in nodes)
        return ForceMap(
            _domain(data["domain"]), (axes[0], axes[1], axes[2]), energy, drag,
            MapQuality(forces, drags, stiffness, int(checks), (a, b, c)),
        )  # fmt: skip

    return _kept("map", key, read)


def keep_response(key: str, found: GuidewayResponse) -> None:
    """Keep a guideway's response, as `keep_map` does a map."""
    ranges = np.array([[*region[0], *region[1]] for region in found.regions])
    _keep(
        "response", key,
        regions=ranges, limits=np.array([*found.speeds, found.frequency]),
        **{name: getattr(found, name) for name in _RESPONSE},
    )  # fmt: skip


def kept_response(key: str) -> GuidewayResponse | None:
    """The response kept under a key; None where there is none that can be trusted."""

    def read(data: dict[str, np.ndarray[Any, Any]]) -> GuidewayResponse:
        n, m, modes = data["projections"].shape
        expected = {"wavenumbers": (n,), "samples": (2, m), "time_constants": (n, modes)}
        if any(data[name].shape != shape for name, shape in expected.items()) or data["panels"].ndim != 1:
            raise ValueError("response: arrays that do not belong together")
        low, high, frequency = data["limits"].tolist()
        regions = tuple(((y0, y1), (z0, z1)) for y0, y1, z0, z1 in data["regions"].tolist())
        arrays = {name: read_only(data[name], name=name) for name in _RESPONSE}
        return GuidewayResponse(**arrays, regions=regions, speeds=(low, high), frequency=frequency)

    return _kept("response", key, read)


def keep_error(key: str, error: float) -> None:
    """Keep the estimated error of the forces under a key."""
    _keep("error", key, error=np.array([error]))


def kept_error(key: str) -> float | None:
    """The error kept under a key; None where there is none that can be trusted."""
    return _kept("error", key, lambda data: float(data["error"][0]))


def _series(values: np.ndarray[Any, Any], name: str) -> np.ndarray[Any, Any]:
    if values.ndim != 3 or values.size == 0:
        raise ValueError(f"{name}: expected coefficients along three axes")
    return read_only(values, name=name)


def _domain_array(domain: Domain) -> np.ndarray[Any, Any]:
    gap = (np.nan, np.nan) if domain.gap is None else domain.gap
    return np.array([domain.height, gap, domain.speed])


def _domain(values: np.ndarray[Any, Any]) -> Domain:
    height, gap, speed = ((float(low), float(high)) for low, high in values)
    return Domain(height=height, gap=None if np.isnan(gap[0]) else gap, speed=speed)


def _file(kind: str, key: str) -> Path:
    return cache_folder() / f"eddy-current-{key[:40]}.{kind}.npz"


def _keep(kind: str, key: str, **arrays: Any) -> None:
    """A reader never meets half a file; one that a power cut emptied is found out and computed anew."""
    content = io.BytesIO()
    np.savez(content, allow_pickle=False, key=np.array(key), **arrays)
    target = _file(kind, key)
    with suppress(OSError):
        put_file(target, content.getvalue(), durable=False)
        clear_leftovers(target.parent)


def _kept(kind: str, key: str, read: Callable[[dict[str, np.ndarray[Any, Any]]], Kept]) -> Kept | None:
    target = _file(kind, key)
    try:
        data = load_arrays(target)
        if str(data.pop("key")) != key or any(not _is_number_array(values) for values in data.values()):
            return None
        return read(data)
    except (OSError, ValueError, KeyError, IndexError, TypeError, EOFError, zipfile.BadZipFile, MemoryError):
        return None


def _is_number_array(values: np.ndarray[Any, Any]) -> bool:
    return bool(values.dtype == np.float64)
