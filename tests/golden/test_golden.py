"""Studies of scenario files against their golden summaries: a change of any number has to be looked at and owned.

Regenerate with `python tests/golden/regenerate.py`, then review the difference.
"""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from typing import Any

import pytest

_SPEC = importlib.util.spec_from_file_location("golden_summary", Path(__file__).with_name("summary.py"))
assert _SPEC is not None and _SPEC.loader is not None
golden = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(golden)

# Eigenvalues and margins are good to about 1e-9; bisected boundaries and depths to about 1e-5 of their range. BLAS
# libraries differ in the last digits, which badly damped modes and optimal perturbations magnify.
RELATIVE, ABSOLUTE = 1e-4, 1e-7
FLAT = 1e-2  # the critical depth is flat at its bottom, so where the bottom lies is known to fewer digits


def differences(found: Any, expected: Any, path: str = "") -> list[str]:
    """Every place where two summaries differ by more than the tolerance."""
    if isinstance(expected, dict) and isinstance(found, dict):
        keys = sorted(set(expected) | set(found))
        return [d for k in keys for d in differences(found.get(k), expected.get(k), f"{path}/{k}")]
    if isinstance(expected, list) and isinstance(found, list) and len(expected) == len(found):
        return [
            d for i, (f, e) in enumerate(zip(found, expected, strict=True)) for d in differences(f, e, f"{path}/{i}")
        ]
    numbers = isinstance(expected, (int, float)) and isinstance(found, (int, float))
    relative = FLAT if path.endswith("worst_speed") else RELATIVE
    same = found == pytest.approx(expected, rel=relative, abs=ABSOLUTE) if numbers else found == expected
    return [] if same else [f"{path}: found {found!r}, expected {expected!r}"]


@pytest.mark.parametrize("scenario", golden.SCENARIOS)
def test_study_is_what_it_was(scenario: str) -> None:
    expected = json.loads(golden.golden_file(scenario).read_text(encoding="utf-8"))
    assert differences(golden.summary(scenario), expected) == []


def test_differences_are_found() -> None:
    expected = json.loads(golden.golden_file("paper/heave_surge").read_text(encoding="utf-8"))
    mutant = json.loads(json.dumps(expected))
    name = next(iter(mutant["options"]))
    mutant["options"][name]["eigenvalues"][0][0] *= -1.0
    assert len(differences(mutant, expected)) == 1
