"""Laws, plants and certificate matrices as a MATLAB file (level 5), the same bytes for the same input."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import fields
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.proofs.claims import Claim
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant, plant_fields

HEADER = b"MATLAB 5.0 MAT-file, maglev-ctrl"
HEADER_SIZE = 116


def mat_bytes(
    controllers: Sequence[Controller],
    *,
    plants: Sequence[Plant] = (),
    claims: Sequence[Claim] = (),
    origin: str = "",
) -> bytes:
    """Contents of a .mat file with the cell arrays `controllers`, `plants`, `claims` and the text `origin`.

    Every cell is a struct: matrices under their own names, names as cell arrays of text, `dt` in s with 0 for
    continuous time (MATLAB's convention). A claim holds its kind, its numbers and its matrices (P as (rows, columns,
    loops)); indices of plants and controllers count from 1. u = K y, the sign of the feedback is in the matrices.

    Raises
    ------
    ValueError : there is no law

    Examples
    --------
    >>> law = Controller.static([[-3.0]], measured=("gap",), commands=("force",), dt=0.001)
    >>> mat_bytes([law], origin="hover.toml")[:10]
    b'MATLAB 5.0'
    """
    from scipy.io import savemat  # loads half of scipy, and only files need it

    if not controllers:
        raise ValueError("controllers: expected at least one law")
    content = {
        "controllers": _cells([_controller(one) for one in controllers]),
        "plants": _cells([_plant(one) for one in plants]),
        "claims": _cells([_claim(one) for one in claims]),
        "origin": origin,
    }
    stream = io.BytesIO()
    savemat(
        cast(Any, stream),  # any binary stream will do; its stubs know file names only
        content,
        oned_as="column",
    )
    # savemat writes the date into the descriptive text; a file of the same law should be the same file.
    return HEADER.ljust(HEADER_SIZE) + stream.getvalue()[HEADER_SIZE:]


def _controller(law: Controller) -> dict[str, Any]:
    return {
        **{key: np.array(getattr(law, key)) for key in "ABCD"},
        "measured": _texts(law.measured),
        "commands": _texts(law.commands),
        "name": law.name,
        "dt": 0.0 if law.dt is None else law.dt,
    }


def _plant(plant: Plant) -> dict[str, Any]:
    return {
        **{key: np.array(getattr(plant, key)) for key in plant_fields()},
        **{
            key: _texts(getattr(plant, key))
            for key in ("states", "disturbances", "commands", "performance", "measured")
        },
        "name": plant.name,
        "dt": 0.0 if plant.dt is None else plant.dt,
    }


def _claim(claim: Claim) -> dict[str, Any]:
    found: dict[str, Any] = {"kind": type(claim).__name__}
    for field in fields(claim):
        value = getattr(claim, field.name)
        if field.name in ("plants", "controllers"):
            value = np.array(value, dtype=float) + 1.0
        elif isinstance(value, np.ndarray):
            value = np.moveaxis(np.array(value), 0, -1) if value.ndim == 3 else np.array(value)
        elif isinstance(value, tuple):
            value = _texts(value) if all(isinstance(one, str) for one in value) else np.array(value, dtype=float)
        elif isinstance(value, bool):
            value = float(value)
        found[field.name] = value
    return found


def _texts(names: Sequence[str]) -> NDArray[np.object_]:
    return _cells(list(names))


def _cells(items: Sequence[Any]) -> NDArray[np.object_]:
    cells = np.empty((len(items), 1), dtype=object)
    for i, item in enumerate(items):
        cells[i, 0] = item
    return cells
