"""Frequency weightings of ISO 2631-1 with the exact sections of ISO 8041, comfort classes, vector sum."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt
from types import MappingProxyType

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only, read_only_any


@dataclass(frozen=True, eq=False, slots=True)
class Weighting:
    """A frequency weighting: H(s) = gain * prod (s - zeros) / prod (s - poles), its poles in the left half-plane.

    `corners` are the parameters it is made of, Hz and quality factors, None where a section is left out.
    """

    name: str
    zeros: ComplexArray
    poles: ComplexArray
    gain: float
    corners: tuple[tuple[str, float | None], ...] = ()

    @property
    def relative_degree(self) -> int:
        """Poles more than zeros: how fast the weighting falls at high frequencies."""
        return len(self.poles) - len(self.zeros)

    @property
    def through(self) -> float:
        """Gain at infinite frequency."""
        return self.gain if self.relative_degree == 0 else 0.0

    def at(self, s: ArrayLike) -> ComplexArray:
        """H at complex frequencies s (...), rad/s."""
        point = np.asarray(s, dtype=complex)[..., None]
        # Factors are paired from the lowest corner up, so that no product leaves the range of numbers.
        scale = np.abs(self.poles)
        value = self.gain / np.prod(scale[len(self.zeros) :]) / np.prod(
            (point - self.poles) / scale, axis=-1
        )  # fmt: skip
        return np.asarray(value * np.prod((point - self.zeros) / scale[: len(self.zeros)], axis=-1))

    def response(self, frequency: ArrayLike) -> ComplexArray:
        """H at frequencies (...) in Hz.

        Examples
        --------
        >>> round(float(abs(weighting("Wk").response(4.0))), 3)     # 0.967 in the standard's table
        0.967
        """
        return self.at(2j * pi * np.asarray(frequency, dtype=np.float64))

    def residues(self) -> ComplexArray:
        """Residues of H at its poles, (n,); not finite where poles coincide."""
        apart = self.poles[:, None] - self.poles[None, :] + np.eye(len(self.poles))
        above = np.prod(self.poles[:, None] - self.zeros[None, :], axis=1)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return np.asarray(self.gain * above / np.prod(apart, axis=1))

    def state_space(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Balanced realisation (A, B, C, D): both Gramians are the same diagonal matrix.

        Examples
        --------
        >>> A, B, C, D = weighting("Wd").state_space()
        >>> w = 2 * np.pi * 3.0
        >>> value = C @ np.linalg.solve(1j * w * np.eye(len(A)) - A, B) + D
        >>> bool(abs(value[0, 0] - weighting("Wd").response(3.0)) < 1e-9)
        True
        """
        return _balanced(*_cascade(self))


TABLE: MappingProxyType[str, MappingProxyType[str, float]] = MappingProxyType({
    "Wk": MappingProxyType({
        "f1": 0.4, "f2": 100.0, "f3": 12.5, "f4": 12.5, "Q4": 0.63, "f5": 2.37, "Q5": 0.91, "f6": 3.35, "Q6": 0.91,
    }),
    "Wd": MappingProxyType({"f1": 0.4, "f2": 100.0, "f3": 2.0, "f4": 2.0, "Q4": 0.63}),
    "Wc": MappingProxyType({"f1": 0.4, "f2": 100.0, "f3": 8.0, "f4": 8.0, "Q4": 0.63}),
    "We": MappingProxyType({"f1": 0.4, "f2": 100.0, "f3": 1.0, "f4": 1.0, "Q4": 0.63}),
    "Wf": MappingProxyType({
        "f1": 0.08, "f2": 0.63, "f4": 0.25, "Q4": 0.86, "f5": 0.0625, "Q5": 0.80, "f6": 0.1, "Q6": 0.80,
    }),
    "Wj": MappingProxyType({"f1": 0.4, "f2": 100.0, "f5": 3.75, "Q5": 0.91, "f6": 5.32, "Q6": 0.91}),
})  # fmt: skip
"""Parameters of the weightings (ISO 8041): corners in Hz, quality factors. A corner left out is at infinity.

Wk: vertical, seat. Wd: horizontal, seat. Wc: seat back. We: rotation. Wf: motion sickness. Wj: head.
"""


def weighting(name: str) -> Weighting:
    """A weighting of ISO 2631-1 by its name: Wk, Wd, Wc, We, Wf, Wj.

    Raises
    ------
    ValueError : there is no such weighting

    Examples
    --------
    >>> [round(float(abs(weighting("Wk").response(f))), 3) for f in (1.0, 8.0, 31.5)]
    [0.482, 1.036, 0.405]
    """
    if name not in TABLE:
        raise ValueError(f"weighting: expected one of {', '.join(TABLE)}, got {name!r}")
    return weighting_from_parameters(**TABLE[name], name=name)


def weighting_from_parameters(
    *,
    f1: float | None = None,
    f2: float | None = None,
    f3: float | None = None,
    f4: float | None = None,
    Q4: float | None = None,
    f5: float | None = None,
    Q5: float | None = None,
    f6: float | None = None,
    Q6: float | None = None,
    name: str = "weighting",
) -> Weighting:
    """A weighting from the parameters of ISO 8041; what is None (or infinite) is left out.

    H = Hh Hl Ht Hs with w_i = 2 pi f_i: the high-pass s^2 / (s^2 + sqrt(2) w1 s + w1^2), the low-pass
    1 / (1 + sqrt(2) s/w2 + (s/w2)^2), the transition from acceleration to velocity
    (1 + s/w3) / (1 + s/(Q4 w4) + (s/w4)^2), and the upward step
    (1 + s/(Q5 w5) + (s/w5)^2) / (1 + s/(Q6 w6) + (s/w6)^2) (w5/w6)^2.

    Parameters
    ----------
    f1, f2 : corners of the band limits, Hz
    f3, f4, Q4 : of the transition; without f3 its numerator is one
    f5, Q5, f6, Q6 : of the step, all four or none

    Raises
    ------
    ValueError : a parameter that is not positive, or a section whose parameters are not complete

    Examples
    --------
    >>> high_pass = weighting_from_parameters(f1=0.4)
    >>> round(float(abs(high_pass.response(0.4))), 6)
    0.707107
    """
    given = {"f1": f1, "f2": f2, "f3": f3, "f4": f4, "Q4": Q4, "f5": f5, "Q5": Q5, "f6": f6, "Q6": Q6}
    for key, value in given.items():
        if value is not None and (np.isnan(value) or value <= 0.0):
            raise ValueError(f"{key}: expected a positive number or None, got {value!r}")
    finite = {key: float(value) for key, value in given.items() if value is not None and np.isfinite(value)}
    zeros: list[complex] = []
    poles: list[complex] = []
    gain = 1.0
    if "f1" in finite:
        zeros += [0.0, 0.0]
        poles += _pair(finite["f1"], sqrt(0.5))
    if "f2" in finite:
        poles += _pair(finite["f2"], sqrt(0.5))
        gain *= (2.0 * pi * finite["f2"]) ** 2
    if "f4" in finite:
        if "Q4" not in finite:
            raise ValueError(f"Q4: expected a quality factor with f4 = {f4}, got None")
        poles += _pair(finite["f4"], finite["Q4"])
        gain *= (2.0 * pi * finite["f4"]) ** 2
    if "f3" in finite:
        if "f4" not in finite:
            raise ValueError(f"f4: expected a corner with f3 = {f3}, got {f4}")
        zeros.append(-2.0 * pi * finite["f3"])
        gain /= 2.0 * pi * finite["f3"]
    step = [key for key in ("f5", "Q5", "f6", "Q6") if key in finite]
    if step and len(step) < 4:
        missing = next(key for key in ("f5", "Q5", "f6", "Q6") if key not in finite)
        raise ValueError(f"{missing}: expected f5, Q5, f6 and Q6 for the upward step, got {', '.join(step)} only")
    if step:
        # (s^2 + ...)/w5^2 over (s^2 + ...)/w6^2 times (w5/w6)^2: the leading coefficients cancel.
        zeros += _pair(finite["f5"], finite["Q5"])
        poles += _pair(finite["f6"], finite["Q6"])
    corners = tuple((key, value) for key, value in given.items())
    return Weighting(
        name,
        read_only_any(np.array(zeros, dtype=complex)),
        read_only_any(np.array(poles, dtype=complex)),
        gain,
        corners,
    )


COMFORT_BOUNDS = (
    (0.315, "not uncomfortable"),
    (0.63, "a little uncomfortable"),
    (1.0, "fairly uncomfortable"),
    (1.6, "uncomfortable"),
    (2.5, "very uncomfortable"),
)
"""Upper ends (m/s^2) of the overlapping classes of ISO 2631-1 annex C; above the last: extremely uncomfortable."""

COMFORT_LOWER = (0.0, 0.315, 0.5, 0.8, 1.25, 2.0)


def comfort_class(total: float) -> str:
    """The words of ISO 2631-1 annex C (C.2.3) for a vibration total value in m/s^2; classes overlap there.

    Where two classes overlap both are told, the milder first.

    Examples
    --------
    >>> comfort_class(0.2), comfort_class(0.55)
    ('not uncomfortable', 'a little uncomfortable to fairly uncomfortable')
    """
    if not np.isfinite(total) or total < 0.0:
        return "not evaluated"
    words = [name for _, name in COMFORT_BOUNDS] + ["extremely uncomfortable"]
    upper = [bound for bound, _ in COMFORT_BOUNDS] + [np.inf]
    fits = [
        word
        for word, low, high in zip(words, COMFORT_LOWER, upper, strict=True)
        if (low <= total if low == 0.0 else low < total) and total <= high
    ]
    return " to ".join(fits) if fits else words[0]


def vector_sum(weighted: ArrayLike, factors: ArrayLike | None = None) -> float:
    """Vibration total value sqrt(sum (k a_w)^2), m/s^2 (ISO 2631-1, 6.5).

    Parameters
    ----------
    weighted : (n,) weighted r.m.s. accelerations by axis, m/s^2
    factors : (n,) multiplying factors k; one for comfort of a seated person with Wk and Wd (for health 1.4 sideways)

    Examples
    --------
    >>> round(vector_sum([0.3, 0.4]), 12), round(vector_sum([0.3, 0.4], [1.4, 1.0]), 6)
    (0.5, 0.58)
    """
    values = np.asarray(weighted, dtype=np.float64)
    k = np.ones_like(values) if factors is None else read_only(factors, name="factors", shape=values.shape)
    return float(np.sqrt(np.sum((k * values) ** 2)))


def _pair(frequency: float, quality: float) -> list[complex]:
    """Roots of 1 + s/(Q w) + (s/w)^2."""
    omega = 2.0 * pi * frequency
    half = omega / (2.0 * quality)
    root = np.sqrt(complex(half * half - omega * omega))
    if root.imag == 0.0:
        lower = -half - root.real
        return [complex(lower), complex(omega * omega / lower)]
    return [-half + root, -half - root]


def _cascade(given: Weighting) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Sections of second order in a row, each in units of its own corner."""
    A, B, C, D = np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.array([[given.gain]])
    poles = [np.poly(given.poles[i : i + 2]).real for i in range(0, len(given.poles), 2)]
    reals = given.zeros[np.abs(given.zeros.imag) == 0.0].real
    pairs = [z for z in given.zeros if z.imag > 0.0]
    upper = [np.poly([z, np.conj(z)]).real for z in pairs] + [
        np.poly(reals[i : i + 2]) for i in range(0, len(reals), 2)
    ]
    upper += [np.array([1.0])] * (len(poles) - len(upper))
    for numerator, denominator in zip(upper, poles, strict=True):
        scale = float(np.sqrt(abs(denominator[2])))
        a = np.array([[0.0, scale], [-scale, -denominator[1]]])
        b = np.array([[0.0], [scale]])
        full = np.concatenate([np.zeros(3 - len(numerator)), numerator])
        d = full[0]
        rest = full[1:] - d * denominator[1:]  # r1 s + r0 over the denominator
        c = np.array([[rest[1] / scale**2, rest[0] / scale]])
        A = np.block([[A, np.zeros((len(A), 2))], [b @ C, a]])
        B, C, D = np.vstack([B, b @ D]), np.hstack([d * C, c]), d * D
    return A, B, C, D


def _balanced(
    A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Square-root balancing (Laub and others, IEEE Trans. Autom. Control 32 (1987) 115)."""
    if not len(A):
        return A, B, C, D
    size = np.sqrt(float(np.linalg.norm(C)) / float(np.linalg.norm(B)))
    B, C = B * size, C / size
    reach = scipy.linalg.solve_continuous_lyapunov(A, -B @ B.T)
    watch = scipy.linalg.solve_continuous_lyapunov(A.T, -C.T @ C)
    lower_reach, lower_watch = (np.linalg.cholesky(0.5 * (g + g.T)) for g in (reach, watch))
    left, values, right = np.linalg.svd(lower_watch.T @ lower_reach)
    root = np.sqrt(values)
    T, back = lower_reach @ right.T / root, (left / root).T @ lower_watch.T
    return back @ A @ T, back @ B, C @ T, D
