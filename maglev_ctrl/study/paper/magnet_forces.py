"""Figs. 3 and 4: lift and guidance of one magnet and their stiffnesses over height and gap, and their extremes.

Computed, not measured: the paper's curves are lost.
"""

from __future__ import annotations

from typing import Final, Literal

import numpy as np
from scipy.optimize import brentq

from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.forces import AbstractForceModel
from maglev_ctrl.study.paper.records import DataTable, Extreme

SPEED: Final = 36.1  # m/s, the surface speed of the wheel in the tests
GAPS: Final = (5e-3, 12.7e-3)  # of the curves over height, m
HEIGHTS: Final = (7e-3, 12.7e-3)  # of the curves over the gap, m
POINTS: Final = 181
SCAN: Final = 721


def force_tables(
    force: AbstractForceModel, *, heights: tuple[float, float], gaps: tuple[float, float]
) -> tuple[DataTable, ...]:
    """The four tables behind Figs. 3 and 4: over height at each of GAPS, over the gap at each of HEIGHTS.

    Parameters
    ----------
    heights, gaps : ranges of the curves, m
    """
    tables = []
    columns = ("F_L (N)", "F_G (N)", "F_D (N)", "k_ll (N/m)", "k_lg (N/m)", "k_gl (N/m)", "k_gg (N/m)")
    for gap in GAPS:
        h = np.linspace(*heights, POINTS)
        rows = np.column_stack([1e3 * h, _quantities(force, h, np.full_like(h, gap))])
        tables.append(DataTable(f"fig03_04_over_height_gap_{_tag(gap)}", ("h (mm)", *columns), read_only_any(rows)))
    for height in HEIGHTS:
        g = np.linspace(*gaps, POINTS)
        rows = np.column_stack([1e3 * g, _quantities(force, np.full_like(g, height), g)])
        tables.append(DataTable(f"fig03_04_over_gap_height_{_tag(height)}", ("Y* (mm)", *columns), read_only_any(rows)))
    return tuple(tables)


def _tag(length: float) -> str:
    return f"{1e3 * length:g}mm".replace(".", "p")


def _quantities(force: AbstractForceModel, height: FloatArray, gap: FloatArray) -> FloatArray:
    forces, slopes = force.forces(height, gap, SPEED), force.derivatives(height, gap, SPEED)
    return np.column_stack([
        forces.lift, forces.guidance, forces.drag, slopes.by_height.lift, slopes.by_gap.lift,
        slopes.by_height.guidance, slopes.by_gap.guidance,
    ])  # fmt: skip


def guidance_extreme(
    force: AbstractForceModel, along: Literal["height", "gap"], fixed: float, *, low: float, high: float,
    speed: float = SPEED,
    scan: int = SCAN,
) -> Extreme:  # fmt: skip
    """The maximum of guidance over height, or its minimum over the gap, by the zero of its slope.

    Parameters
    ----------
    along : what varies
    fixed : the other of height and gap, m
    low, high : range in which it is looked for, m
    speed : m/s
    scan : points of the first look

    Examples
    --------
    >>> from maglev_ctrl.forces import CornerImageForce
    >>> coil = CornerImageForce(6000.0, length=50.8e-3, width=25.4e-3, thickness=6.35e-3)
    >>> round(1e3 * guidance_extreme(coil, "height", 12.7e-3, low=5e-3, high=50e-3).at, 2)
    16.89
    """
    kind: Literal["maximum", "minimum"] = "maximum" if along == "height" else "minimum"

    def place(x: FloatArray | float) -> tuple[FloatArray, FloatArray]:
        values = np.asarray(x, dtype=np.float64)
        other = np.full_like(values, fixed)
        return (values, other) if along == "height" else (other, values)

    def slope(x: FloatArray | float) -> FloatArray:
        found = force.derivatives(*place(x), speed)
        return found.by_height.guidance if along == "height" else found.by_gap.guidance

    grid = np.linspace(low, high, scan)
    values = slope(grid)
    falls = values[:-1] > 0.0 if kind == "maximum" else values[:-1] < 0.0
    turns = np.flatnonzero(falls & (np.sign(values[:-1]) != np.sign(values[1:])))
    if not turns.size:
        return Extreme(kind, along, fixed, float("nan"), float("nan"))
    first = int(turns[0])
    at = float(brentq(lambda x: float(slope(x)), grid[first], grid[first + 1], xtol=1e-12))
    return Extreme(kind, along, fixed, at, float(force.forces(*place(at), speed).guidance))


def guidance_extremes(
    force: AbstractForceModel,
    *,
    heights: tuple[float, float],
    gaps: tuple[float, float],
    speed: float = SPEED,
    scan: int = SCAN,
) -> tuple[Extreme, ...]:
    """The four extremes of the paper's Figs. 3e to 3h: maxima over height, then minima over the gap."""
    up = [
        guidance_extreme(force, "height", gap, low=heights[0], high=heights[1], speed=speed, scan=scan) for gap in GAPS
    ]
    out = [
        guidance_extreme(force, "gap", height, low=gaps[0], high=gaps[1], speed=speed, scan=scan) for height in HEIGHTS
    ]
    return (*up, *out)


def reciprocity_residual(
    force: AbstractForceModel, *, heights: tuple[float, float], gaps: tuple[float, float]
) -> float:
    """Largest |k_lg - k_gl| over a grid of states, as a share of the largest |k_ll| there."""
    h, g = np.meshgrid(np.linspace(*heights, 25), np.linspace(*gaps, 25))
    slopes = force.derivatives(h, g, SPEED)
    difference = np.abs(slopes.by_gap.lift - slopes.by_height.guidance)
    return float(np.max(difference) / np.max(np.abs(slopes.by_height.lift)))
