"""Floquet exponents of a family of two quantities read from its monodromy matrix as verified Chebyshev panels.

For searches, not for verdicts: an exponent read here costs a hundredth of an integrated one and is as good as the
panels' tolerance. What a search finds is polished on integrated exponents and verified by both engines.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from maglev_ctrl.analysis.plane_panels import Panel, build_panels
from maglev_ctrl.analysis.plane_records import MapAxis, PeriodicFamily
from maglev_ctrl.analysis.smooth_path import SmoothPath
from maglev_ctrl.analysis.stability_plane import NothingKept
from maglev_ctrl.analysis.tongue_search import Path, exponents_of, to_exponents
from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.errors import ModelError, OutOfDomain
from maglev_ctrl.systems import at_depth

_ROWS = 1024  # places at which panels may be cut; between two of them exponents are integrated
_COLUMNS = 16
_SHALLOW = 8  # where the second quantity is linear the whole range is one panel as a rule


@dataclass(frozen=True, eq=False, slots=True)
class ExponentSurface:
    """Exponents over `x` and `y`: from `panels` where the monodromy matrix is a series, integrated elsewhere."""

    family: PeriodicFamily
    x: MapAxis
    y: MapAxis
    panels: tuple[Panel, ...]

    @classmethod
    def of(
        cls, family: PeriodicFamily, x: tuple[float, float], y: tuple[float, float], *, linear: bool
    ) -> ExponentSurface:
        """The surface over two ranges.

        Parameters
        ----------
        family : the system at (x, y); ModelError and OutOfDomain mean "no answer there"
        x : lower, upper, positive; a quantity to which the passing frequency is proportional, or nearly so
        y : lower, upper
        linear : whether y is a depth: it scales the modulation and does nothing else

        Examples
        --------
        >>> from maglev_ctrl.systems import PeriodicSystem
        >>> def mathieu(W, depth):
        ...     return PeriodicSystem.from_matrices([[0, 1], [-1, 0]], [[[0, 0], [-depth, 0]]], frequency=W)
        >>> surface = ExponentSurface.of(mathieu, (1.5, 2.5), (0.0, 0.5), linear=True)
        >>> exponents, frequency = surface.exponents(np.array([2.0]), np.array([0.4]))
        >>> round(float(np.max(exponents.real)), 9), round(float(frequency[0]), 9)
        (0.099536437, 2.0)
        """
        along_x = MapAxis("x", np.linspace(*x, _ROWS), reciprocal=True)
        along_y = MapAxis("y", np.linspace(*y, _SHALLOW if linear else _COLUMNS), linear=linear)
        panels = build_panels(family, along_x, along_y, store=NothingKept(), prefix="")
        return cls(family, along_x, along_y, tuple(one for one in panels if one.series is not None))

    def exponents(self, x: FloatArray, y: FloatArray) -> tuple[ComplexArray, FloatArray] | None:
        """Exponents (P, n) 1/s, imaginary parts modulo W, and passing frequencies W (P,) at pairs of x, y (P,).

        None where one of the pairs has no answer.
        """
        groups: dict[int, list[int]] = {}
        for k, (a, b) in enumerate(zip(x, y, strict=True)):
            groups.setdefault(self._panel_at(float(a), float(b)), []).append(k)
        found: ComplexArray | None = None
        frequency = np.empty(len(x))
        for index, members in groups.items():
            part = self._read(index, x[members], y[members])
            if part is None or (found is not None and part[0].shape[1] != found.shape[1]):
                return None
            if found is None:
                found = np.empty((len(x), part[0].shape[1]), dtype=np.complex128)
            found[members], frequency[members] = part
        return None if found is None else (found, frequency)

    def _panel_at(self, x: float, y: float) -> int:
        """Which panel holds a point; -1: none."""
        for k, panel in enumerate(self.panels):
            assert panel.series is not None
            along_x, along_y = panel.series.x, panel.series.y
            if along_x.lower <= x <= along_x.upper and along_y.lower <= y <= along_y.upper:
                return k
        return -1

    def _read(self, index: int, x: FloatArray, y: FloatArray) -> tuple[ComplexArray, FloatArray] | None:
        if index < 0:
            try:
                systems = [self.family(float(a), float(b)) for a, b in zip(x, y, strict=True)]
            except (ModelError, OutOfDomain):
                return None
            if len({(one.A_0.shape, one.A_cos.shape) for one in systems}) != 1:
                return None
            return exponents_of(systems), np.array([float(one.frequency) for one in systems])
        panel = self.panels[index]
        assert panel.series is not None and panel.period is not None
        frequency = 2.0 * np.pi / panel.period.points(x, y)
        multipliers = np.linalg.eigvals(panel.series.points(x, y)).astype(np.complex128)
        return to_exponents(multipliers, frequency), frequency


@dataclass(frozen=True, eq=False, slots=True)
class SpeedSurface:
    """A path of periodic systems at unit depth from `lower` to `upper`, made `smooth`, and its exponents at any depth
    up to `largest_depth`."""

    smooth: SmoothPath
    surface: ExponentSurface
    largest_depth: float

    @classmethod
    def of(cls, path: Path, *, lower: float, upper: float, largest_depth: float) -> SpeedSurface:
        """The surface of a path.

        Parameters
        ----------
        path : speed -> system at unit depth; ModelError and OutOfDomain mean "no answer there"
        lower, upper : m/s, positive
        largest_depth : positive

        Raises
        ------
        ValueError : limits that are not positive and ascending

        Examples
        --------
        >>> from maglev_ctrl.systems import PeriodicSystem
        >>> path = lambda v: PeriodicSystem.from_matrices([[0, 1], [-1, 0]], [[[0, 0], [-1, 0]]], frequency=2.0 * v)
        >>> surface = SpeedSurface.of(path, lower=0.5, upper=1.5, largest_depth=0.5)
        >>> round(float(np.max(surface.at(0.4)(1.0).real)), 9)
        0.099536437
        """
        if not (0.0 < lower < upper < np.inf and 0.0 < largest_depth < np.inf):
            raise ValueError(
                f"speeds, largest depth: expected 0 < lower < upper and a positive depth, got {lower:g}, {upper:g}, "
                f"{largest_depth:g}"
            )
        smooth = SmoothPath(path, lower, upper)
        family = ExponentSurface.of(
            lambda v, depth: at_depth(smooth(v), depth), (lower, upper), (0.0, largest_depth), linear=True
        )
        return cls(smooth, family, largest_depth)

    def exponents(self, speeds: FloatArray, depths: FloatArray) -> tuple[ComplexArray, FloatArray] | None:
        """Exponents (P, n) 1/s and passing frequencies (P,) rad/s, see `ExponentSurface.exponents`."""
        return self.surface.exponents(speeds, depths)

    def at(self, depth: float) -> Callable[[float], ComplexArray | None]:
        """speed -> exponents (n,) at a depth; None where the model has no answer."""

        def read(speed: float) -> ComplexArray | None:
            found = self.surface.exponents(np.array([speed]), np.array([depth]))
            return None if found is None else found[0][0]

        return read

    def over(self, depth: float) -> Callable[[FloatArray], tuple[ComplexArray, FloatArray] | None]:
        """speeds (P,) -> exponents (P, n) 1/s and passing frequencies (P,) at a depth; None where one has no answer."""
        return lambda speeds: self.surface.exponents(speeds, np.full(len(speeds), depth))
