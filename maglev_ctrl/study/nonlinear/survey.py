"""survey_simulation(scenario, option): one option simulated on request, with what a page and a data file need."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime

from threadpoolctl import threadpool_limits

from maglev_ctrl.scenario import OptionRecord, Scenario, describe_option
from maglev_ctrl.scenario.problems import near_match
from maglev_ctrl.scenario.tuning_schema import Simulation
from maglev_ctrl.study.nonlinear.records import SimulationStudy
from maglev_ctrl.study.nonlinear.run import simulate_option
from maglev_ctrl.study.run import versions, with_forces

Progress = Callable[[str, float], None]
_STAGES = (
    "control law", "small motions", "runs of", "standard deviations", "parametric tongue", "stability boundaries",
    "region of attraction",
)  # fmt: skip


def chosen_option(scenario: Scenario, name: str | None) -> OptionRecord:
    """The option of a name; the only one where none is given.

    Raises
    ------
    ValueError : no such option, or several to choose from and no name
    """
    known = {option.name: option for option in scenario.options}
    if name is None:
        if len(known) > 1:
            raise ValueError(f"--option: the scenario has several options; choose one of {', '.join(known)}")
        return scenario.options[0]
    if name not in known:
        raise ValueError(f'--option: no option is called "{name}"{near_match(name, known)}')
    return known[name]


def survey_simulation(
    scenario: Scenario,
    option: OptionRecord,
    request: Simulation,
    *,
    speed: float | None = None,
    everything: bool = True,
    jobs: int = 1,
    progress: Progress | None = None,
) -> SimulationStudy:
    """Design one option, simulate it, and compare it with the linear theory.

    Parameters
    ----------
    request : how long, how often, how sampled
    speed : m/s, in place of the design speed
    everything : False leaves out boundaries, tongue and region of attraction
    jobs : processes that share the solution of eddy-current forces, where there are any

    Raises
    ------
    ModelError : there is no equilibrium, or the law does not exist
    OutOfDomain : the forces are not known there
    """
    tell = progress or (lambda what, fraction: None)
    scenario, tell = with_forces(scenario, jobs, tell)

    def step(what: str) -> None:
        at = next((i for i, stage in enumerate(_STAGES) if stage in what), 0)
        tell(what, at / len(_STAGES))

    with threadpool_limits(limits=1):
        study, trajectory = simulate_option(
            scenario, option, request, speed=speed, step=step, everything=everything
        )  # fmt: skip
    return SimulationStudy(
        title=scenario.title, name=scenario.name, scenario_hash=scenario.hash, scenario_text=scenario.text,
        option=option.name, label=option.label or option.name, summary=describe_option(scenario, option), study=study,
        trajectory=trajectory, versions=versions(), created=datetime.now(UTC).isoformat(timespec="seconds"),
    )  # fmt: skip
