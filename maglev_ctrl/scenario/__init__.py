"""Scenario files: TOML with units in, checked frozen records and vehicles out."""

from maglev_ctrl.scenario.build import build_option, build_vehicle
from maglev_ctrl.scenario.control_law import ControlLaw, control_law
from maglev_ctrl.scenario.option_schema import OptionRecord
from maglev_ctrl.scenario.problems import Problem, ScenarioProblems
from maglev_ctrl.scenario.reader import load
from maglev_ctrl.scenario.requirement_schema import RequirementRecord
from maglev_ctrl.scenario.scenario_schema import Scenario, with_solved_force
from maglev_ctrl.scenario.schema_export import json_schema
from maglev_ctrl.scenario.words import describe_option

__all__ = [
    "ControlLaw",
    "OptionRecord",
    "Problem",
    "RequirementRecord",
    "Scenario",
    "ScenarioProblems",
    "build_option",
    "build_vehicle",
    "control_law",
    "describe_option",
    "json_schema",
    "load",
    "with_solved_force",
]
