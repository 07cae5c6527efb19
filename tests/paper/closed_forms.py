"""Closed forms for coils over infinite plates and in a perfectly conducting corner, none of them from the package.

A plate reflects the normal field of a horizontal wavenumber K = (k_x, k_y) that a source at the rate r in the plate's
frame makes by Gamma(r): no other component couples, because a source above makes no vertical current. With
r = i (w - k_x v) for a source that oscillates as e^{iwt} and moves at v,

    thin sheet      Gamma = -r / (K w_0 + r),   w_0 = 2/(mu_0 sigma d)
    slab            Gamma = -(q^2 - K^2) T / ((q^2 + K^2) T + 2 K q),   q^2 = K^2 + r mu_0 sigma,   T = tanh(q d)
    perfect         Gamma = -1

A coil is a sheet of dipoles. With P = Int n . (-i k_x, -i k_y, -K) e^{-i k . x - K z} dS over it, the energy of coils
a and b is mu_0 I_a I_b / 8 pi^2 Int d^2k Gamma P_b P_a^* / K; forces are its derivatives by the place of a alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.fields.coil import RectangularCoil

MU_0 = 4e-7 * np.pi
Array = NDArray[np.complex128]
Reflection = Callable[[Array, NDArray[np.float64]], Array]


def thin_sheet(characteristic: float) -> Reflection:
    """A sheet of no thickness with 2/(mu_0 sigma d) = `characteristic` m/s."""
    return lambda rate, size: -rate / (size * characteristic + rate)


def slab(thickness: float, conductivity: float) -> Reflection:
    """An infinite plate of finite thickness."""

    def gamma(rate: Array, size: NDArray[np.float64]) -> Array:
        q = np.sqrt(size**2 + rate * MU_0 * conductivity)
        through = np.tanh(q * thickness)
        return -(rate * MU_0 * conductivity) * through / ((q * q + size**2) * through + 2.0 * size * q)

    return gamma


def perfect(rate: Array, size: NDArray[np.float64]) -> Array:
    """No field enters."""
    return -1.0 + 0.0 * rate * size


def _panels(end: float, count: int, points: int = 10) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Gauss nodes and weights on (0, end), the panels cubically finer towards zero."""
    x, weight = np.polynomial.legendre.leggauss(points)
    edges = end * np.linspace(0.0, 1.0, count + 1) ** 3
    half = 0.5 * np.diff(edges)[:, None]
    return (edges[:-1, None] + half * (1.0 + x)).ravel(), (half * weight).ravel()


@dataclass(frozen=True)
class Placed:
    """A coil whose middle lies at y, z; the fields of `RectangularCoil` say the rest."""

    coil: RectangularCoil
    y: float
    z: float


@dataclass(frozen=True)
class PlateCoils:
    """Coils on one magnet over an infinite plate whose top is z = 0; the magnet turns about the first coil's middle."""

    coils: Sequence[Placed]
    reflection: Reflection
    count: int = 10
    reach: float = 18.0
    _grid: tuple[NDArray[np.float64], ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        low = min(one.z - 0.5 * one.coil.width * abs(np.sin(one.coil.roll)) for one in self.coils)
        k, weight = _panels(self.reach / low, self.count)
        k_x = np.concatenate([-k[::-1], k])[:, None]
        k_y = np.concatenate([-k[::-1], k])[None, :]
        both = np.concatenate([weight[::-1], weight])
        size = np.hypot(k_x, k_y)
        object.__setattr__(self, "_grid", (k_x, k_y, size, MU_0 / (8.0 * np.pi**2) * both[:, None] * both / size))

    def _spectrum(self) -> list[Array]:
        """P of all coils together, and its derivatives by surge, sway, heave and roll."""
        k_x, k_y, size, _ = self._grid
        x, w = np.polynomial.legendre.leggauss(20)
        pivot = self.coils[0]
        value, turned = np.zeros(size.shape, dtype=complex), np.zeros(size.shape, dtype=complex)
        for one in self.coils:
            coil, c, s = one.coil, np.cos(one.coil.roll), np.sin(one.coil.roll)
            along = coil.ampere_turns * coil.length * np.sinc(k_x * coil.length / (2.0 * np.pi))
            along = along * np.exp(-1j * k_x * coil.forward)
            normal = 1j * k_y * s - size * c  # n = (0, -sin, cos)
            slope = 1j * k_y * c + size * s  # its derivative by roll
            for lever, weight in zip(0.5 * coil.width * x, 0.5 * coil.width * w, strict=True):
                y, z = one.y + lever * c, one.z + lever * s
                wave = along * (weight * np.exp(-1j * k_y * y - size * z))
                # a turn moves a point by (-(z - z_0), y - y_0)
                path = 1j * k_y * (z - pivot.z) - size * (y - pivot.y)
                value += normal * wave
                turned += (slope + normal * path) * wave
        return [value, -1j * k_x * value, -1j * k_y * value, -size * value, turned]

    def _gamma(self, speed: float, frequency: complex) -> Array:
        k_x, _, size, _ = self._grid
        return self.reflection(1j * (frequency - k_x * speed) + 0.0 * size, size)

    def forces(self, speed: float) -> NDArray[np.float64]:
        """On surge, sway, heave, roll; (4,) N, N m."""
        P = self._spectrum()
        weight = self._grid[3] * self._gamma(speed, 0.0) * P[0]
        return np.array([np.sum(weight * np.conj(part)).real for part in P[1:]])

    def motion_stiffness(self, speed: float, frequency: complex) -> Array:
        """Q of surge, sway and heave; (3, 3) N/m."""
        k_x, k_y, size, weight = self._grid
        power = weight * np.abs(self._spectrum()[0]) ** 2
        steady, moving = self._gamma(speed, 0.0), self._gamma(speed, frequency)
        felt = (1j * k_x, 1j * k_y, -size)
        made = (-1j * k_x, -1j * k_y, -size)
        return np.array(
            [[np.sum(power * felt[i] * (felt[j] * steady + made[j] * moving)) for j in range(3)] for i in range(3)]
        )


def image_lift(coil: RectangularCoil, z: float) -> float:
    """Lift of a flat coil at z over a perfect conductor, from the mutual inductance with its image below, N."""
    return -(coil.ampere_turns**2) * _mutual_slopes(coil.length, coil.width, 0.0, 2.0 * z)[1]


def corner_images(coil: RectangularCoil, y: float, z: float) -> tuple[float, float]:
    """Guidance and lift of a flat coil in a perfect corner from its images in floor, wall and both, N."""
    square = coil.ampere_turns**2
    floor = _mutual_slopes(coil.length, coil.width, 0.0, 2.0 * z)
    wall = _mutual_slopes(coil.length, coil.width, 2.0 * y, 0.0)
    both = _mutual_slopes(coil.length, coil.width, 2.0 * y, 2.0 * z)
    # Seen from above the floor's image runs the other way and the wall's the same way: no normal field on either face.
    return square * (wall[0] - both[0]), -square * (floor[1] + both[1])


def _mutual_slopes(length: float, width: float, y: float, z: float) -> tuple[float, float]:
    """dM/dy, dM/dz of two equal parallel rectangles apart by (0, y, z), by Neumann's integral, H/m.

    The slopes of the inner integral Int du'/R are in closed form; the outer one is Gauss's.
    """
    x, w = np.polynomial.legendre.leggauss(200)

    def parallel(size: float, far: float, up: float, shift: float) -> tuple[float, float, float]:
        """Two wires of `size` along u, apart by `shift` along u, `far` across and `up`: slopes by the three."""
        t = 0.5 * size * (x + 1.0)
        weight = 0.5 * size * w
        slope_shift = slope_far = slope_up = 0.0
        for end, sign in ((size, 1.0), (0.0, -1.0)):
            u = end + shift - t
            r = np.sqrt(u * u + far * far + up * up)
            rho = far * far + up * up
            slope_shift += sign * np.sum(weight / r)
            if rho > 0.0:
                common = -sign * np.sum(weight * u / r) / rho
                slope_far += common * far
                slope_up += common * up
        return slope_shift, slope_far, slope_up

    dy = dz = 0.0
    # long sides: along x at y = -+ width/2
    for offset, sense in ((0.0, 2.0), (width, -1.0), (-width, -1.0)):
        _, far, up = parallel(length, y + offset, z, 0.0)
        dy, dz = dy + sense * far, dz + sense * up
    # ends: along y at x = -+ length/2, displaced by y along themselves
    for offset, sense in ((0.0, 2.0), (length, -2.0)):
        along, _, up = parallel(width, offset, z, y)
        dy, dz = dy + sense * along, dz + sense * up
    return 1e-7 * dy, 1e-7 * dz
