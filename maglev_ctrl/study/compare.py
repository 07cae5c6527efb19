"""compare(scenario): every option tuned where the scenario asks for it, then studied in full."""

from __future__ import annotations

from dataclasses import replace

from maglev_ctrl.scenario import Scenario
from maglev_ctrl.study.records import Comparison
from maglev_ctrl.study.run import Progress, run, with_forces
from maglev_ctrl.study.tuning.run import tune

_TUNING = 0.7
"""Share of the progress that goes to tuning."""


def compare(scenario: Scenario, *, jobs: int = 1, progress: Progress | None = None, tuned: bool = True) -> Comparison:
    """Tune every option of a scenario that has the table [tuning], then judge all of them by the whole study.

    The comparison's scenario text is that of the tuned file: read again, it gives the same options.

    Parameters
    ----------
    jobs : processes; with more than one, call from under `if __name__ == "__main__":` as for any process pool
    progress : told what was done and the fraction of the whole, 0 to 1
    tuned : False judges the options as they are written

    Raises
    ------
    ValueError : jobs is below one
    ModelError : the processes cannot start, or the tuned options make no valid scenario
    ScenarioProblems : a design variable that is none

    Examples
    --------
    >>> from maglev_ctrl.scenario import load
    >>> found = compare(load("scenarios/compare/four_options.toml"), jobs=2)    # doctest: +SKIP
    >>> found.tuning.ranking[0].label                                           # doctest: +SKIP
    'Passive secondary'
    """
    if jobs < 1:
        raise ValueError(f"jobs: expected one or more, got {jobs}")
    if not tuned or scenario.tuning is None:
        return run(scenario, jobs=jobs, progress=progress)
    tell = progress or (lambda what, fraction: None)
    scenario, tell = with_forces(scenario, jobs, tell)
    chosen, study = tune(scenario, jobs=jobs, progress=lambda what, fraction: tell(what, _TUNING * fraction))
    found = run(chosen, jobs=jobs, progress=lambda what, fraction: tell(what, _TUNING + (1.0 - _TUNING) * fraction))
    return replace(found, tuning=study, seconds=found.seconds + study.seconds)
