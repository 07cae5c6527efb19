"""Matrices that repeat, by their Fourier coefficients: values, rates, products, and series through samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray, read_only, transpose


@dataclass(frozen=True, eq=False, slots=True)
class FourierMatrix:
    """F(t) = mean + sum over k = 1..H of (cosine[k] cos k W t + sine[k] sin k W t), W = `frequency` rad/s.

    `mean` (p, q); `cosine`, `sine` (H, p, q).
    """

    mean: FloatArray
    cosine: FloatArray
    sine: FloatArray
    frequency: float

    @classmethod
    def of(
        cls, mean: ArrayLike, cosine: ArrayLike | None = None, sine: ArrayLike | None = None, *, frequency: float
    ) -> FourierMatrix:
        """A series from its coefficients, shapes checked; no harmonics where none are given.

        Raises
        ------
        ValueError : a shape does not fit, or the frequency is not positive

        Examples
        --------
        >>> FourierMatrix.of([[1.0]], [[[2.0]]], frequency=3.0)(0.0)
        array([[3.]])
        """
        centre = read_only(mean, name="mean", shape=(None, None))
        if centre.ndim != 2:
            raise ValueError(f"mean: expected one matrix, got shape {centre.shape}")
        given = sine if cosine is None else cosine
        empty = np.zeros((0, *centre.shape)) if given is None else np.zeros_like(np.asarray(given, dtype=float))
        a = read_only(empty if cosine is None else cosine, name="cosine", shape=(None, *centre.shape))
        b = read_only(empty if sine is None else sine, name="sine", shape=a.shape)
        if a.ndim != 3 or b.ndim != 3:
            raise ValueError(f"cosine, sine: expected one matrix per harmonic, got shapes {a.shape} and {b.shape}")
        if not frequency > 0.0:
            raise ValueError("frequency: expected a positive angular frequency in rad/s")
        return cls(centre, a, b, float(frequency))

    @classmethod
    def from_samples(cls, samples: FloatArray, *, frequency: float, harmonics: int) -> FourierMatrix:
        """Series through samples (N, p, q) at the times i T / N, harmonics above `harmonics` left out.

        Raises
        ------
        ValueError : fewer than 2 `harmonics` + 1 samples

        Examples
        --------
        >>> t = 2.0 * np.pi * np.arange(5) / 5
        >>> FourierMatrix.from_samples(np.sin(t)[:, None, None], frequency=1.0, harmonics=1).sine.round(12)
        array([[[1.]]])
        """
        count = len(samples)
        if count < 2 * harmonics + 1:
            raise ValueError(f"harmonics: {count} samples carry at most {(count - 1) // 2}, got {harmonics}")
        spectrum = np.fft.rfft(samples, axis=0)[: harmonics + 1] / count
        return cls.of(
            spectrum[0].real, 2.0 * spectrum[1:].real, -2.0 * spectrum[1:].imag, frequency=frequency
        )  # fmt: skip

    @property
    def harmonics(self) -> int:
        """Number of harmonics H."""
        return len(self.cosine)

    @property
    def period(self) -> float:
        """Period 2 pi / W in s."""
        return 2.0 * np.pi / self.frequency

    @property
    def T(self) -> FourierMatrix:
        """The transposed matrix at every instant."""
        return FourierMatrix.of(
            self.mean.T, transpose(self.cosine), transpose(self.sine), frequency=self.frequency
        )  # fmt: skip

    @property
    def reversed(self) -> FourierMatrix:
        """F(-t)."""
        return FourierMatrix.of(self.mean, self.cosine, -self.sine, frequency=self.frequency)

    def __call__(self, times: ArrayLike) -> FloatArray:
        """Values at `times` (...) in s: (..., p, q).

        Parameters
        ----------
        times : s, any shape
        """
        angle = self._angles(times)
        return np.asarray(
            self.mean
            + np.tensordot(np.cos(angle), self.cosine, axes=1)
            + np.tensordot(np.sin(angle), self.sine, axes=1)
        )

    def rate(self, times: ArrayLike) -> FloatArray:
        """Time derivative at `times` (...) in s: (..., p, q).

        Parameters
        ----------
        times : s, any shape

        Examples
        --------
        >>> float(FourierMatrix.of([[0.0]], None, [[[1.0]]], frequency=3.0).rate(0.0)[0, 0])
        3.0
        """
        angle = self._angles(times)
        speed = self.frequency * np.arange(1.0, self.harmonics + 1.0)
        return np.asarray(
            np.tensordot(speed * np.cos(angle), self.sine, axes=1)
            - np.tensordot(speed * np.sin(angle), self.cosine, axes=1)
        )

    def samples(self, count: int) -> FloatArray:
        """Values at the times i T / count: (count, p, q)."""
        return self(self.period * np.arange(count) / count)

    def norms(self) -> FloatArray:
        """Spectral norm bounds |cosine[k]| + |sine[k]| of each harmonic, the mean first: (H + 1,)."""
        each = [np.linalg.norm(a, 2) + np.linalg.norm(b, 2) for a, b in zip(self.cosine, self.sine, strict=True)]
        return np.array([np.linalg.norm(self.mean, 2), *each])

    def magnitude(self) -> FloatArray:
        """Bound of every entry over the period: (p, q)."""
        return np.asarray(np.abs(self.mean) + np.sum(np.abs(self.cosine) + np.abs(self.sine), axis=0))

    def padded(self, harmonics: int) -> FourierMatrix:
        """The same matrix with at least `harmonics` harmonics, those added being zero."""
        more = max(harmonics - self.harmonics, 0)
        zeros = np.zeros((more, *self.mean.shape))
        return FourierMatrix.of(
            self.mean, np.concatenate([self.cosine, zeros]), np.concatenate([self.sine, zeros]),
            frequency=self.frequency,
        )  # fmt: skip

    def truncated(self, tolerance: float) -> FourierMatrix:
        """Without the highest harmonics whose bounds together are below `tolerance` times the largest bound."""
        sizes = self.norms()
        left_out = np.cumsum(sizes[::-1])[::-1]
        keep = int(np.count_nonzero(left_out[1:] > tolerance * np.max(sizes)))
        return FourierMatrix.of(self.mean, self.cosine[:keep], self.sine[:keep], frequency=self.frequency)

    def scaled(self, left: FloatArray, right: FloatArray) -> FourierMatrix:
        """diag(left) F(t) diag(right)."""
        outer = np.outer(left, right)
        return FourierMatrix.of(
            self.mean * outer, self.cosine * outer, self.sine * outer, frequency=self.frequency
        )  # fmt: skip

    def plus(self, other: FourierMatrix, factor: float = 1.0) -> FourierMatrix:
        """F(t) + factor * other(t).

        Raises
        ------
        ValueError : the frequencies differ
        """
        self._same_frequency(other)
        a, b = self.padded(other.harmonics), other.padded(self.harmonics)
        return FourierMatrix.of(
            a.mean + factor * b.mean, a.cosine + factor * b.cosine, a.sine + factor * b.sine, frequency=self.frequency
        )  # fmt: skip

    def times(self, other: FourierMatrix) -> FourierMatrix:
        """F(t) other(t), all harmonics kept.

        Raises
        ------
        ValueError : the frequencies differ

        Examples
        --------
        >>> wave = FourierMatrix.of([[0.0]], [[[1.0]]], frequency=1.0)
        >>> wave.times(wave).mean
        array([[0.5]])
        """
        self._same_frequency(other)
        most = self.harmonics + other.harmonics
        count = 2 * most + 1
        return FourierMatrix.from_samples(
            self.samples(count) @ other.samples(count), frequency=self.frequency, harmonics=most
        )

    def _angles(self, times: ArrayLike) -> FloatArray:
        phase = self.frequency * np.asarray(times, dtype=np.float64)
        return np.asarray(phase[..., None] * np.arange(1.0, self.harmonics + 1.0))

    def _same_frequency(self, other: FourierMatrix) -> None:
        if abs(self.frequency - other.frequency) > 1e-12 * self.frequency:
            raise ValueError(f"frequency: the series repeat at {self.frequency:g} and {other.frequency:g} rad/s")
