"""One synthesis problem in scaled coordinates: the numbers for the solver and the way back to physical units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import Status
from maglev_ctrl.synthesis.lmi.conditions import Lyapunov, Shape
from maglev_ctrl.synthesis.lmi.coordinates import Norm, compressed, distinct, in_basis, regulator_basis
from maglev_ctrl.synthesis.lmi.request import MultiObjective
from maglev_ctrl.synthesis.lmi.scaling import ScaledVertex, Scaling, find_scaling, scale_vertex
from maglev_ctrl.synthesis.lmi.session import Answer, Clock, LmiSession, Solver
from maglev_ctrl.systems.plant import Plant

LOOSE = 1e6
"""Bound on a scaled norm that is not asked for."""
CAPS = ((1e5, 1e6), (1e4, 1e4), (1e8, 1e12))
"""Cap on the scaled Lyapunov matrix (and on its inverse) and on the square of the scaled gain: usual, tight, wide."""
USUAL, TIGHT, WIDE = range(3)
NOTHING: Mapping[str, Any] = MappingProxyType({})
PRICED = 1e-5
"""Share of each command in the scaled energy above which it counts as priced."""
TRACE = 1e-7
"""Price of the trace of the Lyapunov matrix, which keeps directions that no norm sees from growing to the cap."""


@dataclass(frozen=True, eq=False, slots=True)
class Problem:
    """Vertices, request, and how they are solved; x = scaling.states * (basis @ x of the vertices)."""

    plants: tuple[Plant, ...]
    request: MultiObjective
    scaling: Scaling
    basis: FloatArray
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
                B, C = getattr(self.vertices[0], key)[:2]
                sizes[key] = (C.shape[0], B.shape[1])
        commands = request.commands
        corners = 0 if commands is None or commands.initial_states is None else len(commands.initial_states)
        region = request.region
        return Shape(
            len(distinct(self.vertices)), len(first.states), len(first.commands), **sizes,
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
        for i, vertex in enumerate(self.vertices[j] for j in distinct(self.vertices)):
            found |= {f"A{i}": vertex.A, f"B{i}": vertex.B}
            found |= {f"{k}two{i}": x for k, x in zip("BCD", vertex.h2, strict=True)}
            found |= {f"{k}infinity{i}": x for k, x in zip("BCD", vertex.h_infinity[:3], strict=True)}
            found[f"Dthrough{i}"] = vertex.h_infinity[3]
        if request.gain_below is not None or request.objective == "gain":
            # K = S K_scaled / T: the physical norm of K, with both metrics brought to order one.
            found |= {"state_metric": self._metric[0], "command_metric": self._metric[1]}
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
        back = np.linalg.inv(self.transformation)
        states, commands = back @ back.T, 1.0 / self.scaling.commands**2
        return states / self._state_unit, np.diag(commands / np.max(commands))

    @property
    def _state_unit(self) -> float:
        return float(np.linalg.norm(np.linalg.inv(self.transformation), 2)) ** 2

    @property
    def transformation(self) -> FloatArray:
        """T (n, n): x = T @ x of the vertices, in physical units."""
        return np.asarray(self.scaling.states[:, None] * self.basis, dtype=np.float64)

    @property
    def gain_unit(self) -> float:
        """Physical gain for sigma = floor in the metrics of the gain bound."""
        return float(np.min(self.scaling.commands)) * float(np.sqrt(self._state_unit))

    def _commands(self) -> dict[str, Any]:
        commands, scaling = self.request.commands, self.scaling
        if commands is None:
            return {}
        found: dict[str, Any] = {"limits": (np.array(commands.limits) / scaling.commands) ** 2}
        if commands.initial_states is not None:
            for k, state in enumerate(np.asarray(commands.initial_states, dtype=float)):
                found[f"corner{k}"] = np.linalg.solve(self.transformation, state)[:, None]
        if commands.allowed is not None:
            allowed = np.asarray(commands.allowed, dtype=float) / scaling.states
            # Rows of T^-1 that an initial state can reach, transposed: (T^-1)' X^-1 T^-1 is P of the scaled states.
            present = np.diag((allowed > 0.0).astype(float))
            found |= {"allowed": allowed**2, "present": np.linalg.solve(self.basis, present)}
        return found

    def solve(self, attempt: int, changes: Mapping[str, Any] = NOTHING) -> Answer:
        """One solve with the numbers of an attempt, some of them changed."""
        return self.session.solve(
            self.shape, self.numbers(attempt) | dict(changes), clock=self.clock, solver=self.solver
        )  # fmt: skip

    def gain(self, values: Mapping[str, FloatArray]) -> FloatArray:
        """K in physical units, u = K x."""
        scaled = np.linalg.solve(values["slack"].T, values["Y"].T).T
        law = np.linalg.solve(self.basis.T, scaled.T).T
        return np.asarray(self.scaling.commands[:, None] * law / self.scaling.states, dtype=np.float64)

    def scaled(self, gain: FloatArray) -> FloatArray:
        """K of the vertices' coordinates, from physical units."""
        return np.asarray(gain @ self.transformation / self.scaling.commands[:, None], dtype=np.float64)

    @property
    def regular(self) -> bool:
        """The H2 norm is made small, every command is priced, and no other wish has the law on its edge.

        The best law is then one of ordinary gain, and no second problem has to look for it.
        """
        request = self.request
        if request.objective != "h2" or request.has_h_infinity or request.region is not None:
            return False
        if request.gain_below is not None or request.commands is not None or request.h2_below is not None:
            return False
        return all(float(np.linalg.eigvalsh(D.T @ D)[0]) > PRICED for _, _, D in (one.h2 for one in self.vertices))

    @property
    def plain(self) -> bool:
        """The coordinates are those of the scaling alone."""
        return bool(np.array_equal(self.basis, np.eye(len(self.basis))))

    def in_plain_coordinates(self) -> Problem:
        """The same problem in the coordinates of the scaling alone."""
        other = pose(
            self.plants, self.request, session=self.session, clock=self.clock, solver=self.solver,
            lyapunov=self.lyapunov, plain=True,
        )  # fmt: skip
        return replace(other, slack=self.slack)

    def around(self, rate: float) -> Problem:
        """The same problem in the coordinates of a regulator that decays at `rate` (1/s) or faster."""
        other = pose(
            self.plants, self.request, session=self.session, clock=self.clock, solver=self.solver,
            lyapunov=self.lyapunov, rate=rate,
        )  # fmt: skip
        return replace(other, slack=self.slack)

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
    plain: bool = False,
    rate: float | None = None,
) -> Problem:
    """The problem of a request, scaled; `plain` without the basis of the regulator.

    rate : 1/s, of the loop whose certificate is the identity; the one asked for where none is given

    Examples
    --------
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]])
    >>> pose((plant,), MultiObjective(), session=LmiSession(), clock=Clock(9.0)).homogeneous
    True
    """
    scaling = find_scaling(plants, request)
    scaled = [scale_vertex(plant, request, scaling) for plant in plants]
    wanted: tuple[tuple[Norm, bool], ...] = (("h2", request.has_h2), ("h_infinity", request.has_h_infinity))
    norms = [key for key, used in wanted if used]
    wanted_rate = request.decay_rate if rate is None else rate
    basis = np.eye(len(scaling.states))
    if not plain and (norms or rate is not None):
        gamma = None if request.h_infinity_below is None else request.h_infinity_below / scaling.h_infinity
        basis = regulator_basis(scaled, norms, shift=(wanted_rate or 0.0) / scaling.rate, gamma=gamma)
    vertices = compressed([in_basis(one, basis) for one in scaled])
    return Problem(plants, request, scaling, basis, vertices, session, clock, solver, lyapunov)


@dataclass(frozen=True, eq=False, slots=True)
class Optimum:
    """The best point found: scaled values, the objective in physical units, and the decay rate they were found for.

    `problem` is the one whose coordinates the values are in, where it is not the one that was asked.
    """

    status: Status
    values: Mapping[str, FloatArray]
    objective: float = np.nan
    rate: float = 0.0
    solves: int = 0
    certain: bool = True
    problem: Problem | None = None
    ended: str = ""
    """Why a search for the largest decay rate went no further, where that is no proof that there is nothing more."""
