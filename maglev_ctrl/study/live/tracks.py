"""Lines of modes over speed from state matrices alone, named and told apart as modes are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.analysis.modes import ModeKind, Modes, mode_labels, participation_factors
from maglev_ctrl.analysis.tracking import ModeTracks, track
from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.study.live.designed import FAULTS
from maglev_ctrl.systems import SecondOrderSystem

_NEUTRAL = 1e-8  # of the largest eigenvalue: growth below is rounding
_FLUTTER = (ModeKind.SINGLE_MODE_FLUTTER, ModeKind.COUPLED_MODE_FLUTTER)


@dataclass(frozen=True, eq=False, slots=True)
class _Point:
    """What tracking reads of one speed."""

    s: ComplexArray
    states: ComplexArray
    left: ComplexArray
    kind: tuple[ModeKind, ...]
    state_matrix: FloatArray
    template: SecondOrderSystem
    named: list[tuple[str, ...]] = field(default_factory=list)

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the modes; asked for at few speeds, because a line is named once."""
        if not self.named:
            self.named.append(mode_labels(self.template, participation_factors(self.states, self.left)))
        return self.named[0]


def live_tracks(
    matrices: FloatArray, speeds: FloatArray, template: SecondOrderSystem, exact: Callable[[float], Modes]
) -> ModeTracks | None:
    """The modes of state matrices (V, n, n) at speeds (V,) as lines; None where there is no speed.

    Parameters
    ----------
    template : a system with the names of these states
    exact : all about the modes at a speed; asked where a line flutters, for the kind of its flutter

    Examples
    --------
    >>> from maglev_ctrl.analysis.modes import modes
    >>> K = [np.diag([1.0 + x, 4.0 - x]) for x in np.linspace(0.0, 3.0, 7)]
    >>> systems = [SecondOrderSystem.from_matrices(np.eye(2), 0.01 * np.eye(2), k, dofs=("heave", "pitch")) for k in K]
    >>> found = live_tracks(np.stack([one.state_matrix() for one in systems]), np.arange(7.0), systems[0], modes)
    >>> found.labels, [round(float(w), 2) for w in found.s[-1].imag]
    (('heave', 'pitch'), [2.0, 1.0])
    """
    if not len(matrices):
        return None
    values, right = np.linalg.eig(matrices)
    values, right = values.astype(np.complex128), right.astype(np.complex128)
    left = _left(right)
    points = []
    for s, states, dual, A in zip(values, right, left, matrices, strict=True):
        k = _chosen(s)
        points.append(_Point(s[k], states[:, k], dual[:, k], _kinds(s[k]), A, template))
    tracks = track(points, parameter=speeds)
    return replace(tracks, kinds=_with_flutter(tracks, exact))


def _left(right: ComplexArray) -> ComplexArray:
    """Left eigenvectors (V, n, n) with left^H right = 1; where there is no full set, those of least norm."""
    try:
        inverse = np.linalg.inv(right)
    except np.linalg.LinAlgError:
        inverse = np.linalg.pinv(right)
    return np.asarray(np.conj(np.swapaxes(inverse, -1, -2)))


def _chosen(s: ComplexArray) -> NDArray[np.intp]:
    """One of each pair, by rising frequency."""
    keep = np.flatnonzero(s.imag >= 0.0)
    return np.asarray(keep[np.lexsort((s.real[keep], s.imag[keep]))])


def _kinds(s: ComplexArray) -> tuple[ModeKind, ...]:
    """What each mode does; all flutter counts as damping-controlled at first."""
    small = _NEUTRAL * float(np.max(np.abs(s), initial=0.0))
    return tuple(
        ModeKind.NEUTRAL if abs(one.real) <= small
        else ModeKind.STABLE if one.real < 0.0
        else ModeKind.DIVERGENCE if one.imag <= small
        else ModeKind.SINGLE_MODE_FLUTTER
        for one in s
    )  # fmt: skip


def _with_flutter(tracks: ModeTracks, exact: Callable[[float], Modes]) -> tuple[tuple[ModeKind | None, ...], ...]:
    """The kinds with those of flutter looked at in full, once on every stretch of a line that flutters."""
    kinds = [list(row) for row in tracks.kinds]
    flutters = np.array([[kind in _FLUTTER for kind in row] for row in kinds])
    open_ = flutters.copy()
    while np.any(open_):
        p = int(np.argmax(np.sum(open_, axis=1)))
        try:
            found: Modes | None = exact(float(tracks.parameter[p]))
        except FAULTS:
            found = None
        for i in np.flatnonzero(open_[p]):
            run = _run(flutters[:, i], p)
            if found is not None:
                kind = found.kind[int(np.argmin(np.abs(found.s - tracks.s[p, i])))]
                for k in range(*run):
                    kinds[k][i] = kind if kind in _FLUTTER else kinds[k][i]
            open_[slice(*run), i] = False
    return tuple(tuple(row) for row in kinds)


def _run(marked: NDArray[np.bool_], p: int) -> tuple[int, int]:
    """The stretch of neighbours around p that are all marked."""
    first, last = p, p + 1
    while first > 0 and marked[first - 1]:
        first -= 1
    while last < len(marked) and marked[last]:
        last += 1
    return first, last
