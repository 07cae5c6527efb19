"""What tells one sweep from another: scenario, points, what is computed, and by which code."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Final

from maglev_ctrl._version import __version__
from maglev_ctrl.scenario import Scenario
from maglev_ctrl.study.sweep.request import SweepRange, SweepRequest

FORMAT: Final = 1
_SHOWN_ONLY: Final = ("report", "workbench", "exchange")  # rooms that compute nothing
_LIBRARIES: Final = ("numpy", "scipy")
WORDS: Final = {
    "format": "the format of the store", "scenario": "the scenario or its data files", "points": "the points",
    "options": "the options", "parts": "what is computed", "version": "the version of maglev_ctrl",
    "code": "the code of maglev_ctrl", "libraries": "the version of numpy or scipy",
}  # fmt: skip
"""What each entry of an identity is, in words."""


def identity_of(scenario: Scenario, request: SweepRequest) -> dict[str, str]:
    """Everything the numbers of a sweep depend on, in texts that are equal where it is the same."""
    drawn = "" if request.method == "grid" else f" {request.drawn} {request.seed}"
    return {
        "format": str(FORMAT), "scenario": scenario.hash,
        "points": f"{request.method}{drawn}: " + "; ".join(_said(one) for one in request.ranges),
        "options": ", ".join(request.options), "parts": ", ".join(request.parts), **code_identity(),
    }  # fmt: skip


def code_identity() -> dict[str, str]:
    """Version, code and libraries: what has to be the same on every machine that takes part."""
    return {
        "version": __version__, "code": code_digest(),
        "libraries": ", ".join(f"{name} {version(name)}" for name in _LIBRARIES),
    }  # fmt: skip


@cache
def code_digest() -> str:
    """SHA-256 of every module that a number can depend on."""
    digest = hashlib.sha256()
    for path, module in sorted(_modules(files("maglev_ctrl"), "")):
        digest.update(f"{path}\0".encode() + module.read_bytes() + b"\0")
    return digest.hexdigest()


def _modules(folder: Traversable, path: str) -> list[tuple[str, Traversable]]:
    found: list[tuple[str, Traversable]] = []
    for one in folder.iterdir():
        here = f"{path}/{one.name}"
        if one.is_dir() and one.name not in _SHOWN_ONLY and not one.name.startswith(("_", ".")):
            found += _modules(one, here)
        elif one.name.endswith(".py") and not one.name.startswith("cli"):
            found.append((here, one))
    return found


def _said(one: SweepRange) -> str:
    spread = f"~{one.last.hex()}" if one.normal else f":{one.last.hex()}"
    return f"{one.quantity.name}={one.first.hex()}{spread}:{one.count}"
