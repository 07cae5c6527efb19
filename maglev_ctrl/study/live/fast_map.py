"""The unchecked map of an option over speed and depth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from maglev_ctrl.analysis.plane_records import MapAxis, StabilityPlane
from maglev_ctrl.analysis.stability_plane import stability_plane
from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.study.live.designed import Designed
from maglev_ctrl.study.live.records import LiveMap, LiveRegion
from maglev_ctrl.study.situation import Situation
from maglev_ctrl.systems import PeriodicSystem, at_depth

MERGED = "Delay and bandwidth of every actuator are merged into one lag on the map."


def plane_of(
    designed: Designed, situation: Situation, speed: FloatArray, depth: FloatArray, *, checks: int
) -> StabilityPlane:  # fmt: skip
    """The stability plane over speed (m/s) and depth at a situation's height, gap and payload."""
    units: dict[float, PeriodicSystem] = {}

    def family(x: float, y: float) -> PeriodicSystem:
        if x not in units:
            units[x] = designed.periodic(replace(situation, speed=x), 1.0, full=False)
        return at_depth(units[x], y)

    return stability_plane(
        family, MapAxis("speed", speed, reciprocal=True), MapAxis("depth", depth, linear=True), coverage="every",
        threads=2, checks=checks,
    )  # fmt: skip


def map_of(plane: StabilityPlane, *, checked: bool, note: str) -> LiveMap:
    """The page's record of a plane."""
    return LiveMap(
        plane.x.values, plane.y.values, read_only_any(plane.growth.T), read_only_any(plane.state.T), regions(plane),
        checked, note,
    )  # fmt: skip


def regions(plane: StabilityPlane) -> tuple[LiveRegion, ...]:
    """Each named region with the place where it grows fastest."""
    found = []
    for k, tongue in enumerate(plane.tongues):
        inside = np.where(plane.tongue_index == k, plane.growth, -np.inf)
        if np.any(np.isfinite(inside)):
            i, j = np.unravel_index(int(np.argmax(inside)), inside.shape)
            found.append(LiveRegion(tongue.name, float(plane.x.values[i]), float(plane.y.values[j])))
    return tuple(found)
