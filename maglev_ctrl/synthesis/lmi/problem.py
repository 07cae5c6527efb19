"""One synthesis problem in scaled coordinates: the numbers for the solver and the way back to physical units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import Status
from maglev_ctrl.synthesis.lmi.conditions import Lyapunov, Shape
from maglev_ctrl.synthesis.lmi.request import MultiObjective, channel_indices
from maglev_ctrl.synthesis.lmi.scaling import ScaledVertex, Scaling, find_scaling, scale_vertex
from maglev_ctrl.synthesis.lmi.session import Answer, Clock, LmiSession, Solver
from maglev_ctrl.systems.plant import Plant

LOOSE = 1e6
"""Bound on a scaled norm that is not asked for."""
CAPS = ((1e5, 1e6), (1e4, 1e4), (1e8, 1e12))
"""Cap on the scaled Lyapunov matrix (and on its inverse) and on the square of the scaled gain: usual, tight, wide."""
USUAL, TIGHT, WIDE = range(3)
TRACE = 1e-7
"""Price of the trace of the Lyapunov matrix, which keeps directions that no norm sees from growing to the cap."""


@dataclass(frozen=True, eq=False, slots=True)
class Problem:
    """Vertices, request, and how they are solved."""

    plants: tuple[Plant, ...]
    request: MultiObjective
    scaling: Scaling
    vertices: tuple[ScaledVertex, ...]
    session: LmiSession
    clock: Clock
    solver: Solver = "CLARABEL"
    lyapunov: Lyapunov = "common"
    slack: float = 1.0

    @property
    def homogeneous(self) -> bool:
        """A multiple of a solution is a solution: nothing sets the size of the Lyapunov matrix."""
        request = self.request
        return not (request.has_h2 or request.has_h_infinity or request.commands is not None)

    @property
    def shape(self) -> Shape:
        """Structure of the problem."""
        request, first = self.request, self.plants[0]
        sizes: dict[str, Any] = {}
        for key, used in (("h2", request.has_h2), ("h_infinity", request.has_h_infinity)):
            if used:
                columns, rows = channel_indices(first, getattr(request, f"{key}_channel"), key)
                sizes[key] = (len(rows), len(columns))
        commands = request.commands
        corners = 0 if commands is None or commands.initial_states is None else len(commands.initial_states)
        region = request.region
        return Shape(
            len(self.plants), len(first.states), len(first.commands), **sizes,
            decay=request.decay_rate is not None or request.objective == "decay",
            region=None if region is None else tuple(tuple(float(x) for x in row) for row in region.M),
            corners=corners, box=commands is not None and commands.allowed is not None, lyapunov=self.lyapunov,
            slack=self.slack if self.lyapunov != "common" else 1.0,
        )  # fmt: skip

    def numbers(self, attempt: int) -> dict[str, Any]:
        """Parameters common to every solve; `attempt` counts in CAPS."""
        request, scaling = self.request, self.scaling
        n, m = len(scaling.states), len(scaling.commands)
        cap, gain_square = CAPS[attempt]
        found: dict[str, Any] = {
            "cap": cap, "least": 1.0 / cap, "state_metric": np.eye(n), "command_metric": np.eye(m),
            "gain_square": gain_square, "gamma_most": LOOSE, "energy_most": LOOSE, "reach": 1.0,
        }  # fmt: skip
        found["floor_least" if self.homogeneous else "weigh_trace"] = 1.0 if self.homogeneous else TRACE
        for i, vertex in enumerate(self.vertices):
            found |= {f"A{i}": vertex.A, f"B{i}": vertex.B}
            found |= {f"{k}two{i}": x for k, x in zip("BCD", vertex.h2, strict=True)}
            found |= {f"{k}infinity{i}": x for k, x in zip("BCD", vertex.h_infinity[:3], strict=True)}
            found[f"Dthrough{i}"] = vertex.h_infinity[3]
        if request.gain_below is not None or request.objective == "gain":
            # K = S K_scaled / T: the physical norm of K, with both metrics brought to order one.
            found |= {"state_metric": np.diag(self._metric[0]), "command_metric": np.diag(self._metric[1])}
        if request.gain_below is not None:
            found["gain_square"] = (request.gain_below * (1.0 - 1e-6)) ** 2 / self.gain_unit**2
        if request.decay_rate is not None:
            found["twice_rate"] = 2.0 * request.decay_rate / scaling.rate
        if request.region is not None:
            found["L"] = request.region.L / scaling.rate
        if request.h_infinity_below is not None:
            found["gamma_most"] = request.h_infinity_below / scaling.h_infinity
        if request.h2_below is not None:
            found["energy_most"] = (request.h2_below / scaling.h2) ** 2
        return found | self._commands()

    @property
    def _metric(self) -> tuple[FloatArray, FloatArray]:
        states, commands = 1.0 / self.scaling.states**2, 1.0 / self.scaling.commands**2
        return states / np.max(states), commands / np.max(commands)

    @property
    def gain_unit(self) -> float:
        """Physical gain for sigma = floor in the metrics of the gain bound."""
        return float(np.min(self.scaling.commands) / np.min(self.scaling.states))

    def _commands(self) -> dict[str, Any]:
        commands, scaling = self.request.commands, self.scaling
        if commands is None:
            return {}
        found: dict[str, Any] = {"limits": (np.array(commands.limits) / scaling.commands) ** 2}
        if commands.initial_states is not None:
            for k, state in enumerate(np.asarray(commands.initial_states, dtype=float)):
                found[f"corner{k}"] = (state / scaling.states)[:, None]
        if commands.allowed is not None:
            allowed = np.asarray(commands.allowed, dtype=float) / scaling.states
            found |= {"allowed": allowed**2, "present": np.diag((allowed > 0.0).astype(float))}
        return found

    def solve(self, attempt: int, **changes: Any) -> Answer:
        """One solve with the numbers of an attempt, some of them changed."""
        return self.session.solve(
            self.shape, self.numbers(attempt) | changes, clock=self.clock, solver=self.solver
        )  # fmt: skip

    def gain(self, values: Mapping[str, FloatArray]) -> FloatArray:
        """K in physical units, u = K x."""
        scaled = np.linalg.solve(values["slack"].T, values["Y"].T).T
        return np.asarray(self.scaling.commands[:, None] * scaled / self.scaling.states, dtype=np.float64)

    def with_request(self, request: MultiObjective) -> Problem:
        """The same vertices and scales, asked something else."""
        return replace(self, request=request)


def pose(
    plants: tuple[Plant, ...],
    request: MultiObjective,
    *,
    session: LmiSession,
    clock: Clock,
    solver: Solver = "CLARABEL",
    lyapunov: Lyapunov = "common",
) -> Problem:
    """The problem of a request, scaled.

    Examples
    --------
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]])
    >>> pose((plant,), MultiObjective(), session=LmiSession(), clock=Clock(9.0)).homogeneous
    True
    """
    scaling = find_scaling(plants, request)
    vertices = tuple(scale_vertex(plant, request, scaling) for plant in plants)
    return Problem(plants, request, scaling, vertices, session, clock, solver, lyapunov)


@dataclass(frozen=True, eq=False, slots=True)
class Optimum:
    """The best point found: scaled values, the objective in physical units, and the decay rate they were found for."""

    status: Status
    values: Mapping[str, FloatArray]
    objective: float = np.nan
    rate: float = 0.0
    solves: int = 0
    certain: bool = True
