"""The predictive law at work: one verified plan per sample, and the proved law where there is none."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import Status
from maglev_ctrl.synthesis.predictive.condensed import Backend, BoxSolution, Signs, shifted, solve_box
from maglev_ctrl.synthesis.predictive.design import PredictiveDesign
from maglev_ctrl.synthesis.predictive.estimate import Targets
from maglev_ctrl.synthesis.predictive.general import ACCEPTED, GeneralSolver, Now, PlanSolution
from maglev_ctrl.synthesis.predictive.quadratic import quadratic_program

AT_LIMIT = 1e-7
"""A command nearer to its limit than this share of the limits' width is at it."""


@dataclass(frozen=True, eq=False, slots=True)
class MoveRecord:
    """One move of the law and the evidence for it.

    `command` (nu,) to apply; `moves` (N, nu) and `states` (N + 1, n) the plan, empty where the fallback acts;
    `estimate` (n + nd,) of state and disturbance it rests on; `path` "condensed", "general" or "fallback";
    `active` names of the limits this move is at, `active_ahead` of all commands over the horizon at one; `broken` the
    largest amount by which the plan breaks each soft limit; `residual` of the optimality conditions, found without the
    solver; `message` why the law fell back, or what was given up.
    """

    command: FloatArray
    moves: FloatArray
    states: FloatArray
    estimate: FloatArray
    path: str
    status: Status
    active: tuple[str, ...]
    active_ahead: int
    broken: dict[str, float]
    residual: float
    iterations: int
    message: str

    @property
    def fallback(self) -> bool:
        """Whether the proved law acted instead of the plan."""
        return self.path == "fallback"


class PredictiveController:
    """The law of one design, with what it remembers from sample to sample: estimate, last command, active limits."""

    def __init__(self, design: PredictiveDesign, *, time_limit: float = 1.0, backend: Backend = "numpy") -> None:
        """A law at rest.

        Parameters
        ----------
        time_limit : s for a solver in one sample (general path)
        backend : of the condensed path, "numpy" or "fast" (numba)

        Raises
        ------
        ModelError : the design's fallback law was not proved

        Examples
        --------
        >>> from maglev_ctrl.synthesis.predictive.design import design_predictive
        >>> from maglev_ctrl.synthesis.predictive.problem import predictive_problem
        >>> from maglev_ctrl.systems.plant import Plant
        >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]], dt=0.1)
        >>> limits = {"command_limits": ([-1.0], [1.0]), "terminal": "cost"}
        >>> problem = predictive_problem(plant, horizon=5, Q=[[1.0]], R=[[1.0]], **limits)
        >>> law = PredictiveController(design_predictive(problem))
        >>> [law.step([x]).command.round(6).tolist() for x in (0.1, 9.0)]
        [[-0.061803], [-1.0]]
        """
        design.synthesis.require()
        self.design = design
        self._general: GeneralSolver | None = None
        problem, scale = design.problem, design.condensed.scale
        self._box = tuple(np.tile(x, problem.horizon) / scale for x in (problem.command_lower, problem.command_upper))
        self._time_limit, self._backend = time_limit, backend
        self.reset()

    def reset(self, estimate: ArrayLike | None = None, *, last_command: ArrayLike | None = None) -> None:
        """Forget everything: start from this estimate of state and disturbance and this last command, else zeros.

        Raises
        ------
        ValueError : a shape does not fit
        """
        design = self.design
        plant, n_d = design.problem.plant, design.disturbances
        size = len(plant.states) + n_d
        self._estimate = np.zeros(size) if estimate is None else np.array(estimate, dtype=float)
        self._last = np.zeros(len(plant.commands)) if last_command is None else np.array(last_command, dtype=float)
        if self._estimate.shape != (size,) or self._last.shape != (len(plant.commands),):
            raise ValueError(
                f"reset: expected {size} numbers of state and disturbance and {len(plant.commands)} commands"
            )
        self._active: Signs | None = None

    def step(self, measured: ArrayLike, reference: ArrayLike | None = None) -> MoveRecord:
        """The move of this sample; with a filter, `decide` and then `observe`.

        Parameters
        ----------
        measured : (ny,) measured outputs now; without filter the state itself
        reference : values (nr,) the tracked outputs shall reach; zero when left out

        Raises
        ------
        ValueError : a shape does not fit, a measurement is not finite, or it feels the command at once (D22), so that
            it cannot be known before the command is
        """
        if self.design.estimator is None:
            return self.decide(measured, reference)
        if np.any(self.design.problem.plant.D22):
            raise ValueError("measured: it feels the command at once; call decide, apply the command, then observe")
        y = self._checked(measured)
        record = self.decide(None, reference)
        self.observe(y)
        return record

    def decide(self, state: ArrayLike | None = None, reference: ArrayLike | None = None) -> MoveRecord:
        """The move of this sample from the state itself, or from the filter's estimate.

        Parameters
        ----------
        state : (n,) where the law has no filter, else None
        reference : values (nr,) the tracked outputs shall reach; zero when left out

        Raises
        ------
        ValueError : a shape does not fit
        """
        design = self.design
        if (state is None) != (design.estimator is not None):
            raise ValueError("state: expected the state of a law without filter, and none for a law with one")
        r = np.zeros(len(design.targets.tracked)) if reference is None else np.asarray(reference, dtype=float)
        if r.shape != (len(design.targets.tracked),):
            raise ValueError(f"reference: expected {len(design.targets.tracked)} numbers, got {reference!r}")
        record = self._move(self._estimate if state is None else self._checked(state), r)
        self._last = record.command
        return record

    def observe(self, measured: ArrayLike) -> None:
        """Tell the filter what was measured while the last command was applied; nothing to do without filter.

        Raises
        ------
        ValueError : a shape does not fit or a measurement is not finite
        """
        if self.design.estimator is not None:
            self._estimate = self.design.estimator.update(self._estimate, self._checked(measured), self._last)

    def _checked(self, measured: ArrayLike) -> FloatArray:
        y, count = np.array(measured, dtype=float), len(self.design.problem.plant.measured)
        if y.shape != (count,) or not np.isfinite(y).all():
            raise ValueError(f"measured: expected {count} finite numbers, got {measured!r}")
        return y

    def _move(self, estimate: FloatArray, reference: FloatArray) -> MoveRecord:
        problem = self.design.problem
        now, told = self._now(estimate, reference)
        state = estimate[: now.x0.size]
        box = self._boxed(now)
        if box.residual <= ACCEPTED:
            moves = box.plan * self.design.condensed.scale
            if problem.limits_commands_only or self._admits(now, moves):
                self._active = shifted(box.active, now.command.size)
                return self._record(estimate, now, moves, ("condensed", box.residual, box.iterations, told), state)
        if problem.limits_commands_only:
            why = "the condensed program was not solved to a verified point"
            return self._fallback(estimate, now, (Status.NOT_VERIFIED, told, why), state)
        plan = self._general_plan(now)
        if plan.status is not Status.SOLVED:
            return self._fallback(estimate, now, (plan.status, told, plan.message), state)
        self._active = shifted(box.active, now.command.size)
        evidence = ("general", plan.residual.largest, plan.iterations, told)
        return self._record(estimate, now, plan.moves.ravel(), evidence, state, plan)

    def _now(self, estimate: FloatArray, reference: FloatArray) -> tuple[Now, str]:
        n = len(self.design.problem.plant.states)
        if estimate.size == n and not reference.size:
            return self.design.at_origin(estimate, self._last), ""
        rest, command, told = limited_target(self.design, estimate[n:], reference)
        return self.design.now(estimate[:n], (rest, command), self._last), told

    def _boxed(self, now: Now) -> BoxSolution:
        """The plan under the commands' own limits: the whole answer wherever it keeps the other limits too."""
        condensed, (lower, upper) = self.design.condensed, self._box
        if now.command.any():
            moved = np.tile(now.command, self.design.problem.horizon) / condensed.scale
            lower, upper = lower - moved, upper - moved
        return solve_box(condensed, now.x0, lower, upper, active=self._active, backend=self._backend)

    def _admits(self, now: Now, moves: FloatArray) -> bool:
        condensed, program = self.design.condensed, self.design.program
        states = condensed.states @ now.x0 + condensed.response @ moves
        return program.admits(program.unknowns(states, moves), now)

    def _general_plan(self, now: Now) -> PlanSolution:
        if self._general is None:
            self._general = GeneralSolver(self.design.program, time_limit=self._time_limit)
        return self._general.solve(now)

    def _record(
        self, estimate: FloatArray, now: Now, moves: FloatArray, evidence: tuple[str, float, int, str],
        state: FloatArray, plan: PlanSolution | None = None,
    ) -> MoveRecord:  # fmt: skip
        problem, condensed = self.design.problem, self.design.condensed
        lower, upper, count = problem.command_lower, problem.command_upper, problem.horizon
        n, n_u = problem.plant.B2.shape
        absolute = np.minimum(np.maximum(moves.reshape(count, n_u) + now.command, lower), upper)
        states = np.empty((count + 1, n))
        states[0] = state
        ahead = condensed.states @ now.x0 + condensed.response @ moves if plan is None else plan.states
        states[1:] = ahead.reshape(count, n) + (state - now.x0)
        near = AT_LIMIT * condensed.scale[:n_u]
        above, below = absolute >= upper - near, absolute <= lower + near
        broken = {}
        if plan is not None and plan.broken.size:
            soft = [limit.name for limit in problem.output_limits if limit.soft]
            worst = np.max(plan.broken, axis=0)
            broken = {name: float(worst[i]) for i, name in enumerate(soft) if worst[i] > 0.0}
        path, residual, iterations, message = evidence
        absolute, states, estimate = _kept(absolute), _kept(states), _kept(estimate.copy())
        return MoveRecord(
            command=absolute[0], moves=absolute, states=states, estimate=estimate, path=path, status=Status.SOLVED,
            active=_named(problem.plant.commands, above[0], below[0]),
            active_ahead=int(np.count_nonzero(above) + np.count_nonzero(below)), broken=broken, residual=residual,
            iterations=iterations, message=message,
        )  # fmt: skip

    def _fallback(
        self, estimate: FloatArray, now: Now, why: tuple[Status, str, str], state: FloatArray
    ) -> MoveRecord:  # fmt: skip
        self._active = None
        problem = self.design.problem
        command, estimate = _kept(saturated(self.design, now)), _kept(estimate.copy())
        return MoveRecord(
            command=command, moves=np.zeros((0, command.size)), states=np.zeros((0, state.size)), estimate=estimate,
            path="fallback", status=why[0],
            active=_named(problem.plant.commands, command >= problem.command_upper, command <= problem.command_lower),
            active_ahead=0, broken={}, residual=np.inf, iterations=0,
            message="; ".join(filter(None, (why[1], f"the proved law acts, within the limits: {why[2]}"))),
        )  # fmt: skip


class SaturatedController(PredictiveController):
    """The regulator with its commands cut at their limits, with the same filter and targets: what to compare with."""

    def _move(self, estimate: FloatArray, reference: FloatArray) -> MoveRecord:
        now, told = self._now(estimate, reference)
        record = self._fallback(estimate, now, (Status.SOLVED, told, ""), estimate[: now.x0.size])
        return replace(record, path="saturated", message=told, residual=0.0)


def saturated(design: PredictiveDesign, now: Now) -> FloatArray:
    """The regulator's command within the limits of commands and rates (nu,)."""
    problem = design.problem
    command = now.command - design.gain @ now.x0
    lower = np.maximum(problem.command_lower, now.last - problem.rate)
    upper = np.minimum(problem.command_upper, now.last + problem.rate)
    return np.minimum(np.maximum(command, lower), upper)


def limited_target(
    design: PredictiveDesign, disturbance: FloatArray, reference: FloatArray
) -> tuple[FloatArray, FloatArray, str]:
    """Steady state and command; within the limits, and as near to the wanted outputs as these allow, with the words.

    Where the exact target asks for too much: least squares of the tracked outputs' errors (plus 1e-6 of the commands',
    by their weights) subject to the plant at rest and the limits of the commands.
    """
    rest, command = design.targets.at(disturbance, reference)
    problem = design.problem
    lower, upper = problem.command_lower, problem.command_upper
    if np.all(command >= lower) and np.all(command <= upper):
        return rest, command, ""
    nearest = _nearest_target(design, design.targets, disturbance, (rest, command))
    if nearest is None:
        return rest, np.clip(command, lower, upper), "the target is out of reach of the commands and was cut"
    return *nearest, "the target is out of reach of the commands; the nearest one within them is taken"


def _nearest_target(
    design: PredictiveDesign, targets: Targets, disturbance: FloatArray, exact: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray] | None:
    problem, plant = design.problem, design.problem.plant
    n, n_u = plant.B2.shape
    pick = [plant.measured.index(name) for name in targets.tracked]
    unit = design.condensed.scale[:n_u]
    # unknowns: change of state and command from the exact target, for which the plant is at rest with d
    rows = np.hstack([plant.C2[pick], plant.D22[pick] * unit])
    errors = rows / np.maximum(np.abs(rows).max(axis=1, initial=0.0), 1e-300)[:, None]
    weight = errors.T @ errors
    weight[n:, n:] += 1e-6 * np.eye(n_u)
    if not pick:
        weight[:n, :n] += problem.Q / max(float(np.max(np.abs(problem.Q))), 1e-300)
    still = np.hstack([plant.A - np.eye(n), plant.B2 * unit])
    A = np.vstack([still, np.hstack([np.zeros((n_u, n)), np.eye(n_u)])])
    lower = np.concatenate([np.zeros(n), (problem.command_lower - exact[1]) / unit])
    upper = np.concatenate([np.zeros(n), (problem.command_upper - exact[1]) / unit])
    found = quadratic_program(weight, np.zeros(n + n_u), A, lower, upper)
    if found.status not in (Status.SOLVED, Status.ALMOST_SOLVED):
        return None
    command = np.clip(exact[1] + found.x[n:] * unit, problem.command_lower, problem.command_upper)
    return exact[0] + found.x[:n], command


def _kept(array: FloatArray) -> FloatArray:
    array.flags.writeable = False
    return array


def _named(commands: tuple[str, ...], above: NDArray[np.bool_], below: NDArray[np.bool_]) -> tuple[str, ...]:
    if not (above.any() or below.any()):
        return ()
    return tuple(
        f"{name} at its {side} limit"
        for name, high, low in zip(commands, above, below, strict=True)
        for side, there in (("upper", high), ("lower", low))
        if there
    )
