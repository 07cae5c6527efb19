"""Integration of a vehicle over one span, twice: Gauss collocation of twelve stages, and Runge-Kutta of order eight."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Final

import numpy as np
from numpy.polynomial import legendre
from scipy import linalg
from scipy.integrate import solve_ivp

from maglev_ctrl.analysis.girder.moving import MovingSystem
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.kernels import balance

STAGES: Final = 12
_TURN: Final = 3.0  # fastest frequency times the step
_SHOWN: Final = 12  # values per step, of the collocation polynomial
_MOST_EVALUATIONS: Final = 60_000


@dataclass(frozen=True, eq=False, slots=True)
class PassageMap:
    """[z, 1] at the end of a span from its start: `end` (n + 1, n + 1); `starts`, `steps` (k,) s of the steps.

    `stages` (k, 12, n + 1, n + 1) are the collocation's stages from the start of each step, `maps` (k, n + 1, n + 1)
    its ends; `middles` (k,) s tell the piece.
    """

    end: FloatArray
    starts: FloatArray
    steps: FloatArray
    middles: FloatArray
    stages: FloatArray
    maps: FloatArray

    def run(
        self, system: MovingSystem, state: FloatArray, *, C: FloatArray, D: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Times (k,), outputs (p, k), girder states (g, k) from a state at the start, and the state at the end."""
        n, n_w = len(system.vehicle.closed.states), len(system.vehicle.closed.guideway)
        to_shown, shown = _interpolation()
        joined = np.append(state, 1.0)
        times, values, girders = [], [], []
        last = len(self.starts) - 1
        for k, (start, step) in enumerate(zip(self.starts, self.steps, strict=True)):
            track = np.column_stack([joined, (self.stages[k] @ joined).T])
            along = track @ to_shown.T
            joined = self.maps[k] @ joined
            at = start + step * shown
            if k == last:
                along, at = np.column_stack([along, joined]), np.append(at, start + step)
            for t, z in zip(at, along.T, strict=True):
                W, w, R, r = system.surface(float(t), middle=float(self.middles[k]))
                g = z[n:-1]
                values.append(C @ z[:n] + D[:, :n_w] @ (W @ g + w) + D[:, n_w:] @ (R @ g + r))
            times.append(at)
            girders.append(along[n:-1])
        return np.concatenate(times), np.array(values).T, np.concatenate(girders, axis=1), joined[:-1]


def by_collocation(system: MovingSystem) -> PassageMap:
    """The map of one span by Gauss collocation; steps end where an element crosses a support or a corner."""
    node, weight, a = _gauss()
    size = system.size + 1
    end = np.eye(size)
    starts, steps, middles, stages, maps = [], [], [], [], []
    for low, high in zip(system.breaks[:-1], system.breaks[1:], strict=True):
        middle = 0.5 * float(low + high)
        count = int(np.ceil((high - low) * fastest(system) / _TURN))
        h = float(high - low) / max(count, 1)
        for k in range(max(count, 1)):
            start = float(low) + k * h
            A = np.array([system.joined(start + h * c, middle=middle) for c in node])
            # Z_i = 1 + h sum_j a_ij A_j Z_j
            coupled = np.eye(STAGES * size) - h * np.einsum("ij,jkl->ikjl", a, A).reshape(STAGES * size, -1)
            Z = np.linalg.solve(coupled, np.tile(np.eye(size), (STAGES, 1))).reshape(STAGES, size, size)
            over = np.eye(size) + h * np.einsum("i,ikl,ilm->km", weight, A, Z)
            starts.append(start)
            steps.append(h)
            middles.append(middle)
            stages.append(Z)
            maps.append(over)
            end = over @ end
    return PassageMap(end, np.array(starts), np.array(steps), np.array(middles), np.array(stages), np.array(maps))


def by_runge_kutta(system: MovingSystem) -> FloatArray | None:
    """The same map by an explicit Runge-Kutta method of order eight; None where it would take too long."""
    size = system.size + 1
    if fastest(system) * float(system.breaks[-1]) * 12.0 > _MOST_EVALUATIONS:
        return None
    # Tolerances per entry: every state in units of its own drive.
    end = np.eye(size)
    for low, high in zip(system.breaks[:-1], system.breaks[1:], strict=True):
        middle = 0.5 * float(low + high)
        scale = _scale(system, middle)

        def rate(t: float, flat: FloatArray, middle: float = middle, scale: FloatArray = scale) -> FloatArray:
            A = system.joined(t, middle=middle) * scale / scale[:, None]
            return np.asarray((A @ flat.reshape(size, size)).ravel())

        found = solve_ivp(
            rate, (float(low), float(high)), np.eye(size).ravel(), method="DOP853", rtol=1e-12, atol=1e-13
        )  # fmt: skip
        over = found.y[:, -1].reshape(size, size) * scale[:, None] / scale
        end = over @ end
    return end


def fastest(system: MovingSystem) -> float:
    """Bound on what turns fastest: roots of the loop, girder modes, and the sines met at the speed, rad/s."""
    roots = float(np.max(np.abs(linalg.eigvals(system.rows[0])), initial=0.0))
    girder = system.girder
    return max(roots, float(girder.frequencies[-1])) + 2.0 * pi * girder.modes * system.speed / girder.span


def _scale(system: MovingSystem, time: float) -> FloatArray:
    """Units of the states in which the matrix is balanced."""
    return balance(np.abs(system.joined(time, middle=time)))


def _gauss() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Nodes c (s,), weights b (s,) on 0..1 and the matrix a (s, s) of Gauss collocation."""
    x, weight = legendre.leggauss(STAGES)
    c = 0.5 * (1.0 + x)
    # Lagrange polynomials in Legendre form, integrated from -1 to each node.
    order = np.arange(STAGES)
    to_legendre = (order + 0.5)[:, None] * (legendre.legvander(x, STAGES - 1) * weight[:, None]).T
    integrated = legendre.legint(to_legendre, lbnd=-1, axis=0)
    a = 0.5 * legendre.legval(x, integrated).T
    return c, np.asarray(0.5 * weight), np.asarray(a)


def _interpolation() -> tuple[FloatArray, FloatArray]:
    """The matrix that takes values at 0 and the stages to places shown, and those places on 0..1."""
    c, _, _ = _gauss()
    nodes = np.concatenate([[0.0], c])
    shown = np.linspace(0.0, 1.0, _SHOWN, endpoint=False)
    apart = nodes[:, None] - nodes
    np.fill_diagonal(apart, 1.0)
    matrix = np.empty((_SHOWN, len(nodes)))
    for i, t in enumerate(shown):
        for j in range(len(nodes)):
            others = np.delete(np.arange(len(nodes)), j)
            matrix[i, j] = np.prod((t - nodes[others]) / apart[j, others])
    return matrix, shown
