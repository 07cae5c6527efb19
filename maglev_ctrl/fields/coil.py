"""Rectangular coils: the magnetic scalar potential they make in the cross-section, and how it moves with them.

A coil is a sheet of magnetic dipoles. Transformed along the track (e^{ikx}) its potential outside the sheet is
Omega = X(k) / 2 pi * Int n . grad' K0(k |x - x'|) dl over the coil's line in the cross-section, with X(k) the transform
of its length. One scalar field holds everything the conductor can feel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import k0, k1

from maglev_ctrl.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class RectangularCoil:
    """A rectangular coil carried by a magnet; a magnet is given by its equivalent current at mid-height.

    Parameters
    ----------
    length : along the track, m
    width : across it, in the coil's own plane, m
    current : of one turn, A
    turns : how many
    lateral, height : of its centre from the magnet's near side and bottom face, m
    roll : of its plane about x (y towards z), rad; 0 lies flat, pi/2 stands upright
    forward : of its centre, m; a set of coils must look the same forwards and backwards

    Raises
    ------
    ValueError : a size that is not positive, or a number that is not finite

    Examples
    --------
    >>> RectangularCoil(length=0.0508, width=0.0254, current=6000.0, lateral=0.0127, height=0.003175).ampere_turns
    6000.0
    """

    length: float
    width: float
    current: float
    turns: float = 1.0
    lateral: float = 0.0
    height: float = 0.0
    roll: float = 0.0
    forward: float = 0.0

    def __post_init__(self) -> None:
        for name in ("length", "width", "turns"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise ValueError(f"{name}: expected a positive number, got {value}")
        for name in ("current", "lateral", "height", "roll", "forward"):
            if not np.isfinite(getattr(self, name)):
                raise ValueError(f"{name}: expected a finite number, got {getattr(self, name)}")
        if self.current == 0.0:
            raise ValueError("current: expected a current other than zero, got 0: no current, no force")

    @property
    def ampere_turns(self) -> float:
        """Current times turns, A."""
        return self.current * self.turns

    def sides(self, gap: float, height: float) -> FloatArray:
        """Where its two long sides pass through the cross-section when the magnet is at a gap and height; (2, 2) m."""
        centre = np.array([gap + self.lateral, height + self.height])
        half = 0.5 * self.width * np.array([np.cos(self.roll), np.sin(self.roll)])
        return np.stack([centre - half, centre + half])


def coil_groups(coils: Sequence[RectangularCoil]) -> tuple[CoilGroup, ...]:
    """Coils that share one line in the cross-section, so that they differ along the track only.

    Raises
    ------
    ValueError : no coil, or a set that is not the same forwards and backwards
    """
    if not coils:
        raise ValueError("coils: expected at least one coil, got none")
    groups: dict[tuple[float, ...], list[RectangularCoil]] = {}
    for coil in coils:
        groups.setdefault((coil.lateral, coil.height, coil.width, coil.roll), []).append(coil)
    found = tuple(CoilGroup(tuple(members)) for members in groups.values())
    for group in found:
        group.require_symmetry()
    return found


@dataclass(frozen=True, eq=False)
class CoilGroup:
    """Coils on one line of the cross-section."""

    coils: tuple[RectangularCoil, ...]

    def require_symmetry(self) -> None:
        """Refuse a row of coils that does not look the same forwards and backwards."""
        places = {(round(c.forward, 12), c.length): 0.0 for c in self.coils}
        for coil in self.coils:
            places[round(coil.forward, 12), coil.length] += coil.ampere_turns
        for (forward, length), current in places.items():
            mirror = places.get((round(-forward, 12), length), 0.0)
            if abs(mirror - current) > 1e-9 * abs(current):
                raise ValueError(
                    f"forward: expected coils that look the same forwards and backwards; the one at {forward:g} m "
                    f"with {current:g} A has {mirror:g} A opposite, at {-forward:g} m"
                )

    @cached_property
    def extent(self) -> float:
        """From the middle to the farthest end along the track, m."""
        return max(abs(c.forward) + 0.5 * c.length for c in self.coils)

    def transform(self, wavenumber: FloatArray) -> FloatArray:
        """Ampere-turns transformed along the track, X(k) = sum of I Int e^{-ikx} dx, A m; real by symmetry."""
        k = np.asarray(wavenumber, dtype=np.float64)
        return np.asarray(
            sum(c.ampere_turns * c.length * np.sinc(0.5 * k * c.length / np.pi) * np.cos(k * c.forward)
                for c in self.coils)
        )  # fmt: skip

    def line(self, gap: float, height: float, points: int, *, pivot: FloatArray | None = None) -> CoilLine:
        """Quadrature along the coil's line in the cross-section; `pivot` (2,) m is where the magnet turns about, by
        default the line's middle."""
        coil = self.coils[0]
        start, end = coil.sides(gap, height)
        x, w = np.polynomial.legendre.leggauss(points)
        places = start[:, None] + 0.5 * (x + 1.0) * (end - start)[:, None]
        lever = places - (0.5 * (start + end) if pivot is None else pivot)[:, None]
        normal = np.array([-np.sin(coil.roll), np.cos(coil.roll)])
        return CoilLine(places=places, lever=lever, weights=0.5 * w * coil.width, normal=normal)


@dataclass(frozen=True, eq=False, slots=True)
class CoilLine:
    """Dipoles along a coil's line: `places`, `lever` from the turning point (2, l) m, `weights` (l,), `normal` (2,)."""

    places: FloatArray
    lever: FloatArray
    weights: FloatArray
    normal: FloatArray


def line_points(group: CoilGroup, gap: float, height: float, samples: FloatArray) -> int:
    """Gauss points along a coil's line for a relative error of about 1e-10 at the samples (2, m)."""
    start, end = group.coils[0].sides(gap, height)
    half = 0.5 * (end - start)
    # The integrand's poles lie off the line where the samples do; Gauss converges as the ellipse through the nearest.
    across = (samples - 0.5 * (start + end)[:, None]) / np.hypot(*half)
    pole = (half @ across + 1j * (half[0] * across[1] - half[1] * across[0])) / np.hypot(*half)
    root = np.sqrt(pole * pole - 1.0)
    ellipse = float(np.min(np.maximum(np.abs(pole + root), np.abs(pole - root))))
    return int(np.clip(np.ceil(np.log(1e10) / (2.0 * np.log(ellipse))), 6, 400))


def dipole_potential(wavenumbers: FloatArray, points: FloatArray, line: CoilLine, *, order: int) -> FloatArray:
    """Omega / X(k) of a coil at points off its line, with its first and second derivatives by the coil's own motion.

    Parameters
    ----------
    wavenumbers : (n,) 1/m
    points : (2, m) m
    order : of the derivatives wanted, 0 to 2

    Returns
    -------
    (1, 4 or 10, n, m) : value; sway, heave, roll; sway-sway, sway-heave, sway-roll, heave-heave, heave-roll, roll-roll
    """
    offset = points[:, :, None] - line.places[:, None, :]
    dy, dz = offset
    square = dy * dy + dz * dz
    k = wavenumbers[:, None, None]
    argument = k * np.sqrt(square)
    # (1/r d/dr)^j K0(kr) = (-1)^j k^j K_j(kr) / r^j
    bessel_1 = k1(argument)
    f1 = -(k * k) * bessel_1 / argument
    bessel_2 = k0(argument) + 2.0 * bessel_1 / argument if order else bessel_1
    f2 = k**4 * bessel_2 / argument**2
    f3 = -(k**6) * (bessel_1 + 4.0 * bessel_2 / argument) / argument**3 if order >= 2 else f2
    n_y, n_z = line.normal
    # d n / d roll is minus the tangent, and the tangent is the normal turned back.
    t_y, t_z = n_z, -n_y
    r_y, r_z = line.lever
    along, across = n_y * dy + n_z * dz, t_y * dy + t_z * dz

    def hessian(a: tuple[FloatArray, FloatArray], b: tuple[FloatArray, FloatArray]) -> FloatArray:
        """a . grad grad G . b"""
        return np.asarray((a[0] * b[0] + a[1] * b[1]) * f1 + (a[0] * dy + a[1] * dz) * (b[0] * dy + b[1] * dz) * f2)

    def third(
        a: tuple[FloatArray, FloatArray], b: tuple[FloatArray, FloatArray], c: tuple[FloatArray, FloatArray]
    ) -> FloatArray:
        ad, bd, cd = (v[0] * dy + v[1] * dz for v in (a, b, c))
        ab, ac, bc = a[0] * b[0] + a[1] * b[1], a[0] * c[0] + a[1] * c[1], b[0] * c[0] + b[1] * c[1]
        return np.asarray((ab * cd + ac * bd + bc * ad) * f2 + ad * bd * cd * f3)

    one, zero = np.ones_like(r_y), np.zeros_like(r_y)
    normal = (n_y * one, n_z * one)
    turned = (-t_y * one, -t_z * one)
    sway, heave, roll = (one, zero), (zero, one), (-r_z, r_y)
    inward = (-r_y, -r_z)
    parts = [-along * f1]
    if order >= 1:
        parts += [hessian(normal, sway), hessian(normal, heave), across * f1 + hessian(normal, roll)]
    if order >= 2:
        parts += [
            -third(normal, sway, sway),
            -third(normal, sway, heave),
            hessian(turned, sway) - third(normal, sway, roll),
            -third(normal, heave, heave),
            hessian(turned, heave) - third(normal, heave, roll),
            along * f1 + 2.0 * hessian(turned, roll) + hessian(normal, inward) - third(normal, roll, roll),
        ]
    return np.stack([part @ line.weights for part in parts]) / (2.0 * np.pi)
