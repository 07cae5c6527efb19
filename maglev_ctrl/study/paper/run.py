"""reproduce() -> Reproduction: the whole paper from geometry alone."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from typing import Any

from threadpoolctl import threadpool_limits

from maglev_ctrl._version import __version__
from maglev_ctrl.errors import Agreement
from maglev_ctrl.study.paper.cases import (
    ASSUMPTIONS,
    DEFAULT,
    GAP_RANGE,
    HEIGHT_RANGE,
    LONG_FLOOR,
    LONG_WALL,
    SENSITIVITY,
    Provider,
)
from maglev_ctrl.study.paper.claims_double_l import GAPS_OF_FIG_15, double_l_claims
from maglev_ctrl.study.paper.claims_forces import force_claims
from maglev_ctrl.study.paper.claims_image import image_claims
from maglev_ctrl.study.paper.double_l import Line, sweep
from maglev_ctrl.study.paper.evidence import Evidence, Ranges
from maglev_ctrl.study.paper.image_theory import figure_tables
from maglev_ctrl.study.paper.magnet_forces import SPEED, force_tables, guidance_extremes, reciprocity_residual
from maglev_ctrl.study.paper.records import (
    MODELS,
    DataTable,
    EigenSweep,
    Extreme,
    GuidewayCase,
    Model,
    Reproduction,
    SensitivityRow,
    SolvedCase,
)
from maglev_ctrl.study.paper.speeds import SLOW, SLOW_SCAN, speed_study
from maglev_ctrl.study.paper.table1 import PRINTED, mode_table
from maglev_ctrl.study.paper.tables import eigen_table, mode_data_table, speed_tables
from maglev_ctrl.study.workers import Lost, shared

Progress = Callable[[str, float], None]
OFFSET_ROOM = GAP_RANGE[0]  # m: a magnet comes no nearer to the wall than this
QUICK_NOTE = "Sensitivity to the assumptions was skipped (--quick)."


@dataclass(frozen=True, slots=True)
class Figure:
    """One eigenvalue figure: over height where `height` is None, else over the lateral offset, m."""

    key: str
    gap: float
    height: float | None = None


FIGURES = (
    Figure("fig10", 12.7e-3),
    Figure("fig12", 5e-3),
    Figure("fig13", 25e-3, 12.7e-3),
    Figure("fig14", 25e-3, 7e-3),
    *(Figure(f"fig15_{1e3 * gap:.0f}", gap, 7e-3) for gap in GAPS_OF_FIG_15),
)


def reproduce(
    provider: Provider, *, quick: bool = False, jobs: int = 1, progress: Progress | None = None
) -> Reproduction:
    """Compute every figure and table of the paper and judge every claim.

    Parameters
    ----------
    provider : solves the forces of a guideway case, such as `cases.eddy_current`
    quick : leave the sensitivity section out
    jobs : processes that share the cases
    progress : told what was done and the fraction of the whole, 0 to 1

    Raises
    ------
    ValueError : jobs is below one
    ModelError : the processes cannot start, or a case cannot be solved

    Examples
    --------
    >>> from maglev_ctrl.study.paper.cases import perfect_conductor
    >>> found = reproduce(perfect_conductor, quick=True)                # doctest: +SKIP
    >>> [round(1e3 * x, 2) for x in found.sweep("fig10", "P").flutter[0]]  # doctest: +SKIP
    [17.24, 22.3]
    """
    if jobs < 1:
        raise ValueError(f"jobs: expected one or more, got {jobs}")
    started = time.perf_counter()
    tell = progress or (lambda what, fraction: None)
    others = (LONG_WALL, LONG_FLOOR, *(() if quick else SENSITIVITY))
    share = 1.0 / (len(others) + 1)  # of the progress, each case
    with threadpool_limits(limits=1):
        tell("forces of the default guideway", 0.0)
        solved = provider(DEFAULT)
        evidence = _default(solved, lambda what, part: tell(what, share * part))
    notes: list[str] = [QUICK_NOTE] if quick else []
    rows: list[SensitivityRow] = [] if quick else [_sensitivity_row(solved, evidence.sweeps)]
    found: dict[str, Any] = {}
    for done, (case, outcome) in enumerate(_each(partial(_outcome, provider), others, jobs), 1):
        if isinstance(outcome, Lost):
            notes.append(f"{case.label}: {outcome.reason}")
        else:
            found[case.name] = outcome
        tell(f"{case.label}: done", share * (1 + done))
    edges = {case.name: found[case.name] for case in (LONG_WALL, LONG_FLOOR) if case.name in found}
    evidence = replace(evidence, extremes={**evidence.extremes, **edges})
    rows += [found[case.name] for case in others if case.question == "sensitivity" and case.name in found]
    claims = (*force_claims(evidence), *double_l_claims(evidence), *image_claims(evidence))
    return Reproduction(
        solved=solved, quick=quick, assumptions=ASSUMPTIONS, tables=_tables(evidence), extremes=evidence.extremes,
        sweeps=tuple(evidence.sweeps.values()), modes=evidence.modes, speeds=evidence.speeds, sensitivity=tuple(rows),
        claims=claims, notes=tuple(notes), version=__version__,
        created=datetime.now(UTC).isoformat(timespec="seconds"), seconds=time.perf_counter() - started,
    )  # fmt: skip


def _each(task: Callable[[GuidewayCase], Any], cases: tuple[GuidewayCase, ...], jobs: int) -> Iterator[tuple[Any, Any]]:
    if jobs == 1:
        with threadpool_limits(limits=1):
            yield from ((case, task(case)) for case in cases)
        return
    with closing(shared(task, cases, workers=min(jobs, len(cases)))) as results:
        for position, outcome in results:
            yield cases[position], outcome


def _default(solved: SolvedCase, tell: Progress) -> Evidence:
    """Everything that is asked of the default guideway."""
    sweeps: dict[tuple[str, Model], EigenSweep] = {}
    for i, figure in enumerate(FIGURES):
        tell(f"eigenvalues, {figure.key}", 0.5 + 0.5 * i / len(FIGURES))
        sweeps.update({(figure.key, model): sweep_of(solved, figure, model) for model in MODELS})
    slow: dict[float, tuple[Extreme, ...]] = {}
    if solved.any_speed is not None:
        slow = {
            v: guidance_extremes(solved.any_speed, heights=HEIGHT_RANGE, gaps=GAP_RANGE, speed=v, scan=SLOW_SCAN)
            for v in SLOW
        }
    return Evidence(
        solved=solved,
        extremes={"default": guidance_extremes(solved.force, heights=HEIGHT_RANGE, gaps=GAP_RANGE)},
        slow_extremes=slow,
        sweeps=sweeps,
        modes=tuple(
            mode_table(solved.force, height=height, gap=12.7e-3, speed=SPEED, model=model)
            for model in MODELS
            for height in PRINTED
        ),
        reciprocity=reciprocity_residual(solved.force, heights=HEIGHT_RANGE, gaps=GAP_RANGE),
        speeds=speed_study(solved),
    )


def sweep_of(solved: SolvedCase, figure: Figure, model: Model) -> EigenSweep:
    """The sweep of one figure with one model, over the whole range of the forces.

    Parameters
    ----------
    figure : one of FIGURES
    model : P, C or CG
    """
    if figure.height is None:
        return sweep(figure.key, Line(solved.force, SPEED, figure.gap, "height"), model, *HEIGHT_RANGE)
    reach = figure.gap - OFFSET_ROOM
    line = Line(solved.force, SPEED, figure.gap, "lateral_offset", figure.height)
    return sweep(figure.key, line, model, -reach, reach)


def _outcome(provider: Provider, case: GuidewayCase) -> tuple[Extreme, ...] | SensitivityRow:
    """What a case other than the default is solved for."""
    solved = provider(case)
    if case.question == "edge":
        return guidance_extremes(solved.force, heights=HEIGHT_RANGE, gaps=GAP_RANGE)
    chosen = [figure for figure in FIGURES if not figure.key.startswith("fig15")]
    return _sensitivity_row(
        solved, {(figure.key, model): sweep_of(solved, figure, model) for figure in chosen for model in MODELS}
    )


def _sensitivity_row(solved: SolvedCase, sweeps: dict[tuple[str, Model], EigenSweep]) -> SensitivityRow:
    here = solved.force.forces(12.7e-3, 12.7e-3, SPEED)
    flutter: dict[str, Ranges] = {}
    divergence: dict[str, Ranges] = {}
    for key in ("fig10", "fig12", "fig13", "fig14"):
        for model in MODELS:
            flutter[f"{key} {model}"] = sweeps[key, model].flutter
            divergence[f"{key} {model}"] = sweeps[key, model].divergence
    used = [sweeps[key, model] for key in ("fig10", "fig12", "fig13", "fig14") for model in MODELS]
    agreed = all(one.agreement is Agreement.AGREED for one in used)
    return SensitivityRow(
        solved.case.label, (float(here.lift), float(here.guidance), float(here.drag)), flutter, divergence,
        Agreement.AGREED if agreed else Agreement.UNRESOLVED,
    )  # fmt: skip


def _tables(evidence: Evidence) -> tuple[DataTable, ...]:

    return (
        *figure_tables(),
        *force_tables(evidence.solved.force, heights=HEIGHT_RANGE, gaps=GAP_RANGE),
        *(eigen_table(one) for one in evidence.sweeps.values()),
        mode_data_table(evidence.modes),
        *speed_tables(evidence.speeds),
    )
