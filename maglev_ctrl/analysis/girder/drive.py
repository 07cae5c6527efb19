"""Linear systems driven by polynomials in pieces: exact states by exponentials, no step size.

On a piece of length h the drive is f(t) = sum over j of f_j (t/h)^j. The powers are states of their own,
d/dt (t/h)^j = (j/h) (t/h)^(j-1), so one exponential of the joined matrix carries the state over any part of the piece.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.polynomial import legendre, polynomial
from scipy import linalg

from maglev_ctrl.analysis.girder.shapes import PieceShape
from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.kernels import balance, rescale


@dataclass(frozen=True, eq=False, slots=True)
class DrivenSystem:
    """x' = A x + E_w w + E_v w', y = C x + D_w w + D_v w', each w_i a shape met at the place v t + x_i.

    `A` (n, n), `E_w`, `E_v` (n, m), `C` (p, n), `D_w`, `D_v` (p, m); `shapes` (m), `places` (m,) m; `speed` m/s.
    """

    A: FloatArray
    E_w: FloatArray
    E_v: FloatArray
    C: FloatArray
    D_w: FloatArray
    D_v: FloatArray
    shapes: tuple[PieceShape, ...]
    places: FloatArray
    speed: float

    def met(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """w and w' (m, k) at times (k,) s, the rate without what is infinite at a step."""
        where = self.speed * times + self.places[:, None]
        w = np.array([one.at(s) for one, s in zip(self.shapes, where, strict=True)])
        rate = self.speed * np.array([one.slope(s) for one, s in zip(self.shapes, where, strict=True)])
        return w.reshape(len(self.shapes), -1), rate.reshape(len(self.shapes), -1)

    def steps_at(self, time: float, *, within: float) -> FloatArray:
        """Steps (m,) m that the elements meet at a time, give or take `within` (s)."""
        found = np.zeros(len(self.shapes))
        for i, (one, x) in enumerate(zip(self.shapes, self.places, strict=True)):
            away = self.speed * time + x - one.jump_positions
            if one.periodic:
                away = away - one.span * np.round(away / one.span)
            found[i] = float(one.jumps @ (np.abs(away) <= within * self.speed))
        return found

    def piece(self, start: float, end: float) -> DrivenPiece:
        """The joined matrix of a time in which no element meets a break."""
        low = self.speed * start + self.places
        parts = [one.on(a, a + self.speed * (end - start)) for one, a in zip(self.shapes, low, strict=True)]
        size = max((len(part) for part in parts), default=1)
        h = end - start
        powers = np.zeros((size, len(parts)))
        for i, part in enumerate(parts):
            powers[:, i] = _powers_from_start(part, size)
        # d/dt of (t/h)^j is (j/h) (t/h)^(j-1).
        rates = np.zeros_like(powers)
        rates[:-1] = np.arange(1, size)[:, None] * powers[1:] / h
        n = len(self.A)
        joined = np.zeros((n + size, n + size))
        joined[:n, :n] = self.A
        joined[:n, n:] = (powers @ self.E_w.T + rates @ self.E_v.T).T
        joined[n + np.arange(1, size), n + np.arange(size - 1)] = np.arange(1, size) / h
        through = (powers @ self.D_w.T + rates @ self.D_v.T).T
        return DrivenPiece(start, end, joined, np.hstack([self.C, through]))


@dataclass(frozen=True, eq=False, slots=True)
class DrivenPiece:
    """One piece: `joined` over [x, powers of (t - start)/(end - start)], `output` (p, n + powers)."""

    start: float
    end: float
    joined: FloatArray
    output: FloatArray

    def lifted(self, state: FloatArray) -> FloatArray:
        """State and powers at the start of the piece."""
        powers = np.zeros(len(self.joined) - len(state))
        powers[0] = 1.0
        return np.concatenate([state, powers])

    def after(self, state: FloatArray, time: float) -> FloatArray:
        """State and powers at a time within the piece, from the state at its start."""
        return np.asarray(balanced_exponential(self.joined * (time - self.start)) @ self.lifted(state))

    def sampled(self, state: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
        """Outputs (p, count) at evenly spaced times from the start to the end, and the state at the end."""
        step = balanced_exponential(self.joined * ((self.end - self.start) / (count - 1)))
        track = np.empty((len(self.joined), count))
        track[:, 0] = self.lifted(state)
        for k in range(1, count):
            track[:, k] = step @ track[:, k - 1]
        return np.asarray(self.output @ track), track[: len(state), -1].copy()


@dataclass(frozen=True, eq=False, slots=True)
class PeriodicSolution:
    """The steady response by exponentials over one period: pieces and the state (n,) at the start of each."""

    pieces: tuple[DrivenPiece, ...]
    states: FloatArray

    def outputs_at(self, times: FloatArray) -> FloatArray:
        """Outputs (p, k) at times (k,) of the period, s; at a break those after it."""
        starts = np.array([piece.start for piece in self.pieces])
        place = np.clip(np.searchsorted(starts, times, side="right") - 1, 0, len(starts) - 1)
        found = [
            self.pieces[i].output @ self.pieces[i].after(self.states[i], t) for i, t in zip(place, times, strict=True)
        ]
        return np.array(found).T

    def sampled(self, per_piece: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Times (k,), outputs (p, k) and Simpson weights (k,) that add to one; both sides of every break are in."""
        count = per_piece + 1 - per_piece % 2
        simpson = np.ones(count)
        simpson[1:-1:2], simpson[2:-1:2] = 4.0, 2.0
        times, outputs, weights = [], [], []
        for piece, state in zip(self.pieces, self.states, strict=True):
            found, _ = piece.sampled(state, count)
            times.append(np.linspace(piece.start, piece.end, count))
            outputs.append(found)
            weights.append(simpson * (piece.end - piece.start) / (3.0 * (count - 1)))
        weight = np.concatenate(weights)
        return np.concatenate(times), np.concatenate(outputs, axis=1), weight / np.sum(weight)


def periodic_solution(system: DrivenSystem, times: FloatArray) -> PeriodicSolution:
    """The state that repeats itself after one period, by a boundary-value solve: (I - Phi) x(0) = what the drive adds.

    Parameters
    ----------
    times : (k + 1,) s, breaks of the drive from zero to the period

    Raises
    ------
    numpy.linalg.LinAlgError : a multiplier of one, so that no steady response exists
    """
    n, period = len(system.A), float(times[-1])
    pieces = tuple(system.piece(a, b) for a, b in pairwise(times.tolist()))
    total, added = np.eye(n), np.zeros(n)
    maps = []
    for piece in pieces:
        entering = system.E_v @ system.steps_at(piece.start, within=1e-9 * period)
        X = balanced_exponential(piece.joined * (piece.end - piece.start))
        push = X[:n, n]
        maps.append((X[:n, :n], push, entering))
        total, added = X[:n, :n] @ total, X[:n, :n] @ (added + entering) + push
    state = np.linalg.solve(np.eye(n) - total, added)
    states = []
    for X, push, entering in maps:
        state = state + entering
        states.append(state)
        state = X @ state + push
    return PeriodicSolution(pieces, read_only_any(np.array(states)))


def balanced_exponential(matrix: FloatArray) -> FloatArray:
    """exp of a matrix whose states have units of very different size: the error is small in each unit."""
    scale = balance(np.abs(matrix))
    return np.asarray(linalg.expm(rescale(matrix, scale)) * scale[:, None] / scale)


def _powers_from_start(part: FloatArray, size: int) -> FloatArray:
    """Coefficients of u^j, u = 0..1 over the part, of a Legendre series over -1..1."""
    total = np.zeros(size)
    for j, a in enumerate(legendre.leg2poly(part)):
        term = polynomial.polypow([-1.0, 2.0], j)
        total[: len(term)] += a * term
    return total
