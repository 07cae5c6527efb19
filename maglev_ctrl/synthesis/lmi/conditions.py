"""Matrix inequalities of state feedback, written once for a shape and filled with numbers through parameters.

One Lyapunov matrix for all vertices: X, Y = K X (Bernussou, Peres & Geromel 1989; Scherer, Gahinet & Chilali 1997).
One for each vertex: X_i and a common slack G, Y = K G (de Oliveira, Bernussou & Geromel 1999; Pipeleers et al. 2009):
with e = -G' multiplier of the closed loop's equation, He([S; -G] [M, eps I]) takes the place of S = A X + B Y, and the
common matrix is the limit eps -> 0 with G = X_i.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from maglev_ctrl.arrays import FloatArray

Lyapunov = Literal["common", "parameter_dependent"]
STRICT = 1e-7
"""Scaled inequalities are asked to hold with this much to spare."""


@dataclass(frozen=True, slots=True)
class Shape:
    """What decides the structure of the problem; problems of one shape differ in numbers only."""

    vertices: int
    states: int
    commands: int
    h2: tuple[int, int] | None = None
    h_infinity: tuple[int, int] | None = None
    decay: bool = False
    region: tuple[tuple[float, ...], ...] | None = None
    corners: int = 0
    box: bool = False
    lyapunov: Lyapunov = "common"
    slack: float = 1.0


@dataclass(slots=True)
class Family:
    """One cvxpy problem with its parameters and variables, built for a shape."""

    problem: Any
    parameters: dict[str, Any]
    variables: dict[str, Any] = field(default_factory=dict)


def build(shape: Shape) -> Family:
    """The problem of a shape: minimise weighted norms, gain measure; every number is a parameter (DPP).

    Examples
    --------
    >>> build(Shape(1, 2, 1, decay=True)).problem.is_dcp(dpp=True)
    True
    """
    return _Builder(shape).family()


class _Builder:
    def __init__(self, shape: Shape) -> None:
        import cvxpy

        self.cp: Any = cvxpy
        self.shape = shape
        self.parameters: dict[str, Any] = {}
        self.constraints: list[Any] = []
        n, m = shape.states, shape.commands
        self.common = shape.lyapunov == "common"
        self.slack = cvxpy.Variable((n, n), symmetric=True) if self.common else cvxpy.Variable((n, n))
        self.Y = cvxpy.Variable((m, n))
        self.sigma, self.floor = cvxpy.Variable(), cvxpy.Variable()
        self.cap = self.number("cap")

    def number(self, name: str) -> Any:
        return self.matrix(name, ())

    def matrix(self, name: str, shape: tuple[int, ...]) -> Any:
        """A parameter, made once; the default keeps it harmless."""
        if name not in self.parameters:
            self.parameters[name] = self.cp.Parameter(shape, value=np.zeros(shape) if shape else 0.0, name=name)
        return self.parameters[name]

    def negative(self, rows: list[list[Any]]) -> None:
        """Lower triangle of blocks given by rows; None is zero."""
        self.constraints.append(self._symmetric(rows) << -STRICT * np.eye(self._size(rows)))

    def positive(self, rows: list[list[Any]]) -> None:
        self.constraints.append(self._symmetric(rows) >> 0)

    @staticmethod
    def _size(rows: list[list[Any]]) -> int:
        return int(sum(row[-1].shape[0] for row in rows))

    def _symmetric(self, rows: list[list[Any]]) -> Any:
        sizes = [row[-1].shape[0] for row in rows]
        full: list[list[Any]] = []
        for i in range(len(rows)):
            line: list[Any] = []
            for j in range(len(rows)):
                block = rows[i][j] if j <= i else rows[j][i]
                if block is None:
                    line.append(np.zeros((sizes[i], sizes[j])))
                else:
                    line.append(block if j <= i else block.T)
            full.append(line)
        joined = self.cp.bmat(full)
        return 0.5 * (joined + joined.T)

    def lyapunov(self) -> Any:
        """X of one inequality at one vertex, kept away from singular and from infinite."""
        X = self.slack if self.common else self.cp.Variable((self.shape.states, self.shape.states), symmetric=True)
        eye = np.eye(self.shape.states)
        if not self.common:
            # The trace bounds every eigenvalue of a positive matrix, for less than an inequality of its own.
            self.constraints += [self.cp.trace(X) <= self.shape.states * self.cap, X >> self.number("least") * eye]
        elif not self.constraints:
            self.constraints += [X << self.cap * eye, X >> self.number("least") * eye]
        return X

    def closed(self, i: int) -> Any:
        n, m = self.shape.states, self.shape.commands
        return self.matrix(f"A{i}", (n, n)) @ self.slack + self.matrix(f"B{i}", (n, m)) @ self.Y

    def output(self, i: int, key: str, rows: int) -> Any:
        n, m = self.shape.states, self.shape.commands
        return self.matrix(f"C{key}{i}", (rows, n)) @ self.slack + self.matrix(f"D{key}{i}", (rows, m)) @ self.Y

    def pole_region(self, i: int, name: str, M: FloatArray) -> None:
        """L (x) X + He(M (x) S) < 0, or its dilation with rows e."""
        X, S, r = self.lyapunov(), self.closed(i), M.shape[0]
        L = self.matrix(name, (r, r))
        bmat, eye = self.cp.bmat, np.eye(r)
        one = bmat([[L[a, b] * X + M[a, b] * S + M[b, a] * S.T for b in range(r)] for a in range(r)])
        if self.common:
            self.negative([[one]])
            return
        eps, G = self.shape.slack, self.slack
        lower = bmat([[M[a, b] * (X - G) + eps * eye[a, b] * S.T for b in range(r)] for a in range(r)])
        corner = bmat([[-eps * eye[a, b] * (G + G.T) for b in range(r)] for a in range(r)])
        self.negative([[one], [lower, corner]])

    def h_infinity(self, i: int, rows: int, columns: int, gamma: Any) -> None:
        X, S, R = self.lyapunov(), self.closed(i), self.output(i, "infinity", rows)
        B = self.matrix(f"Binfinity{i}", (self.shape.states, columns))
        D = self.matrix(f"Dthrough{i}", (rows, columns))
        blocks = [[S + S.T], [R, -gamma * np.eye(rows)], [B.T, D.T, -gamma * np.eye(columns)]]
        if not self.common:
            eps, G = self.shape.slack, self.slack
            blocks.append([eps * S.T + X - G, eps * R.T, None, -eps * (G + G.T)])
        self.negative(blocks)

    def h2(self, i: int, rows: int, columns: int, energy: Any) -> None:
        X, S, R = self.lyapunov(), self.closed(i), self.output(i, "two", rows)
        B = self.matrix(f"Btwo{i}", (self.shape.states, columns))
        blocks = [[S + S.T], [R, -np.eye(rows)]]
        if not self.common:
            eps, G = self.shape.slack, self.slack
            blocks.append([eps * S.T + X - G, eps * R.T, -eps * (G + G.T)])
        self.negative(blocks)
        Z = self.cp.Variable((columns, columns), symmetric=True)
        self.positive([[Z], [B, X]])
        self.constraints.append(self.cp.trace(Z) <= energy)

    def command_limits(self) -> None:
        """x'X^-1 x <= reach at the initial states, and K X K' reach <= limits^2 (Boyd et al. 1994, section 7.2.3)."""
        n, m, X = self.shape.states, self.shape.commands, self.slack
        reach = self.cp.reshape(self.number("reach"), (1, 1), order="F")
        for j in range(m):
            square = self.cp.reshape(self.matrix("limits", (m,))[j], (1, 1), order="F")
            self.positive([[square], [self.Y[j : j + 1, :].T, X]])
        for k in range(self.shape.corners):
            corner = self.matrix(f"corner{k}", (n, 1))
            self.positive([[reach], [corner, X]])
        if self.shape.box:
            # (X^-1) <= diag(d) on the states that may start off zero: sum d a^2 bounds x'X^-1 x over the whole box.
            d = self.cp.Variable(n)
            self.positive([[self.cp.diag(d)], [self.matrix("present", (n, n)), X]])
            self.constraints.append(self.matrix("allowed", (n,)) @ d <= self.number("reach"))

    def family(self) -> Family:
        cp, shape = self.cp, self.shape
        n, m = shape.states, shape.commands
        gamma, energy = cp.Variable(), cp.Variable()
        for i in range(shape.vertices):
            if shape.h_infinity is not None:
                self.h_infinity(i, *shape.h_infinity, gamma)
            if shape.h2 is not None:
                self.h2(i, *shape.h2, energy)
            if shape.region is not None:
                self.pole_region(i, "L", np.array(shape.region))
            if shape.decay or (shape.h2 is None and shape.h_infinity is None and shape.region is None):
                self.pole_region(i, "twice_rate", np.ones((1, 1)))
        if shape.corners or shape.box:
            self.command_limits()
        # K'K <= sigma / floor in the metric given: G'N^-1 G >= floor (G + G') - floor^2 N, the square completed.
        metric, inverse = self.matrix("state_metric", (n, n)), self.matrix("command_metric", (m, m))
        self.positive([[self.slack + self.slack.T - self.floor * metric], [self.Y, self.sigma * inverse]])
        self.constraints += [
            self.sigma <= self.number("gain_square") * self.floor,
            self.floor >= self.number("floor_least"),
            self.floor >= self.number("least"),
            self.floor <= self.cap,
        ]
        total = self.number("weigh_sigma") * self.sigma - self.number("weigh_floor") * self.floor
        for name, value, used in (("gamma", gamma, shape.h_infinity), ("energy", energy, shape.h2)):
            if used is not None:
                total = total + self.number(f"weigh_{name}") * value
                self.constraints.append(value <= self.number(f"{name}_most"))
        total = total + self.number("weigh_trace") * cp.trace(self.slack)
        problem = cp.Problem(cp.Minimize(total), self.constraints)
        variables = {
            "slack": self.slack, "Y": self.Y, "sigma": self.sigma, "floor": self.floor, "gamma": gamma,
            "energy": energy,
        }  # fmt: skip
        return Family(problem, self.parameters, variables)
