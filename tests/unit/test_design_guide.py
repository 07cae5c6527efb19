"""Every table the guide to designs shows is one a scenario takes, and every law has one."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

import pytest
from design_fixture import VEHICLE, read

from maglev_ctrl.scenario.control_schema import ControlRecord

GUIDE = Path(__file__).parents[2] / "docs" / "guides" / "design_laws.md"
BLOCKS = re.findall(r"^```toml\n(.*?)^```$", GUIDE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
FRAME = next(block for block in BLOCKS if "[[option.actuator]]" in block)
TABLES = [block for block in BLOCKS if block.startswith("[option.control]")]


@pytest.mark.parametrize("table", TABLES, ids=lambda table: re.search(r'law = "(\w+)"', table)[1])
def test_a_table_of_the_guide_is_taken(table: str, tmp_path: Path) -> None:
    option = read(VEHICLE + FRAME + table, tmp_path).options[-1]
    assert option.control is not None and f'law = "{option.control.law}"' in table


def test_the_budget_of_the_guide_is_taken(tmp_path: Path) -> None:
    (block,) = (block for block in BLOCKS if "[option.damping_budget]" in block)
    assert read(VEHICLE + block, tmp_path).options[-1].damping_budget is not None


def test_every_law_has_a_table() -> None:
    records = get_args(get_args(ControlRecord)[0])
    laws = {law for record in records for law in get_args(record.model_fields["law"].annotation)}
    assert laws == {found for table in TABLES for found in re.findall(r'^law = "(\w+)"', table, re.MULTILINE)}
