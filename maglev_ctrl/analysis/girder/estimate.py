"""Peaks of span passing from the first harmonics alone: for search loops and scans, where a bound is not asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from math import pi
from typing import Final

import numpy as np

from maglev_ctrl.analysis.girder.passing import driven_system
from maglev_ctrl.analysis.girder.shapes import PieceShape
from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only_any
from maglev_ctrl.systems import SecondOrderSystem

TIMES: Final = 384
"""Places of one span at which the motion is looked at."""


def passing_estimate(
    closed: SecondOrderSystem,
    shape: PieceShape,
    *,
    speed: float,
    places: Mapping[str, float],
    outputs: Sequence[str],
    harmonics: int = 32,
) -> FloatArray:
    """Largest modulus of every output over one period, by the first harmonics at even places; (outputs,).

    What is left out of the vehicle's motion is not bounded: `passing_response` is the exact one. The shape that an
    output feels directly (a gap) is not cut short, and peaks between the places are counted by half a step.

    Parameters
    ----------
    speed : m/s
    places, outputs : see `passing_response`
    harmonics : how many

    Raises
    ------
    NotStable : the loop has a root that does not decay
    ValueError : see `passing_response`

    Examples
    --------
    >>> from maglev_ctrl.vehicle.guideway_sources import girder_bow
    >>> car = SecondOrderSystem.from_matrices([[1e3]], [[4e3]], [[4e4]], dofs=("z",), guideway=("heave@m",),
    ...                                       K_w=[[4e4]], C_w=[[4e3]])
    >>> sag = PieceShape.from_source(girder_bow("girder", span=25.0, rise=-0.004))
    >>> passing_estimate(car, sag, speed=10.0, places={"m": 0.0}, outputs=["z"]).round(5)
    array([0.00282])
    """
    system = driven_system(closed, shape, speed=speed, places=places, outputs=tuple(outputs))
    if not system.shapes:
        return read_only_any(np.zeros(len(system.C)))
    order = np.arange(1, harmonics + 1)
    s = 2j * pi * speed / shape.span * order
    # No lateral shape is given: every input meets the one shape.
    drive = _harmonics(shape, harmonics)[:, None] * np.exp(2j * pi * order[:, None] * system.places / shape.span)
    push = drive @ system.E_w.T + (s[:, None] * drive) @ system.E_v.T
    states = np.linalg.solve(s[:, None, None] * np.eye(len(system.A)) - system.A, push[..., None])[..., 0]
    amplitudes = states @ system.C.T + (s[:, None] * drive) @ system.D_v.T
    mean = -system.C @ np.linalg.solve(system.A, system.E_w @ np.full(len(system.places), shape.mean))
    along = np.arange(TIMES) * (shape.span / TIMES)
    moved = (np.exp(2j * pi / shape.span * along[:, None] * order) @ amplitudes).real
    felt = np.flatnonzero(np.any(system.D_w, axis=0))
    below = np.array([shape.at(along + system.places[i]) for i in felt]).reshape(len(felt), TIMES)
    total = np.abs(mean + moved + below.T @ system.D_w[:, felt].T)
    top, columns = np.argmax(total, axis=0), np.arange(total.shape[1])
    # A peak between two places, a kink too, is no further above the higher one than half a step of the curve there.
    ahead, behind = total[(top + 1) % TIMES, columns], total[top - 1, columns]
    peak = total[top, columns]
    return read_only_any(peak + 0.5 * np.maximum(peak - ahead, peak - behind))


@lru_cache(maxsize=16)
def _harmonics(shape: PieceShape, count: int) -> ComplexArray:
    return shape.harmonics(count)
