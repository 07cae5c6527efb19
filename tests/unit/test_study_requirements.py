"""Requirements judged on evidence: limits on both sides, lower bounds, missing values, units."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from maglev_ctrl.errors import Verdict
from maglev_ctrl.study import requirements
from maglev_ctrl.study.requirements import DESCRIPTIONS, FINDERS, Finding, judge, missing, not_evaluated


def wanted(quantity: str, sense: str, limit: float, over: str = "nominal") -> Any:
    return SimpleNamespace(name="one", quantity=quantity, sense=sense, limit=limit, over=over, unit="", hard=True)


def judged(monkeypatch: pytest.MonkeyPatch, finding: Finding, requirement: Any) -> Any:
    monkeypatch.setitem(requirements.FINDERS, requirement.quantity, lambda evidence, over: finding)
    return judge(requirement, SimpleNamespace())  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("sense", "limit", "value", "verdict"),
    [
        ("at_least", 0.02, 0.02, Verdict.PASS),
        ("at_least", 0.02, 0.0199, Verdict.FAIL),
        ("at_most", 0.0, -1e-9, Verdict.PASS),
        ("at_most", 0.0, 1e-9, Verdict.FAIL),
        ("at_least", 0.02, math.inf, Verdict.PASS),
    ],
)
def test_limits(monkeypatch: pytest.MonkeyPatch, sense: str, limit: float, value: float, verdict: Verdict) -> None:
    assert judged(monkeypatch, Finding(value), wanted("damping_ratio", sense, limit)).verdict is verdict


def test_what_is_missing_is_not_evaluated_with_its_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    result = judged(monkeypatch, missing("no loop"), wanted("disk_margin", "at_least", 0.4))
    assert result.verdict is Verdict.NOT_EVALUATED
    assert result.reason == "no loop" and math.isnan(result.value) and math.isnan(result.margin_percent)


def test_a_lower_bound_may_pass_but_never_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    bound = Finding(1.5, reason="scan ended", bound="lower")
    assert judged(monkeypatch, bound, wanted("speed_margin", "at_least", 1.0)).verdict is Verdict.PASS
    assert judged(monkeypatch, bound, wanted("speed_margin", "at_least", 2.0)).verdict is Verdict.NOT_EVALUATED
    # "at most 2" cannot be proven by "at least 1.5"; "at most 1" is disproven by it
    assert judged(monkeypatch, bound, wanted("speed_margin", "at_most", 2.0)).verdict is Verdict.NOT_EVALUATED
    assert judged(monkeypatch, bound, wanted("speed_margin", "at_most", 1.0)).verdict is Verdict.FAIL


def test_an_upper_bound_may_fail_but_never_pass(monkeypatch: pytest.MonkeyPatch) -> None:
    most = Finding(1e-12, reason="within its error bound", bound="upper")
    assert judged(monkeypatch, most, wanted("damping_ratio", "at_least", 0.02)).verdict is Verdict.FAIL
    assert judged(monkeypatch, most, wanted("damping_ratio", "at_least", 0.0)).verdict is Verdict.NOT_EVALUATED


def test_units_are_those_people_read(monkeypatch: pytest.MonkeyPatch) -> None:
    result = judged(monkeypatch, Finding(math.radians(45.0)), wanted("phase_margin", "at_least", math.radians(30.0)))
    assert (result.unit, round(result.value, 9), round(result.limit, 9)) == ("deg", 45.0, 30.0)
    assert result.margin_percent == pytest.approx(50.0)


def test_every_quantity_has_a_finder_and_words() -> None:
    assert set(FINDERS) == set(DESCRIPTIONS)


def test_refused_options_keep_limit_and_words() -> None:
    result = not_evaluated(wanted("delay_margin", "at_least", 5e-3), "no equilibrium")
    assert (result.limit, result.unit, result.reason) == (5.0, "ms", "no equilibrium")
    assert result.verdict is Verdict.NOT_EVALUATED
