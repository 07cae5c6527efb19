"""Whatever a file says, reading it ends in a scenario or in a placed message, never in anything else."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from maglev_ctrl.scenario import ScenarioProblems, load
from maglev_ctrl.scenario.starter import starter_text

LINES = starter_text("Property").splitlines()
VALUES = [
    "1", "-1", "0", "nan", "inf", "true", '""', '"x"', '"1 m"', '"-1 kg"', "[]", "{}", "[[1]]", "1979-05-27", '"heave"',
    '"bogies"', '["car", "car"]', '["front", "car"]', '"1e308 km"', '"table"', '"coefficients"', '"double_l"', '"lqr"',
]  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("scenario")


@settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    changes=st.lists(
        st.tuples(st.integers(0, len(LINES) - 1), st.one_of(st.none(), st.sampled_from(VALUES))), min_size=1, max_size=4
    )
)
def test_any_change_is_read_or_explained(folder: Path, changes: list[tuple[int, str | None]]) -> None:
    lines = list(LINES)
    for index, value in changes:
        key, equals, _ = lines[index].partition(" = ")
        lines[index] = f"{key}{equals}{value}" if value is not None and equals else ""
    file = folder / "case.toml"
    file.write_text("\n".join(lines), encoding="utf-8")
    try:
        load(file)
    except ScenarioProblems as error:
        for problem in error.problems:
            assert problem.message
            assert 1 <= problem.line <= len(lines) + 1 and problem.column >= 1


@settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.binary(max_size=400))
def test_any_bytes_are_refused_with_a_message(folder: Path, content: bytes) -> None:
    file = folder / "bytes.toml"
    file.write_bytes(content)
    with pytest.raises(ScenarioProblems):
        load(file)
