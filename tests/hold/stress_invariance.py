"""The same answers with other kernels, threads, hash seeds and locales: bit for bit, or to stated digits."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

CHILD = Path(__file__).resolve().parent / "stress_child.py"
BITWISE: tuple[tuple[str, dict[str, str]], ...] = (
    ("run again", {}),
    ("another hash seed, locale and time zone", {"PYTHONHASHSEED": "7", "TZ": "Asia/Tokyo", "LC_ALL": "C"}),
)
DIGITS: tuple[tuple[str, dict[str, str]], ...] = (
    ("two threads", {"OPENBLAS_NUM_THREADS": "2", "OMP_NUM_THREADS": "2"}),
    ("kernels of Nehalem", {"OPENBLAS_CORETYPE": "Nehalem"}),
    ("kernels of Haswell", {"OPENBLAS_CORETYPE": "Haswell"}),
    ("kernels of SkylakeX", {"OPENBLAS_CORETYPE": "SkylakeX"}),
    ("kernels of Prescott", {"OPENBLAS_CORETYPE": "Prescott"}),
)
Answers = dict[str, dict[str, Any]]


def child(changes: dict[str, str]) -> Answers | None:
    """The answers of a process with these environment variables; None where it cannot run there."""
    settings = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", **changes}
    found = subprocess.run([sys.executable, str(CHILD)], env=settings, capture_output=True, text=True, check=False)
    if found.returncode < 0:  # a processor without the instructions of that kernel
        return None
    if found.returncode:
        raise RuntimeError(found.stderr[-2000:])
    answers: Answers = json.loads(found.stdout)
    return answers


def difference(one: Answers, other: Answers, *, bitwise: bool) -> tuple[str, bool]:
    """In words how far two sets of answers are apart, and whether that is allowed."""
    worst, held, verdicts = "", True, 0
    most = -1.0
    for name, before in one.items():
        after = other[name]
        x, y = np.array(before["figures"]), np.array(after["figures"])
        same = before["verdict"] == after["verdict"] and x.shape == y.shape
        verdicts += not same
        size = float(np.max(np.abs(x[np.isfinite(x)]), initial=1e-300))
        apart = 0.0 if np.array_equal(x, y, equal_nan=True) else float(np.max(np.abs(x - y)) / size) if same else np.inf
        held = held and same and (apart == 0.0 if bitwise else apart <= before["within"])
        share = apart / before["within"]
        if share > most:
            most, worst = share, f"most: {name}, {apart:.1e} (allowed {0.0 if bitwise else before['within']:.0e})"
    return f"{verdicts} verdicts of {len(one)} differ; {worst}", held


def figures(*, short: bool) -> list[dict[str, str | bool]]:
    """Lines of the record; the short form leaves the kernels but one out."""
    base = child({})
    assert base is not None
    told: list[dict[str, str | bool]] = []
    for group, bitwise in ((BITWISE, True), (DIGITS[:2] if short else DIGITS, False)):
        for name, changes in group:
            other = child(changes)
            words, held = ("this processor has no such kernel", True) if other is None else difference(
                base, other, bitwise=bitwise
            )  # fmt: skip
            asked = "bit for bit" if bitwise else "same verdicts, figures to the rounding their conditioning allows"
            told.append({"what": f"same answers: {name}", "asked": asked, "reached": words, "met": bool(held)})
            print(f"same answers, {name}: {words}", flush=True)
    return told
