"""Solving inequalities many times: problems kept by shape, a time limit that holds, and outcomes as values."""

from __future__ import annotations

import threading
import time
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import Status
from maglev_ctrl.synthesis.lmi.conditions import Family, Shape, build

Solver = Literal["CLARABEL", "CVXOPT", "SCS"]
OUTCOMES = {
    "optimal": Status.SOLVED,
    "optimal_inaccurate": Status.ALMOST_SOLVED,
    "infeasible": Status.INFEASIBLE,
    "infeasible_inaccurate": Status.INFEASIBLE,
    "unbounded": Status.UNBOUNDED,
    "unbounded_inaccurate": Status.UNBOUNDED,
    "user_limit": Status.TIME_LIMIT,
}
VIOLATION = 1e-6
"""Largest violation of a scaled constraint at a point a solver was not sure of, for the point to be looked at."""
GRACE = 10.0
"""Seconds past its time limit after which a solver that has not come back is left behind."""


class Clock:
    """Time left of a limit in seconds.

    Examples
    --------
    >>> Clock(0.0).left
    0.0
    """

    def __init__(self, limit: float) -> None:
        self.limit = limit
        self._end = time.monotonic() + limit

    @property
    def left(self) -> float:
        """Seconds left, never negative."""
        return max(0.0, self._end - time.monotonic())

    def part(self, share: float) -> Clock:
        """A clock that has a share of what is left, so that something is left for what follows.

        Examples
        --------
        >>> Clock(0.0).part(0.5).left
        0.0
        """
        return Clock(share * self.left)


@dataclass(frozen=True, eq=False, slots=True)
class Answer:
    """One solve: `values` of the variables where there are any, `certain` False where the solver was not sure."""

    status: Status
    values: Mapping[str, FloatArray]
    certain: bool = True
    seconds: float = 0.0

    @property
    def usable(self) -> bool:
        """There is a point to look at (to be proved, not to be believed)."""
        return bool(self.values) and self.status in (Status.SOLVED, Status.ALMOST_SOLVED)

    @property
    def certain_no(self) -> bool:
        """The solver is sure that there is no point."""
        return self.status is Status.INFEASIBLE and self.certain


class LmiSession:
    """Problems kept by shape, so that the next operating point costs a solve and no new problem.

    Examples
    --------
    >>> session = LmiSession()
    >>> session.family(Shape(1, 2, 1)) is session.family(Shape(1, 2, 1))
    True
    """

    def __init__(self) -> None:
        self._families: dict[Shape, Family] = {}
        self._compiled: set[tuple[Shape, Solver]] = set()

    def family(self, shape: Shape) -> Family:
        """The problem of a shape, built on first use."""
        if shape not in self._families:
            self._families[shape] = build(shape)
        return self._families[shape]

    def solve(self, shape: Shape, numbers: Mapping[str, Any], *, clock: Clock, solver: Solver = "CLARABEL") -> Answer:
        """Solve a problem of a shape with the numbers given; other parameters are zero."""
        if clock.left <= 0.0:
            return Answer(Status.TIME_LIMIT, {})
        family = self.family(shape)
        for name, parameter in family.parameters.items():
            value = numbers.get(name, 0.0)
            parameter.value = np.broadcast_to(np.asarray(value, dtype=float), parameter.shape)
        fresh = (shape, solver) not in self._compiled
        answer = solve_problem(family.problem, family.variables, clock=clock, solver=solver, fresh=fresh)
        self._compiled.add((shape, solver))
        if answer.status is Status.TIME_LIMIT:  # a solver left behind may still hold this problem
            del self._families[shape]
            self._compiled = {one for one in self._compiled if one[0] != shape}
        return answer


def solve_problem(
    problem: Any, variables: Mapping[str, Any], *, clock: Clock, solver: Solver = "CLARABEL", fresh: bool = True
) -> Answer:  # fmt: skip
    """Solve one cvxpy problem within the time left; neither raises nor warns for what a solver can do.

    Raises
    ------
    ImportError : the solver asked for is not installed
    MemoryError : there was not enough of it
    """
    import cvxpy

    if solver != "CLARABEL" and solver not in cvxpy.installed_solvers():
        raise ModuleNotFoundError(f"the solver {solver} is not installed; CLARABEL always is")
    started = time.monotonic()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if fresh:
            problem.get_problem_data(solver)  # compiled first, so that the time left is the solver's
        if clock.left <= 0.0:
            return Answer(Status.TIME_LIMIT, {}, seconds=time.monotonic() - started)
        limits: dict[Solver, dict[str, Any]] = {
            "CLARABEL": {"time_limit": clock.left},
            "CVXOPT": {"max_iters": 200},
            "SCS": {"time_limit_secs": clock.left},
        }
        settings = limits[solver]
        # A solver started from the last point's factors would answer differently by what was solved before.
        ended = _within(clock.left + GRACE, lambda: problem.solve(solver=solver, warm_start=False, **settings))
    if not ended:
        late = clock.left <= 0.0
        return Answer(Status.TIME_LIMIT if late else Status.NUMERICAL_ERROR, {}, False, time.monotonic() - started)
    status = OUTCOMES.get(str(problem.status), Status.NUMERICAL_ERROR)
    values: dict[str, FloatArray] = {}
    for name, variable in variables.items():
        if variable.value is not None and np.all(np.isfinite(variable.value)):
            values[name] = np.array(variable.value, dtype=np.float64)
    if status is Status.TIME_LIMIT and clock.left > 0.0:
        status = Status.ITERATION_LIMIT
    broken = any(one.value is not None and not np.all(np.isfinite(one.value)) for one in variables.values())
    if status in (Status.SOLVED, Status.ALMOST_SOLVED) and (broken or not values):
        return Answer(Status.NUMERICAL_ERROR, {}, False, time.monotonic() - started)  # solved, it says, without numbers
    certain = "inaccurate" not in str(problem.status)
    if values and status in (Status.ALMOST_SOLVED, Status.ITERATION_LIMIT):
        if _violation(problem) > VIOLATION:
            return Answer(Status.NUMERICAL_ERROR, {}, False, time.monotonic() - started)
        status = Status.ALMOST_SOLVED
    return Answer(status, values, certain, time.monotonic() - started)


def _within(seconds: float, call: Callable[[], object]) -> bool:
    """Whether a solver came back without a fault; one that stays past its own limit is left behind to itself.

    Raises
    ------
    ImportError : something the solver needs is not installed
    MemoryError : there was not enough of it
    """
    faults: list[BaseException] = []

    def run() -> None:
        try:
            call()
        except BaseException as fault:  # a solver's panic is no ordinary exception
            faults.append(fault)

    # Native code cannot be stopped from outside; a thread can be waited for no longer, and ends with the process.
    thread = threading.Thread(target=run, daemon=True, name="solver")
    thread.start()
    thread.join(seconds)
    if thread.is_alive():
        return False
    for fault in faults:
        if isinstance(fault, ImportError | MemoryError):
            raise fault
    return not faults


def _violation(problem: Any) -> float:
    """Largest violation of any constraint relative to its size; of a matrix inequality its most negative eigenvalue."""
    worst = 0.0
    for one in problem.constraints:
        sizes = [float(np.max(np.abs(part.value), initial=0.0)) for part in one.args if part.value is not None]
        size = max([1.0, *sizes])
        worst = max(worst, float(np.max(one.violation())) / size)
    return worst
