"""Peaks of span passing from the first harmonics alone: for search loops and scans, where a bound is not asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import pi

import numpy as np

from maglev_ctrl.analysis.girder.passing import driven_system
from maglev_ctrl.analysis.girder.shapes import PieceShape
from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.systems import SecondOrderSystem


def passing_estimate(
    closed: SecondOrderSystem,
    shape: PieceShape,
    *,
    speed: float,
    places: Mapping[str, float],
    outputs: Sequence[str],
    harmonics: int = 24,
) -> FloatArray:
    """Largest modulus of every output over one period, by the first harmonics on an even grid; (outputs,).

    What is left out is not bounded: `passing_response` is the exact one. An output that feels the shape itself (a gap)
    converges as the shape's own series, for a half sine as 1/harmonics.

    Parameters
    ----------
    speed : m/s
    places, outputs : see `passing_response`
    harmonics : how many; the grid has eight points for the last one

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
    drive = shape.harmonics(harmonics)[:, None] * np.exp(2j * pi * order[:, None] * system.places / shape.span)
    push = drive @ system.E_w.T + (s[:, None] * drive) @ system.E_v.T
    states = np.linalg.solve(s[:, None, None] * np.eye(len(system.A)) - system.A, push[..., None])[..., 0]
    amplitudes = states @ system.C.T + drive @ system.D_w.T + (s[:, None] * drive) @ system.D_v.T
    means = np.array([one.mean for one in system.shapes])
    mean = system.D_w @ means - system.C @ np.linalg.solve(system.A, system.E_w @ means)
    grid = np.exp(2j * pi * order * np.arange(8 * harmonics)[:, None] / (8 * harmonics))
    return read_only_any(np.max(np.abs(mean + (grid @ amplitudes).real), axis=0))
