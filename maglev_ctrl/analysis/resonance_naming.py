"""Names an unstable point of a periodic system by the modes that its growing solution is made of.

The growing solution e^(st) sum_k p_k e^(ikWt) is expanded in the modes of A_0; with the left solution this gives
participations that sum to one and do not depend on scaling. The two largest, mode m at harmonic k and mode m' at
harmonic k', tell the resonance: Im s_m - Im s_m' is near (k - k') W.
"""

from __future__ import annotations

import numpy as np

from maglev_ctrl.analysis.floquet import Floquet, floquet, scaled_coefficients
from maglev_ctrl.analysis.resonance import NO_RESONANCE, Resonance, StateModes, make_resonance, state_modes
from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.kernels import hill_matrix, hill_pair
from maglev_ctrl.systems import PeriodicSystem

MOSTLY = 2.0  # growth beyond this times the mode's own without modulation is owed to a resonance for the most part
_LEAST_SHARE = 0.02  # a partner with less than this share of the leading one is no partner


def name_instability(
    system: PeriodicSystem, result: Floquet | None = None, *, labels: tuple[str, ...] | None = None
) -> Resonance:
    """The resonance behind the most critical Floquet exponent of `system`; kind "none" when there is none.

    Parameters
    ----------
    system : one periodic system
    result : its Floquet analysis, done here when left out
    labels : names of the oscillating modes of A_0 in order of frequency

    Raises
    ------
    ValueError : the system carries batch axes

    Examples
    --------
    >>> mathieu = PeriodicSystem.from_matrices([[0, 1], [-1, 0]], [[[0, 0], [-0.4, 0]]], frequency=2.0)
    >>> name_instability(mathieu).name
    '2 w1/1'
    """
    analysed = floquet(system) if result is None else result
    A_0, A_cos, A_sin = scaled_coefficients(system.A_0, system.A_cos, system.A_sin)
    modes = state_modes(A_0, states=system.states, labels=labels)
    exponent = complex(analysed.exponents[0])
    return name_exponent(A_0, A_cos, A_sin, frequency=float(system.frequency), exponent=exponent, modes=modes)


def name_exponent(
    A_0: FloatArray, A_cos: FloatArray, A_sin: FloatArray, *, frequency: float, exponent: complex, modes: StateModes
) -> Resonance:
    """The resonance behind one exponent; matrices at the actual depth and in the coordinates of `modes`.

    Examples
    --------
    >>> A_0 = np.array([[0.0, 1.0], [-1.0, -0.1]])
    >>> name_exponent(A_0, np.zeros((1, 2, 2)), np.zeros((1, 2, 2)), frequency=2.0, exponent=-0.05 + 0.99875j,
    ...               modes=state_modes(A_0)).kind
    'none'
    """
    participation, _ = exponent_participation(A_0, A_cos, A_sin, frequency=frequency, exponent=exponent, modes=modes)
    size = np.abs(participation)
    first, k_first = np.unravel_index(int(np.argmax(size)), size.shape)
    own = float(modes.s[first].real)
    if own > 1e-9 * abs(modes.s[first]) and exponent.real < MOSTLY * own:
        return NO_RESONANCE
    others = size.copy()
    others[:, k_first] = 0.0
    others[first] = 0.0
    others[np.abs(modes.s.imag) <= 1e-9 * np.abs(modes.s)] = 0.0
    second, k_second = np.unravel_index(int(np.argmax(others)), others.shape)
    if others[second, k_second] < _LEAST_SHARE * size[first, k_first]:
        return NO_RESONANCE
    return _resonance(modes, int(first), int(second), int(k_first) - int(k_second), frequency)


def _resonance(modes: StateModes, first: int, second: int, turns: int, frequency: float) -> Resonance:
    s_1, s_2 = modes.s[first], modes.s[second]
    order = abs(turns)
    if s_1.imag == 0.0 or order == 0:
        return NO_RESONANCE
    i = 1 + modes.oscillating.index(first if s_1.imag > 0.0 else modes.conjugate[first])
    j = 1 + modes.oscillating.index(second if s_2.imag > 0.0 else modes.conjugate[second])
    low, high = min(i, j), max(i, j)
    opposite = s_1.imag * s_2.imag < 0.0
    distance = abs(s_1.imag - s_2.imag)
    if opposite:
        kind = "parametric" if i == j else "sum"
        return make_resonance(
            "parametric" if kind == "parametric" else "sum", order, (low, high), modes.labels,
            frequency=float(distance / order), detuning=float(frequency - distance / order),
        )  # fmt: skip
    return make_resonance(
        "difference", order, (low, high), modes.labels,
        frequency=float(distance / order), detuning=float(frequency - distance / order),
    )  # fmt: skip


def exponent_participation(
    A_0: FloatArray, A_cos: FloatArray, A_sin: FloatArray, *, frequency: float, exponent: complex, modes: StateModes
) -> tuple[ComplexArray, int]:
    """Participation (n, 2N+1) of mode m at harmonic k - N in one Floquet solution (sum 1), and N."""
    n = A_0.shape[-1]
    guess = central_copy(exponent, modes.s, frequency)
    reach = max(6, 5 * len(A_cos))
    matrix = hill_matrix(A_0, A_cos, A_sin, frequency=frequency, harmonics=reach)
    _, right, left, _ = hill_pair(matrix, guess)
    amplitudes = modes.left.conj().T @ right.reshape(-1, n).T
    duals = modes.right.conj().T @ left.reshape(-1, n).T
    product = duals.conj() * amplitudes
    total = complex(np.sum(product))
    if abs(total) < 1e-12 * np.sum(np.abs(product)):
        total = complex(np.sum(np.abs(product)))
    return np.asarray(product / total), reach


def central_copy(exponent: complex, eigenvalues: ComplexArray, frequency: float) -> complex:
    """The copy exponent + i k W that lies nearest to an eigenvalue of A_0: its content is at low harmonics."""
    turns = np.round((eigenvalues.imag - exponent.imag) / frequency)
    copies = exponent + 1j * frequency * turns
    return complex(copies[int(np.argmin(np.abs(copies - eigenvalues)))])
