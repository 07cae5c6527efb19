"""Rough guideways for the simulation, and the linear theory in the same band."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import ModelError
from maglev_ctrl.guideway.features import GirderSag, Steps
from maglev_ctrl.guideway.profile import ProfileLike, TrackProfile
from maglev_ctrl.guideway.realisation import realisation
from maglev_ctrl.guideway.spectra import Roughness
from maglev_ctrl.scenario.track import track_spectra
from maglev_ctrl.scenario.track_schema import Band, Irregularity
from maglev_ctrl.study.situation import OptionModel
from maglev_ctrl.vehicle import Vehicle

HIGHEST = 50.0
"""Hz: waves met at up to this frequency are in a simulated guideway, where the scenario names no band."""
REPEATS = 6.0
"""A simulated guideway is this many times as long as what a run sees of it, so that its waves stand close."""
POINTS_PER_WAVE = 4.0


@dataclass(frozen=True, eq=False, slots=True)
class Level:
    """The same height everywhere, m."""

    height: float

    def at(self, position: ArrayLike) -> FloatArray:
        """Height (...) m at positions (...) m."""
        return np.full(np.shape(position), self.height)

    def slope(self, position: ArrayLike) -> FloatArray:
        """Slope (...), none."""
        return np.zeros(np.shape(position))


@dataclass(frozen=True, eq=False, slots=True)
class SimulatedTracks:
    """One guideway for each run, and the band (Hz) of what they hold at the speed they were made for."""

    tracks: tuple[TrackProfile, ...]
    band: tuple[float, float]
    words: str


def simulated_tracks(
    model: OptionModel, vehicle: Vehicle, *, speed: float, duration: float, runs: int, seed: int, rough: bool = True
) -> SimulatedTracks:
    """Seeded guideways of the scenario's spectra, with its girders and its step, long enough for a run.

    Parameters
    ----------
    rough : False leaves the random part out

    Raises
    ------
    ModelError : the scenario describes no irregularity
    """
    irregularity = model.scenario.irregularity
    if irregularity is None:
        raise ModelError("the scenario describes no irregularity of the guideway")
    spectra = track_spectra(irregularity)
    reach = [abs(one.position[0]) for one in (*vehicle.magnets, *vehicle.links, *vehicle.sensors)]
    seen = speed * duration + 2.0 * max(reach, default=0.0) + 10.0
    given = irregularity.band
    highest = HIGHEST if given is None else given.high / (2.0 * np.pi)
    step = speed / (POINTS_PER_WAVE * highest)
    count = int(np.ceil(REPEATS * seen / step))
    length = count * step
    lowest = speed / length if given is None else max(given.low / (2.0 * np.pi), speed / length)
    wave_band = (2.0 * np.pi * lowest / speed, 2.0 * np.pi * highest / speed)

    def sample(roughness: Roughness | None, run: int, part: int) -> tuple[ProfileLike, ...]:
        if roughness is None or not rough:
            return ()
        number = 3 * (seed + run) + part
        made = realisation(roughness, length=length, step=step, seed=number, band=wave_band)
        # A vehicle starts on its guideway, wherever that stands: heights count from the place where it starts.
        return (made, Level(-float(made.at(0.0))))

    fixed = _features(irregularity, speed, duration)
    tracks = tuple(
        TrackProfile(
            vertical=(*sample(spectra.vertical, run, 0), *fixed),
            lateral=sample(spectra.lateral, run, 1),
            cross_level=sample(spectra.cross_level, run, 2),
        )
        for run in range(runs)
    )
    words = f"waves met at {lowest:.3g} to {highest:.3g} Hz, seeds {seed} to {seed + runs - 1}"
    return SimulatedTracks(tracks, (lowest, highest), words)


def in_band(model: OptionModel, band: tuple[float, float]) -> OptionModel:
    """The model with its irregularity limited to a band (Hz): what the linear theory is compared in."""
    scenario = model.scenario
    irregularity = scenario.irregularity
    if irregularity is None:
        raise ModelError("the scenario describes no irregularity of the guideway")
    limited = Band.model_construct(low=2.0 * np.pi * band[0], high=2.0 * np.pi * band[1])
    girderless = irregularity.model_copy(update={"band": limited, "girder": None, "step": None})
    return replace(model, scenario=scenario.model_copy(update={"irregularity": girderless}))


def _features(irregularity: Irregularity, speed: float, duration: float) -> tuple[GirderSag | Steps, ...]:
    found: list[GirderSag | Steps] = []
    girder, step = irregularity.girder, irregularity.step
    if girder is not None and girder.sag > 0.0:
        found.append(GirderSag(girder.span, rise=-girder.sag))
    if step is not None:
        place, height = np.array([0.5 * speed * duration]), np.array([step.height])
        found.append(Steps(place, heights=height, ramp=step.ramp))
    return tuple(found)
