"""Fig. 11: mode shapes of the double-L vehicle as small drawings that a script on the page sets in motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from maglev_ctrl.report.style import number
from maglev_ctrl.study.paper.records import ModeTable
from maglev_ctrl.vehicle.models import double_l_geometry

GAP: Final = 12.7e-3
LARGEST: Final = 11.0  # mm: displacement of a magnet in the drawing
_MAGNET: Final = (25.4, 6.35)  # mm, width and height
_LEG, _THICK = 69.85, 6.35
_NAMES: Final = ("heave mode", "second mode", "third mode")


@dataclass(frozen=True, slots=True)
class Drawing:
    """One mode: what is drawn at rest and moved, and the motion (heave mm, roll rad, sway mm) as complex amplitudes.

    `kind` is "stable", "flutter" or "divergence"; `label` names the drawing for those who do not see it.
    """

    title: str
    label: str
    kind: str
    height: float
    motion: tuple[complex, complex, complex]
    growth: float

    @property
    def still(self) -> str:
        """SVG transform of the moved vehicle at the instant of the mode vector itself."""
        return _transform(*(value.real for value in self.motion))

    @property
    def later(self) -> str:
        """SVG transform a quarter of a period later; the same place where all parts move in phase."""
        return _transform(*(-value.imag for value in self.motion))

    @property
    def turns(self) -> bool:
        """Whether parts of the vehicle move out of phase."""
        return max(abs(value.imag) for value in self.motion) > 1e-6

    @property
    def body(self) -> tuple[float, float, float, float]:
        """x, y, width, height of the body in mm, centre of mass at the origin, y down as SVG has it."""
        width, body, _, _ = double_l_geometry(GAP)
        return -500.0 * width, -500.0 * body, 1e3 * width, 1e3 * body

    @property
    def magnets(self) -> tuple[tuple[float, float, float, float], ...]:
        """The two magnets."""
        _, _, a, b = double_l_geometry(GAP)
        return tuple(
            (side * 1e3 * b - 0.5 * _MAGNET[0], 1e3 * a - _MAGNET[1], *_MAGNET) for side in (-1.0, 1.0)
        )  # fmt: skip

    @property
    def guideways(self) -> tuple[str, ...]:
        """Outlines of the two L-shaped guideways as SVG points."""
        width = double_l_geometry(GAP)[0]
        wall, floor = 500.0 * width + 1e3 * GAP, 1e3 * double_l_geometry(GAP)[2] + self.height
        outlines = []
        for side in (-1.0, 1.0):
            points = [
                (wall - _LEG, floor), (wall, floor), (wall, floor - _LEG), (wall + _THICK, floor - _LEG),
                (wall + _THICK, floor + _THICK), (wall - _LEG, floor + _THICK),
            ]  # fmt: skip
            outlines.append(" ".join(f"{side * x:.2f},{y:.2f}" for x, y in points))
        return tuple(outlines)

    @property
    def view(self) -> str:
        """SVG view box with room for the motion."""
        wall, top = 500.0 * double_l_geometry(GAP)[0] + 1e3 * GAP + _THICK, 1e3 * double_l_geometry(GAP)[2]
        margin = LARGEST + 4.0
        bottom = top + self.height + _THICK
        return f"{-wall - 4:.1f} {-top - margin:.1f} {2 * wall + 8:.1f} {top + bottom + margin + 4:.1f}"


def drawings(table: ModeTable) -> tuple[Drawing, ...]:
    """The three modes of one height and model.

    Parameters
    ----------
    table : mode vectors in the paper's coordinates

    Examples
    --------
    >>> vectors = np.array([[1, 1, 1], [1, -1, -1], [0, 0, 1]], dtype=complex)
    >>> made = drawings(ModeTable(0.015, "P", np.array([100.0, -4.0, 9.0 + 1j]), vectors))
    >>> [one.kind for one in made]
    ['stable', 'divergence', 'flutter']
    """
    _, _, _, b = double_l_geometry(GAP)
    made = []
    for k, name in enumerate(_NAMES):
        v1, v2, v3 = (complex(entry) for entry in table.vectors[:, k])
        square = complex(table.squared[k])
        kind = "flutter" if abs(square.imag) > 0.0 else "divergence" if square.real < 0.0 else "stable"
        omega = np.sqrt(square)
        scale = LARGEST / max(abs(v1), abs(v2), abs(v3))
        motion = (0.5 * scale * (v1 + v2), scale * (v1 - v2) / (2e3 * b), scale * v3)
        words = {
            "stable": f"{number(abs(omega.real) / (2 * np.pi), 'Hz')}",
            "flutter": f"{number(abs(omega.real) / (2 * np.pi), 'Hz')}, flutter",
            "divergence": f"divergence, {number(abs(omega.imag), '1/s')}",
        }[kind]
        title = f"{name}: {words}"
        label = f"h = {1e3 * table.height:g} mm, model {table.model}, {title}"
        growth = float(abs(omega.imag) / abs(omega.real)) if kind == "flutter" else 0.0
        made.append(Drawing(title, label, kind, 1e3 * table.height, motion, growth))
    return tuple(made)


def _transform(heave: float, roll: float, sway: float) -> str:
    """Sway to the right and heave up; side 1 is drawn on the right, and roll raises it."""
    return f"translate({sway:.3f} {-heave:.3f}) rotate({-np.degrees(roll):.4f})"
