"""A rectangular loop over an infinite thin sheet in closed form: Fourier integrals, steady and oscillating.

The sheet reflects a field of wavenumber k at rate s in its own frame by Gamma = -r/(|k| w + r), r = s - i k_x v,
w = 2/(mu0 sigma d). With the loop's spectrum S = (2 sin(k_x a)/k_x)(2 sin(k_y c)/k_y),

    Q_ij(s) = mu0 I^2/(8 pi^2) Int d^2k |k| |S|^2 e^{-2 |k| h} [g_i g_j Gamma(0) + g_i e_j Gamma(s)]

with g = (i k_x, i k_y, -|k|) where the loop feels the field and e = (-i k_x, -i k_y, -|k|) where it makes it. Exact at
complex s; all singularities lie at s = i k_x v - |k| w, in the left half plane.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from maglev_ctrl.forces import AbstractForceModel, Domain, MagnetDerivatives, MagnetForces

MU_0 = 4e-7 * np.pi


def panels(end: float, count: int, points: int = 8) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes and weights on (0, end), panel by panel."""
    x, weight = np.polynomial.legendre.leggauss(points)
    edges = end * np.linspace(0.0, 1.0, count + 1) ** 3
    half = 0.5 * np.diff(edges)[:, None]
    return (edges[:-1, None] + half * (1.0 + x)).ravel(), (half * weight).ravel()


@dataclass(frozen=True)
class SheetLoop(AbstractForceModel):
    """Loop of half length a and half width c, m, at the levitation height; w is the sheet's characteristic speed."""

    a: float = 25.4e-3
    c: float = 12.7e-3
    current: float = 6000.0
    w: float = 10.0
    strength: float = 1.0
    reach: float = 16.0
    panels: int = 14
    flip: bool = False  # the mutant: Im Q of the wrong sign

    @property
    def domain(self) -> Domain:
        return Domain(height=(1e-3, 1.0), gap=None, speed=(0.0, 1e3))

    def grid(self, h: float):
        k, weight = panels(self.reach / h, self.panels)
        k_x = np.concatenate([-k[::-1], k])[:, None]
        k_y = k[None, :]
        size = np.hypot(k_x, k_y)
        spectrum = 4.0 * np.sin(k_x * self.a) * np.sin(k_y * self.c) / (k_x * k_y)
        area = 2.0 * np.concatenate([weight[::-1], weight])[:, None] * weight[None, :]  # k_y < 0 is the mirror image
        factor = self.strength * MU_0 * self.current**2 / (8.0 * np.pi**2)
        return k_x, k_y, size, factor * area * size * spectrum**2 * np.exp(-2.0 * size * h)

    def reflection(self, rate, size):
        return -rate / (size * self.w + rate)

    def steady(self, h: float, v: float) -> tuple[float, float]:
        """Lift and drag."""
        k_x, _, size, weight = self.grid(h)
        gamma = self.reflection(-1j * k_x * v, size)
        return float(np.sum(-weight * size * gamma).real), float(-np.sum(weight * 1j * k_x * gamma).real)

    def motion_stiffness(self, height, gap, speed, frequency):
        w = np.atleast_1d(np.asarray(frequency)).astype(complex)
        k_x, k_y, size, weight = self.grid(height)
        found = np.zeros((len(w), 4, 4), dtype=complex)
        steady = self.reflection(-1j * k_x * speed, size)
        felt, made = (1j * k_x, 1j * k_y, -size), (-1j * k_x, -1j * k_y, -size)
        pairs = [(0, 0), (0, 2), (2, 0), (1, 1), (2, 2)]  # the others are odd in k_y
        for n, one in enumerate(w):
            moving = self.reflection(1j * one - 1j * k_x * speed, size)
            for i, j in pairs:
                found[n, i, j] = np.sum(weight * felt[i] * (felt[j] * steady + made[j] * moving))
        return found.conj() if self.flip else found

    def forces(self, height, gap, speed):
        h, v = np.broadcast_arrays(np.asarray(height, float), np.asarray(speed, float))
        pairs = np.array([self.steady(*one) for one in zip(h.ravel(), v.ravel(), strict=True)])
        return MagnetForces(pairs[:, 0].reshape(h.shape), 0.0, pairs[:, 1].reshape(h.shape))

    def derivatives(self, height, gap, speed):
        nothing = MagnetForces(np.zeros(np.shape(height)), 0.0, 0.0)
        by = []
        for step_h, step_v in ((1e-6, 0.0), (0.0, 1e-4)):
            up, down = (self.forces(height + x * step_h, gap, speed + x * step_v) for x in (1.0, -1.0))
            step = 2.0 * (step_h + step_v)
            by.append(MagnetForces((up.lift - down.lift) / step, 0.0, (up.drag - down.drag) / step))
        return MagnetDerivatives(by[0], nothing, by[1], nothing, nothing)

    def scaled(self, factor):
        return replace(self, strength=self.strength * float(factor))
