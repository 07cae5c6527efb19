"""Modes followed through a parameter sweep: lines that keep their identity through crossings and veerings.

Neighbouring points are matched by the biorthogonal assurance criterion |l_i^H r_j||l_j'^H r_i| (1 for the same mode,
0 for another one; independent of units, and right for non-symmetric systems) together with the distance of an
eigenvalue from its first-order prediction s + l^H dA r. All eigenvalues are matched, conjugates too, so that a pair
can split into two real roots and join again; mirror images are hidden afterwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment

from maglev_ctrl.analysis.modes import ModeKind, modes_of_stack, unique_labels
from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only_any
from maglev_ctrl.display import Shown
from maglev_ctrl.systems import SecondOrderSystem

DISTANCE_WEIGHT = 0.7  # of the eigenvalue's distance against the shape's (1 - criterion)
NEAR = 0.02  # of |s|: the distance that counts half
COINCIDENT = 1e-6  # of |s|: closer eigenvalues have no vectors of their own
HALF_PLANE_BIAS = 1e-3  # when two real roots join, the line that came from Im s > 0 goes back there


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class ModeTracks(Shown):
    """Lines of modes over a parameter.

    `parameter` (p,); `s` (p, m) 1/s, NaN where a line is the mirror image of another one (a pair that later splits
    into two real roots is one line before and two lines after); `labels` (m,); `kinds` (p, m), None where s is NaN;
    `confidence` (p, m): assurance criterion with the point before, in [0, 1], 1 at the first point; `index` (p, m):
    which mode of the point it is, -1 where s is NaN.
    """

    _told: ClassVar = ("labels", "parameter", "s")

    parameter: FloatArray
    s: ComplexArray
    labels: tuple[str, ...]
    kinds: tuple[tuple[ModeKind | None, ...], ...]
    confidence: FloatArray
    index: NDArray[np.int64]


class TrackedPoint(Protocol):
    """What lines are drawn through at one point: `Modes`, or the part of them that tracking reads."""

    @property
    def s(self) -> ComplexArray:
        """(m,) 1/s, one per conjugate pair (Im s >= 0) and one per real eigenvalue."""

    @property
    def states(self) -> ComplexArray:
        """(nx, m) right eigenvectors."""

    @property
    def left(self) -> ComplexArray:
        """(nx, m) left eigenvectors, left^H states = 1."""

    @property
    def labels(self) -> tuple[str, ...]:
        """(m,) names."""

    @property
    def kind(self) -> tuple[ModeKind, ...]:
        """(m,) what each mode does."""

    @property
    def state_matrix(self) -> FloatArray:
        """(nx, nx) the modes are of."""


@dataclass(frozen=True, eq=False, slots=True)
class _Full:
    """All eigenvalues of one point, conjugates included; `origin` the index among the modes, `mirror` Im s < 0."""

    s: ComplexArray
    right: ComplexArray
    left: ComplexArray
    origin: NDArray[np.int64]
    mirror: NDArray[np.bool_]
    state_matrix: FloatArray


def track(source: Sequence[TrackedPoint] | SecondOrderSystem, *, parameter: ArrayLike | None = None) -> ModeTracks:
    """Follow the modes of a sweep.

    Parameters
    ----------
    source : modes point by point, or a stack of systems with one batch axis
    parameter : (p,) values of the swept parameter; 0, 1, 2, ... when left out

    Raises
    ------
    ValueError : nothing to follow, points of different size, or a parameter of the wrong length

    Examples
    --------
    >>> K = [np.diag([1.0 + x, 4.0 - x]) for x in np.linspace(0.0, 3.0, 7)]
    >>> stack = SecondOrderSystem.from_matrices(np.eye(2), 0.01 * np.eye(2), K, dofs=("car.heave", "car.pitch"))
    >>> tracks = track(stack)
    >>> tracks.labels, [round(float(w), 2) for w in tracks.s[-1].imag]
    (('car heave', 'car pitch'), [2.0, 1.0])
    """
    given: Sequence[TrackedPoint] = modes_of_stack(source) if isinstance(source, SecondOrderSystem) else source
    points = tuple(given)
    if not points:
        raise ValueError("source: expected at least one point")
    sizes = {point.state_matrix.shape[0] for point in points}
    if len(sizes) > 1:
        raise ValueError(f"source: points have different numbers of states: {sorted(sizes)}")
    values = np.arange(len(points), dtype=np.float64) if parameter is None else np.array(parameter, dtype=np.float64)
    if values.shape != (len(points),):
        raise ValueError(f"parameter: expected {len(points)} values, got shape {values.shape}")
    full = [_expand(point) for point in points]
    order, confidence = _follow(full)
    return _tracks(points, full, order, confidence, values)


def frequency_crossings(tracks: ModeTracks) -> FloatArray:
    """Values of the parameter where the frequencies of two lines meet, by interpolation, in order; (c,).

    Candidates for `boundary.stability_boundaries`: narrow flutter windows open where frequencies meet.

    Examples
    --------
    >>> K = [np.diag([1.0 + x, 4.0 - x]) for x in np.linspace(0.0, 3.0, 8)]
    >>> stack = SecondOrderSystem.from_matrices(np.eye(2), np.zeros((2, 2)), K)
    >>> frequency_crossings(track(stack, parameter=np.linspace(0.0, 3.0, 8))).round(2).tolist()
    [1.5]
    """
    frequency = tracks.s.imag
    found: list[float] = []
    for i in range(frequency.shape[1]):
        for j in range(i + 1, frequency.shape[1]):
            both = (frequency[:, i] > 0.0) & (frequency[:, j] > 0.0)
            difference = np.where(both, frequency[:, i] - frequency[:, j], np.nan)
            before, after = difference[:-1], difference[1:]
            (at,) = np.nonzero(before * after < 0.0)
            part = before[at] / (before[at] - after[at])
            found.extend((tracks.parameter[at] + part * np.diff(tracks.parameter)[at]).tolist())
            found.extend(tracks.parameter[difference == 0.0].tolist())
    return np.unique(np.array(found, dtype=np.float64))


def assurance(left: ComplexArray, right: ComplexArray, other: tuple[ComplexArray, ComplexArray]) -> FloatArray:
    """Biorthogonal assurance criterion between two sets of modes with l^H r = 1, clipped to [0, 1]; (m, m').

    Examples
    --------
    >>> eye = np.eye(2) + 0j
    >>> assurance(eye, eye, (eye, eye)).tolist()
    [[1.0, 0.0], [0.0, 1.0]]
    """
    other_left, other_right = other
    forward = np.abs(left.conj().T @ other_right)
    backward = np.abs(other_left.conj().T @ right).T
    return np.asarray(np.clip(forward * backward, 0.0, 1.0))


def _expand(point: TrackedPoint) -> _Full:
    paired = np.flatnonzero(point.s.imag > 0.0)
    count = len(point.s)
    return _Full(
        s=np.concatenate([point.s, point.s[paired].conj()]),
        right=np.concatenate([point.states, point.states[:, paired].conj()], axis=1),
        left=np.concatenate([point.left, point.left[:, paired].conj()], axis=1),
        origin=np.concatenate([np.arange(count), paired]).astype(np.int64),
        mirror=np.concatenate([np.zeros(count, dtype=bool), np.ones(len(paired), dtype=bool)]),
        state_matrix=point.state_matrix,
    )


def _follow(full: list[_Full]) -> tuple[NDArray[np.int64], FloatArray]:
    """order[p, i]: eigenvalue of point p on line i; confidence[p, i]."""
    n = len(full[0].s)
    order = np.empty((len(full), n), dtype=np.int64)
    confidence = np.ones((len(full), n))
    order[0] = np.arange(n)
    below = full[0].mirror.copy()
    reference_left, reference_right = full[0].left.copy(), full[0].right.copy()
    neighbours, distances = _of_neighbours(full)
    coincident = [_coincident(point) for point in full]
    for p in range(1, len(full)):
        now = full[p]
        placed = order[p - 1]
        if p > 1 and np.any(coincident[p - 1]):
            criterion = assurance(reference_left, reference_right, (now.left, now.right))
        else:
            criterion = neighbours[p - 1][placed]
        cost = 1.0 - criterion + DISTANCE_WEIGHT * distances[p - 1][placed]
        cost = cost + HALF_PLANE_BIAS * (below[:, None] != now.mirror[None, :])
        lines, chosen = linear_sum_assignment(cost)
        order[p, lines] = chosen
        confidence[p, lines] = criterion[lines, chosen]
        below = np.where(now.s[order[p]].imag == 0.0, below, now.mirror[order[p]])
        own = ~coincident[p][order[p]]
        # Vectors of coinciding eigenvalues are arbitrary: such a point is passed by on the older vectors.
        reference_left[:, own] = now.left[:, order[p]][:, own]
        reference_right[:, own] = now.right[:, order[p]][:, own]
    return order, confidence


def _of_neighbours(full: list[_Full]) -> tuple[FloatArray, FloatArray]:
    """Between each point and the next one (p - 1, n, n): the assurance criterion, and the distance of each eigenvalue
    from the prediction of each one before, mapped to [0, 1)."""
    s, left, right = (np.stack([getattr(point, key) for point in full]) for key in ("s", "left", "right"))
    matrices = np.stack([point.state_matrix for point in full])
    dual = np.conj(np.swapaxes(left, 1, 2))
    forward, backward = np.abs(dual[:-1] @ right[1:]), np.abs(dual[1:] @ right[:-1])
    criterion = np.clip(forward * np.swapaxes(backward, 1, 2), 0.0, 1.0)
    change = np.sum(left[:-1].conj() * (np.diff(matrices, axis=0) @ right[:-1]), axis=1)
    # Near a double root first order overshoots without bound; a step beyond |s| itself predicts nothing.
    moduli = np.abs(s[:-1])
    size = np.maximum(moduli, 1e-12 * np.max(moduli, axis=1, initial=0.0)[:, None] + np.finfo(float).tiny)
    predicted = np.where(np.abs(change) <= 0.5 * size, s[:-1] + change, s[:-1])
    gap = np.abs(s[1:, None, :] - predicted[:, :, None])
    return np.asarray(criterion), np.asarray(gap / (gap + NEAR * size[:, :, None]))


def _coincident(point: _Full) -> NDArray[np.bool_]:
    gap = np.abs(point.s[:, None] - point.s[None, :])
    np.fill_diagonal(gap, np.inf)
    return np.asarray(np.min(gap, axis=1, initial=np.inf) <= COINCIDENT * np.abs(point.s))


def _tracks(
    points: tuple[TrackedPoint, ...],
    full: list[_Full],
    order: NDArray[np.int64],
    confidence: FloatArray,
    values: FloatArray,
) -> ModeTracks:
    s = np.stack([point.s[line] for point, line in zip(full, order, strict=True)])
    index = np.stack([point.origin[line] for point, line in zip(full, order, strict=True)])
    mirrored = np.stack([point.mirror[line] for point, line in zip(full, order, strict=True)])
    shown = np.flatnonzero(~np.all(mirrored, axis=0))
    hidden = mirrored[:, shown]
    s, index, confidence = s[:, shown].copy(), index[:, shown].copy(), confidence[:, shown].copy()
    s[hidden] = complex(np.nan, np.nan)
    index[hidden] = -1
    confidence[hidden] = np.nan
    first = [int(np.argmax(~hidden[:, i])) for i in range(len(shown))]
    labels = tuple(_plain(points[p].labels[index[p, i]]) for i, p in enumerate(first))
    kinds = tuple(
        tuple(None if k < 0 else point.kind[k] for k in row) for point, row in zip(points, index, strict=True)
    )
    return ModeTracks(
        read_only_any(values), read_only_any(s), unique_labels(labels), kinds, read_only_any(confidence),
        read_only_any(index),
    )  # fmt: skip


def _plain(label: str) -> str:
    """A label without the number that told doubles apart at one point."""
    head, _, tail = label.rpartition(" (")
    return head if head and tail.endswith(")") and tail[:-1].isdigit() else label
