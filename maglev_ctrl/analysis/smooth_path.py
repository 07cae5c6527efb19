"""A path of periodic systems read from a few of its samples, where building one system costs more than analysing it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.polynomial import chebyshev

from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.errors import ModelError, OutOfDomain
from maglev_ctrl.systems import PeriodicSystem

_NODES = 18
_HALVINGS = 5
_FIT = 1e-10  # largest misfit of an entry beside the nodes, relative to its largest value
_ROUNDING = 1e-14  # and relative to the largest of all entries


@dataclass(frozen=True, eq=False, slots=True)
class _Piece:
    """Chebyshev coefficients (m, entries) of one piece, and the names of the states."""

    coefficients: FloatArray
    like: PeriodicSystem


@dataclass(slots=True, eq=False)
class SmoothPath:
    """`path` between `lower` and `upper` by piecewise Chebyshev series, checked beside the nodes.

    A piece where the model has no answer somewhere, or that the series does not follow to 1e-10, is cut in two; the
    smallest ones are asked exactly.

    Examples
    --------
    >>> A_1 = [[[0.0, 0.0], [-0.1, 0.0]]]
    >>> smooth = SmoothPath(lambda v: PeriodicSystem.from_matrices([[0, 1], [-1 - 0.1 * v**3, 0]], A_1, frequency=v),
    ...                     1.0, 3.0)
    >>> round(float(smooth(2.05).A_0[1, 0]), 12)
    -1.8615125
    """

    path: Callable[[float], PeriodicSystem]
    lower: float
    upper: float
    pieces: dict[tuple[float, float], _Piece | None] = field(default_factory=dict)

    def __call__(self, parameter: float) -> PeriodicSystem:
        """The system at a parameter.

        Raises
        ------
        ModelError, OutOfDomain : as the path
        """
        if not self.lower <= parameter <= self.upper:
            return self.path(parameter)
        lower, upper = self.lower, self.upper
        for _ in range(_HALVINGS + 1):
            if (lower, upper) not in self.pieces:
                self.pieces[lower, upper] = self._fitted(lower, upper)
            piece = self.pieces[lower, upper]
            if piece is not None:
                u = (2.0 * parameter - lower - upper) / (upper - lower)
                terms = chebyshev.chebvander(np.array([u]), len(piece.coefficients) - 1)[0]
                return _unpacked(terms @ piece.coefficients, piece.like)
            middle = _middle(lower, upper)
            lower, upper = (lower, middle) if parameter <= middle else (middle, upper)
        return self.path(parameter)

    def _fitted(self, lower: float, upper: float) -> _Piece | None:
        u = np.cos(np.pi * (np.arange(_NODES) + 0.5) / _NODES)
        beside = np.array([0.07, 0.93, -0.96])
        places = 0.5 * (lower + upper) + 0.5 * (upper - lower) * np.concatenate([u, beside])
        try:
            systems = [self.path(float(v)) for v in places]
        except (ModelError, OutOfDomain):
            return None
        if len({(one.A_0.shape, one.A_cos.shape) for one in systems}) != 1:
            return None
        values = np.array([_packed(one) for one in systems])
        coefficients = np.asarray(chebyshev.chebfit(u, values[:_NODES], _NODES - 1))
        misfit = chebyshev.chebvander(beside, _NODES - 1) @ coefficients - values[_NODES:]
        if np.any(np.abs(misfit) > _FIT * np.max(np.abs(values), axis=0) + _ROUNDING * np.max(np.abs(values))):
            return None
        return _Piece(coefficients, systems[0])


def _middle(lower: float, upper: float) -> float:
    """Where a piece is cut: forces of a speed change with its ratio, and no more than with its difference."""
    return float(np.sqrt(lower * upper)) if lower > 0.0 else 0.5 * (lower + upper)


def _packed(system: PeriodicSystem) -> FloatArray:
    parts = (system.A_0, system.A_cos, system.A_sin, system.frequency)
    return np.concatenate([np.ravel(part) for part in parts])


def _unpacked(values: FloatArray, like: PeriodicSystem) -> PeriodicSystem:
    n, shape = like.A_0.shape[0], like.A_cos.shape
    A_0, A_cos, A_sin, frequency = np.split(values, np.cumsum([n * n, np.prod(shape), np.prod(shape)]))
    return PeriodicSystem(
        read_only_any(A_0.reshape(n, n)), read_only_any(A_cos.reshape(shape)), read_only_any(A_sin.reshape(shape)),
        read_only_any(frequency[0]), like.states,
    )  # fmt: skip
