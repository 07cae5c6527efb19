"""`simulate`: one call from a vehicle, its law and a track to the trajectories of many runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from numpy.typing import ArrayLike

from maglev_ctrl.analysis.simulation.records import Limits, Track, Trajectory
from maglev_ctrl.guideway import Modulation
from maglev_ctrl.systems import Controller
from maglev_ctrl.vehicle import Equilibrium, Vehicle

STEP_TOLERANCE = 1e-4
"""Largest `step_error` that is accepted before the step is halved again."""


def simulate(
    vehicle: Vehicle,
    equilibrium: Equilibrium,
    *,
    duration: float,
    controller: Controller | None = None,
    track: Track | Sequence[Track] | None = None,
    modulation: Modulation | None = None,
    start: Mapping[str, ArrayLike] | None = None,
    runs: int = 1,
    seed: int = 0,
    limits: Limits | None = None,
    sampling: float = 0.004,
    computation: float = 0.0,
    noise: bool = True,
    signals: Sequence[str] | None = None,
    step: float | None = None,
) -> Trajectory:
    """The nonlinear motion of a vehicle about an equilibrium, many runs at a time.

    Parameters
    ----------
    duration : s
    controller : continuous, or sampled (`dt`): then its commands are held from sample to sample
    track : one for all runs or one for each; the place x = 0 is under the vehicle's origin at time 0
    modulation : of the magnets' stiffness along the track, as in `vehicle.stiffness_modulation`
    start : initial states by name as in `linearize(...).states`, increments from the equilibrium; a number or (runs,)
    runs : how many
    seed : of the sensors' noise, with the run's number
    sampling : s between samples that are kept; with a sampled law a whole multiple or a whole part of its period
    computation : s from a sample to the command that follows from it
    noise : whether sensors have theirs
    signals : which to keep; all of `Trajectory.signals` when left out
    step : s, largest; from the fastest pole of the linear model when left out

    Raises
    ------
    ValueError : a name that is unknown, a number out of range, sampling that does not fit the law's period
    OutOfDomain : the start itself is outside a force model's data
    """
    raise NotImplementedError
