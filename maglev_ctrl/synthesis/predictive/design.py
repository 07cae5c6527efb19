"""A predictive law with everything it promises: the proved law behind it, the sets, and the words on feasibility."""

from __future__ import annotations

import warnings
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve_discrete_lyapunov

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.errors import ModelError, Status
from maglev_ctrl.kernels import scaling
from maglev_ctrl.proofs.claims import Claim, EllipsoidClaim
from maglev_ctrl.proofs.makers import decay_claim
from maglev_ctrl.synthesis.predictive.condensed import CondensedProblem, condense
from maglev_ctrl.synthesis.predictive.estimate import DisturbanceModel, Estimator, Targets, estimator, targets
from maglev_ctrl.synthesis.predictive.general import Now, SparseProgram, sparse_program
from maglev_ctrl.synthesis.predictive.problem import PredictiveProblem
from maglev_ctrl.synthesis.predictive.terminal import TerminalSet, ellipsoid_level, limit_rows, terminal_set
from maglev_ctrl.synthesis.result import Synthesis, proven
from maglev_ctrl.synthesis.riccati_discrete import riccati_discrete
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant, closed_channel

LAW = "predictive control"
INVARIANT = 1e-7
"""Largest amount by which the next state may leave the terminal set for the set to count as invariant."""


@dataclass(frozen=True, eq=False, slots=True)
class PredictiveDesign:
    """Everything a predictive law needs, and the proof of the law it falls back on.

    `P` (n, n), `gain` (nu, n) of the regulator u = u_s - gain (x - x_s), terminal cost and fallback; `ellipsoid`
    (n, n): {x : x'E x <= 1} stays inside every limit under the regulator; `terminal` the polyhedron asked of the last
    state, None for its cost alone; `statements` what is promised and under which assumptions.
    """

    problem: PredictiveProblem
    P: FloatArray
    gain: FloatArray
    condensed: CondensedProblem
    program: SparseProgram
    terminal: TerminalSet | None
    ellipsoid: FloatArray
    estimator: Estimator | None
    targets: Targets
    synthesis: Synthesis
    statements: tuple[str, ...]

    @property
    def disturbances(self) -> int:
        """How many constant disturbances are estimated."""
        return 0 if self.estimator is None else len(self.estimator.model.names)

    def at_origin(self, state: FloatArray, last: FloatArray) -> Now:
        """What a sample brings where the target is the origin."""
        n_u, n_o = self.problem.output_through.shape[1], len(self.problem.output_limits)
        return Now(state, np.zeros(n_u), np.zeros(n_o), last)

    def now(self, state: FloatArray, target: tuple[FloatArray, FloatArray], last: FloatArray) -> Now:
        """What a sample brings, seen from a target (x_s, u_s)."""
        problem = self.problem
        outputs = problem.output_rows @ target[0] + problem.output_through @ target[1]
        room = [np.ones(1)]
        for value, lower, upper in (
            (target[1], problem.command_lower, problem.command_upper),
            (outputs, np.array([x.lower for x in problem.output_limits]),
             np.array([x.upper for x in problem.output_limits])),
        ):  # fmt: skip
            room += [1.0 - value / upper, 1.0 - value / lower]
        share = float(np.min(np.concatenate(room)))
        return Now(state - target[0], target[1], outputs, last, share if share > 1e-6 else 0.0)


def design_predictive(
    problem: PredictiveProblem,
    *,
    disturbance: DisturbanceModel | None = None,
    process: ArrayLike | None = None,
    drift: ArrayLike | float = 1.0,
    measurement: ArrayLike | None = None,
    tracked: tuple[str, ...] = (),
) -> PredictiveDesign:
    """Predictive control of a sampled plant; the law it falls back on is proved, or there is no law at all.

    Parameters
    ----------
    disturbance : constant disturbances to estimate, so that no offset stays; None for feedback of the state itself
    process, drift, measurement : covariances of the filter, as in `estimator`
    tracked : measured outputs that shall reach their reference

    Raises
    ------
    ValueError : shapes or names do not fit, or not every state is measured and there is no disturbance model
    ModelError : no stabilising regulator, a terminal set that was not found, or a filter that cannot see

    Examples
    --------
    >>> from maglev_ctrl.synthesis.predictive.problem import predictive_problem
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]], dt=0.1)
    >>> problem = predictive_problem(plant, horizon=5, Q=[[1.0]], R=[[1.0]], command_limits=([-1.0], [1.0]))
    >>> design = design_predictive(problem)
    >>> design.synthesis.status.name, round(float(design.ellipsoid[0, 0]), 6)
    ('SOLVED', 0.381966)
    """
    plant = problem.plant
    if disturbance is None and not plant.measures_states:
        raise ValueError(
            "plant: not every state is measured; give a disturbance model, so that a filter estimates them"
        )
    solved = riccati_discrete(plant.A, plant.B2, problem.Q, problem.R, problem.N)
    if solved.status not in (Status.SOLVED, Status.ALMOST_SOLVED):
        raise ModelError(f"{LAW}: no regulator; {solved.status.value}; {solved.message}")
    P, K = solved.P, solved.gain
    observer = None
    if disturbance is not None:
        observer = estimator(plant, disturbance, process=process, drift=drift, measurement=measurement)
    rest = targets(problem, disturbance, tracked)
    shape = lyapunov_shape(plant.A - plant.B2 @ K, problem, K)
    level = ellipsoid_level(shape, limit_rows(problem, K))
    ellipsoid = shape / (level if np.isfinite(level) else 1.0)
    terminal = terminal_set(problem, shape, K) if problem.terminal == "set" else None
    if terminal is not None and not terminal.excess <= INVARIANT:
        raise ModelError(
            f"{LAW}: no terminal set of reasonable size was proved invariant ({terminal.kind}, excess "
            f"{terminal.excess:.1e}); ask for terminal = 'cost' or move the limits apart"
        )
    law = fallback_law(plant, K, observer, rest)
    claims, notes = _claims(plant, law, problem, ellipsoid if observer is None else None)
    statements = _statements(problem, terminal, observer, rest)
    synthesis = proven(LAW, [plant], [law], claims=claims, notes=(*statements, *notes))
    return PredictiveDesign(
        problem=problem, P=P, gain=K, condensed=condense(problem, P, K),
        program=sparse_program(problem, P, K, terminal), terminal=terminal,
        ellipsoid=read_only(ellipsoid, name="ellipsoid"), estimator=observer, targets=rest, synthesis=synthesis,
        statements=statements,
    )  # fmt: skip


def fallback_law(plant: Plant, K: FloatArray, observer: Estimator | None, rest: Targets) -> Controller:
    """The regulator as a sampled controller: static, or with the filter and its targets (references at zero).

    Parameters
    ----------
    K : (nu, n), u = -K x
    rest : targets of the disturbances

    Examples
    --------
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]], dt=0.1)
    >>> empty = Targets(1, np.zeros((2, 0)), np.zeros((2, 0)), ())
    >>> fallback_law(plant, np.array([[0.6]]), None, empty).D
    array([[-0.6]])
    """
    if observer is None:
        return Controller.static(-K, measured=plant.measured, commands=plant.commands, name=LAW, dt=plant.dt)
    n = len(plant.states)
    by_d = rest.by_disturbance
    C = np.hstack([-K, by_d[n:] + K @ by_d[:n]])
    A = observer.A + observer.B @ C - observer.gain @ (observer.C + observer.D @ C)
    return Controller.from_matrices(
        A, observer.gain, C, np.zeros((len(plant.commands), len(plant.measured))),
        measured=plant.measured, commands=plant.commands, name=LAW, dt=plant.dt,
    )  # fmt: skip


def lyapunov_shape(closed: FloatArray, problem: PredictiveProblem | None, K: FloatArray) -> FloatArray:
    """A matrix E > 0 with A_c'E A_c < E, strictly: the regulator's cost to go, and a little of every state's own.

    Examples
    --------
    >>> float(lyapunov_shape(np.array([[0.5]]), None, np.zeros((0, 1)))[0, 0]) > 1.0
    True
    """
    scale = scaling.balance(closed)
    balanced = closed / scale[:, None] * scale
    own = _gramian(balanced, np.eye(len(closed)))
    if problem is not None:
        stage = problem.Q - problem.N @ K - K.T @ problem.N.T + K.T @ problem.R @ K
        cost = _gramian(balanced, 0.5 * (stage + stage.T) * np.outer(scale, scale))
        own = cost + 1e-4 * float(np.trace(cost) / np.trace(own)) * own if np.trace(cost) > 0.0 else own
    return np.asarray(0.5 * (own + own.T) / np.outer(scale, scale), dtype=float)


def _gramian(A: FloatArray, weight: FloatArray) -> FloatArray:
    """Sum of A'^k W A^k; what rounding makes of it is for the proof to judge."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return np.asarray(solve_discrete_lyapunov(A.T, weight), dtype=float)


def _claims(
    plant: Plant, law: Controller, problem: PredictiveProblem, ellipsoid: FloatArray | None
) -> tuple[list[Claim], tuple[str, ...]]:
    closed = closed_channel(plant, law)[0]
    radius = float(np.max(np.abs(np.linalg.eigvals(closed))))
    if not radius < 1.0 or plant.dt is None:
        raise ModelError(f"{LAW}: the law to fall back on is not stable, its slowest pole is at |z| = {radius:.9g}")
    claims: list[Claim] = []
    with suppress(ModelError):  # the ellipsoid claim, too, is one of stability
        claims.append(decay_claim([plant], [law]))
    limits = np.minimum(problem.command_upper, -problem.command_lower)
    if not np.any(np.isfinite(limits)):
        return claims, ()
    width = law.A.shape[0]
    rows = np.hstack([law.D @ plant.C2, law.C]) if width else law.D @ plant.C2
    if ellipsoid is None:
        shape = lyapunov_shape(closed, None, rows)
        bounded = np.isfinite(limits)
        ellipsoid = shape / ellipsoid_level(shape, rows[bounded] / limits[bounded, None])
    ellipsoid = ellipsoid * (1.0 + 1e-9)  # strictly inside the limits
    reached = np.sqrt(np.einsum("ij,ji->i", rows, np.linalg.solve(ellipsoid, rows.T)))
    told = tuple(
        float(x) if np.isfinite(x) else float(r * 1.001 + 1e-300) for x, r in zip(limits, reached, strict=True)
    )
    claims.append(EllipsoidClaim((0,), (0,), ellipsoid[None], told))
    return claims, ("inside the proved ellipsoid the law it falls back on never meets a command limit",)


def _statements(
    problem: PredictiveProblem, terminal: TerminalSet | None, observer: Estimator | None, rest: Targets
) -> tuple[str, ...]:
    hard = [limit.name for limit in problem.output_limits if not limit.soft]
    soft = [limit.name for limit in problem.output_limits if limit.soft]
    kept = ["the command limits"] + (["the rate limits"] if np.any(np.isfinite(problem.rate)) else [])
    kept += [f"the limits of {', '.join(hard)}"] if hard else []
    model = "for the nominal model, the state known exactly, a target that stands still and no other disturbance"
    told = []
    if terminal is not None:
        told.append(
            f"recursive feasibility: a plan that keeps {', '.join(kept)} and ends in the terminal set "
            f"({terminal.kind}, {len(terminal.rows)} rows) is followed by another one at the next sample, {model}; "
            "the cost then falls from sample to sample, so the loop is stable"
        )
        told.append("where no such plan exists (a start too far out), the proved law acts and the record says so")
    elif hard or np.any(np.isfinite(problem.rate)):
        told.append(
            f"no terminal set is asked for: {', '.join(kept)} may become impossible to keep even {model}; then the "
            "proved law acts and the record says so"
        )
    else:
        told.append(
            "every plan within the command limits is feasible, always; without a terminal set stability under active "
            "limits is not promised (an unstable plant has states no limited command brings back)"
        )
    if soft:
        told.append(f"soft limits ({', '.join(soft)}) never make a plan infeasible; what is broken is in the record")
    if observer is not None:
        count, measured = len(observer.model.names), len(problem.plant.measured)
        which = ", ".join(rest.tracked) if rest.tracked else "no output (none is tracked)"
        told.append(
            f"no offset of {which} for constant disturbances {', '.join(observer.model.names)}, as long as no limit "
            "is active at rest"
            + (", whatever the plant's true gains" if count == measured else
               f"; with {count} estimated for {measured} measured outputs, only if they enter as modelled")
        )  # fmt: skip
    return tuple(told)
