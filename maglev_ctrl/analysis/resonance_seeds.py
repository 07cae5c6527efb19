"""Tongues between the columns of a map: exact resonances located on the parameter axis, then computed there.

A lightly damped combination tongue can be narrower than the grid step. Its centre is known: where (w_i +- w_j)/k
equals the passing frequency. Matrices between two columns are interpolated linearly; the centre is corrected for the
second-order shift of the modes, and the depth where the tongue begins is computed by Floquet analysis at that point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maglev_ctrl.analysis.critical_depth import critical_of
from maglev_ctrl.analysis.depth_surrogate import depth_surrogate
from maglev_ctrl.analysis.floquet import scaled_coefficients
from maglev_ctrl.analysis.resonance import (
    ResonanceKind,
    StateModes,
    make_resonance,
    modal_harmonics,
    pair_indices,
    resonant_pairs,
    state_modes,
)
from maglev_ctrl.arrays import ComplexArray, FloatArray

_MARGIN = 1.5  # tongues predicted to begin deeper than this times the range are left out


@dataclass(frozen=True, slots=True)
class SeededTongue:
    """One tongue sought between grid columns.

    `parameter` where it is centred, `threshold` the depth where it begins (inf: not within the range), its `name`, and
    whether some pixel of the grid beside it already shows it.
    """

    parameter: float
    threshold: float
    name: str
    resolved_by_grid: bool


@dataclass(frozen=True, eq=False, slots=True)
class PairCoupling:
    """Effective coupling of two resonant modes: first and second order in depth, and the second-order shifts."""

    s: tuple[complex, complex]
    direct: tuple[complex, complex]
    indirect: tuple[complex, complex]
    shift: tuple[complex, complex]

    def critical(self, depth_max: float) -> float:
        """Predicted depth where the pair turns unstable at the best detuning; inf beyond `depth_max`."""
        depth = depth_max * np.linspace(0.0, 1.0, 401)[1:]
        a = -(self.s[0].real + depth**2 * self.shift[0].real)
        b = -(self.s[1].real + depth**2 * self.shift[1].real)
        g = (depth * self.direct[0] + depth**2 * self.indirect[0]) * (
            depth * self.direct[1] + depth**2 * self.indirect[1]
        )
        unstable = (a < 0.0) | (b < 0.0) | (2.0 * a * b <= np.abs(g) + g.real)
        first = np.nonzero(unstable)[0]
        return float(depth[first[0]]) if len(first) else float("inf")

    def detuning(self, depth: float) -> float:
        """Second-order shift of the resonant sum or difference of frequencies at a depth, rad/s."""
        return float(depth**2 * (self.shift[0] - self.shift[1]).imag)


def pair_coupling(
    modes: StateModes, couplings: dict[int, ComplexArray], *, first: int, second: int, order: int, frequency: float
) -> PairCoupling:
    """Second-order (quasi-degenerate) perturbation theory for one resonant pair, s_first ~ s_second + i order W.

    Parameters
    ----------
    modes, couplings : see `state_modes`, `modal_harmonics`
    first, second : indices of the two eigenvalues
    order : harmonic distance k
    frequency : W at resonance, rad/s

    Examples
    --------
    >>> A_0, A_1 = np.array([[0.0, 1.0], [-1.0, -0.02]]), np.array([[[0.0, 0.0], [-1.0, 0.0]]])
    >>> modes = state_modes(A_0)
    >>> i = modes.oscillating[0]
    >>> pair = pair_coupling(modes, modal_harmonics(modes, A_1, 0 * A_1), first=i, second=modes.conjugate[i], order=1,
    ...                      frequency=2.0)
    >>> round(pair.critical(0.2), 3)
    0.04
    """
    zero = np.zeros_like(next(iter(couplings.values())))
    pair = ((first, 0), (second, order))
    middle_i = modes.s[first]
    middle_j = modes.s[second] + 1j * order * frequency
    shift_i = shift_j = indirect_ij = indirect_ji = 0.0 + 0.0j
    for level in range(-max(couplings) + min(0, order), max(couplings) + max(0, order) + 1):
        energies = modes.s + 1j * level * frequency
        allowed = np.array([(m, level) not in pair for m in range(len(modes.s))])
        to_i, from_i = couplings.get(level, zero)[first, :], couplings.get(-level, zero)[:, first]
        to_j = couplings.get(level - order, zero)[second, :]
        from_j = couplings.get(order - level, zero)[:, second]
        inverse_i = np.where(allowed, 1.0 / np.where(allowed, middle_i - energies, 1.0), 0.0)
        inverse_j = np.where(allowed, 1.0 / np.where(allowed, middle_j - energies, 1.0), 0.0)
        mean = 0.5 * (inverse_i + inverse_j)
        shift_i += complex(np.sum(to_i * from_i * inverse_i))
        shift_j += complex(np.sum(to_j * from_j * inverse_j))
        indirect_ij += complex(np.sum(to_i * from_j * mean))
        indirect_ji += complex(np.sum(to_j * from_i * mean))
    direct = (
        complex(couplings.get(order, zero)[first, second]),
        complex(couplings.get(-order, zero)[second, first]),
    )
    return PairCoupling(
        (complex(middle_i), complex(modes.s[second])), direct, (indirect_ij, indirect_ji), (shift_i, shift_j)
    )


@dataclass(frozen=True, slots=True)
class SeedInput:
    """The map's arrays, for interpolation between columns."""

    A_0: FloatArray
    A_cos: FloatArray
    A_sin: FloatArray
    frequency: FloatArray
    parameter: FloatArray
    depth_max: float

    def at(self, column: int, fraction: float) -> tuple[FloatArray, FloatArray, FloatArray, float]:
        """Matrices and frequency between `column` and the next one."""

        def mix(values: FloatArray) -> FloatArray:
            return np.asarray((1.0 - fraction) * values[column] + fraction * values[column + 1])

        return mix(self.A_0), mix(self.A_cos), mix(self.A_sin), float(mix(self.frequency))


def seed_tongues(
    grid: SeedInput, *, max_order: int, states: tuple[str, ...], labels: tuple[str, ...] | None
) -> list[tuple[int, SeededTongue]]:
    """All tongues crossing the parameter axis between columns, with the column on their left."""
    frequencies = _column_frequencies(grid)
    found: list[tuple[int, SeededTongue]] = []
    for column, fraction, kind, i, j, order in _crossings(frequencies, grid.frequency, max_order):
        seed = _evaluate(grid, column, fraction, kind, i, j, order, states, labels)
        if seed is not None:
            found.append((column, seed))
    return found


def _column_frequencies(grid: SeedInput) -> list[FloatArray]:
    eigenvalues = np.linalg.eigvals(grid.A_0)
    return [np.sort(s.imag[s.imag > 1e-9 * np.abs(s)]) for s in eigenvalues]


def _crossings(
    frequencies: list[FloatArray], passing: FloatArray, max_order: int
) -> list[tuple[int, float, ResonanceKind, int, int, int]]:
    """Where a resonant frequency meets the passing frequency: column, fraction, and the pair."""
    pairs: dict[int, list[tuple[ResonanceKind, int, int]]] = {}
    result: list[tuple[int, float, ResonanceKind, int, int, int]] = []
    for column in range(len(frequencies) - 1):
        left, right = frequencies[column], frequencies[column + 1]
        if len(left) != len(right):
            continue
        if len(left) not in pairs:
            pairs[len(left)] = resonant_pairs(len(left))
        kinds = pairs[len(left)]
        sign = np.array([-1.0 if kind == "difference" else 1.0 for kind, _, _ in kinds])
        low = np.array([i for _, i, _ in kinds], dtype=int)
        high = np.array([j for _, _, j in kinds], dtype=int)
        orders = np.arange(1, max_order + 1)
        gap = [np.abs(w[high] + sign * w[low])[:, None] / orders - passing[column + k]
               for k, w in enumerate((left, right))]  # fmt: skip
        for k, m in np.argwhere((gap[0] * gap[1] < 0.0) | (gap[0] == 0.0)):
            apart = gap[0][k, m] - gap[1][k, m]
            fraction = float(gap[0][k, m] / apart) if apart else 0.0
            result.append((column, fraction, *kinds[k], int(orders[m])))
    return result


def _evaluate(
    grid: SeedInput, column: int, fraction: float, kind: ResonanceKind, i: int, j: int, order: int,
    states: tuple[str, ...], labels: tuple[str, ...] | None,
) -> SeededTongue | None:  # fmt: skip
    """Threshold depth of one tongue; None when perturbation theory puts it well outside the range."""
    raw_0, raw_cos, raw_sin, frequency = grid.at(column, fraction)
    A_0, A_cos, A_sin = scaled_coefficients(raw_0, raw_cos, raw_sin, depth=grid.depth_max)
    modes = state_modes(A_0, states=states, labels=labels)
    if max(i, j) >= len(modes.oscillating):
        return None
    first, second, _ = pair_indices(modes, kind, i, j)
    pair = pair_coupling(
        modes, modal_harmonics(modes, A_cos, A_sin), first=first, second=second, order=order, frequency=frequency
    )
    expected = pair.critical(_MARGIN * grid.depth_max)
    if np.isinf(expected) or max(pair.s[0].real, pair.s[1].real) > 1e-9 * abs(pair.s[0]):
        return None
    resonance = make_resonance(kind, order, (i + 1, j + 1), modes.labels, frequency=frequency)
    slope = _slope(grid, column, kind, i, j, order)
    tried = sorted({min(expected, grid.depth_max), grid.depth_max})
    best = (float("inf"), fraction)
    for depth in tried:
        moved = float(np.clip(fraction - pair.detuning(depth) / order / slope, 0.0, 1.0)) if slope else fraction
        surrogate = depth_surrogate(*grid.at(column, moved)[:3], frequency=grid.at(column, moved)[3],
                                    depth_max=grid.depth_max)  # fmt: skip
        critical = critical_of(surrogate, states=states, labels=labels)
        if critical.unstable_at_zero:
            return None  # unstable anyway: there is no threshold to tell
        if critical.resonance.kind != "none" and critical.resonance.name != resonance.name:
            return None  # a wider tongue covers this place from a smaller depth on
        best = min(best, (critical.depth, moved))
        if np.isfinite(best[0]):
            break
    parameter = (1.0 - best[1]) * grid.parameter[column] + best[1] * grid.parameter[column + 1]
    return SeededTongue(float(parameter), best[0], resonance.name, False)


def _slope(grid: SeedInput, column: int, kind: ResonanceKind, i: int, j: int, order: int) -> float:
    """Change of (resonant frequency - passing frequency) from one column to the next, rad/s."""
    sign = -1.0 if kind == "difference" else 1.0
    gaps = []
    for k in (column, column + 1):
        s = np.linalg.eigvals(grid.A_0[k])
        w = np.sort(s.imag[s.imag > 1e-9 * np.abs(s)])
        gaps.append(abs(w[j] + sign * w[i]) / order - float(grid.frequency[k]))
    return float(gaps[1] - gaps[0])
