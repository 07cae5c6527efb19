"""The map of an option over speed and depth: fast and unchecked, or checked by the second engine and named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from maglev_ctrl.analysis.plane_records import MapAxis, StabilityPlane
from maglev_ctrl.analysis.stability_plane import stability_plane
from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.guideway import passing_frequency
from maglev_ctrl.study.live.designed import Designed
from maglev_ctrl.study.live.growth import Columns, Sizes, growth_plane
from maglev_ctrl.study.live.records import LiveMap, LiveRegion
from maglev_ctrl.study.live.speeds import OverSpeed
from maglev_ctrl.study.situation import Situation
from maglev_ctrl.systems import PeriodicSystem, at_depth

MERGED = "Delay and bandwidth of every actuator are merged into one lag on the map."
UNCHECKED = "Not checked yet by the second engine; growth far from zero is interpolated between rows of depth."
NOT_SMOOTH = "The loop is no smooth function of the speed: it is assembled at every speed, which takes longer."


def fast_map(
    designed: Designed, over: OverSpeed, speed: FloatArray, depth: FloatArray, sizes: Sizes
) -> LiveMap:  # fmt: skip
    """The unchecked map over speed (m/s) and depth.

    Parameters
    ----------
    over : the option's loop over speed, at the height, gap and payload looked at
    """
    assert designed.modulation is not None
    wavelength = designed.modulation.wavelength

    def source(speeds: FloatArray) -> Columns:
        here = over.at(speeds)
        return Columns(here.mean, here.cosine, here.sine, np.asarray(passing_frequency(speeds, wavelength)))

    found = growth_plane(source, speed, depth, smooth=over.smooth, sizes=sizes)
    notes = (UNCHECKED, MERGED if designed.merged else "", "" if over.smooth else NOT_SMOOTH)
    return LiveMap(
        read_only_any(speed), read_only_any(depth), read_only_any(found.growth.T), read_only_any(found.state.T), (),
        False, " ".join(note for note in notes if note),
    )  # fmt: skip


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
