"""What the response to a random guideway is told by."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.display import Shown
from maglev_ctrl.errors import Agreement

ClearanceKind = Literal["gap", "stroke"]


@dataclass(frozen=True, eq=False, slots=True)
class SignalStatistics:
    """Standard deviation of one signal by two methods; `deviation` is NaN where they do not agree.

    `by_lyapunov` is exact (covariance equations), `by_frequency` an adaptive integral over frequency, both in the
    signal's SI `unit`; `difference` is relative. `rate` is the standard deviation of the time derivative (NaN where
    that has none), for crossing rates.
    """

    name: str
    unit: str
    deviation: float
    by_lyapunov: float
    by_frequency: float
    difference: float
    rate: float
    agreement: Agreement
    reason: str


@dataclass(frozen=True, eq=False, slots=True)
class PassengerRide:
    """Ride of one passenger position: `x`, `y` from the car's centre of mass, m.

    `weighted` are the frequency-weighted r.m.s. accelerations (m/s^2) by axis, `axes` their names ("vertical",
    "lateral", ...), `total` the vector sum with the standard's factors, `comfort` the standard's words.
    """

    name: str
    x: float
    y: float
    axes: tuple[str, ...]
    weighted: FloatArray
    unweighted: FloatArray  # m/s^2, NaN where infinite
    total: float
    comfort: str
    agreement: Agreement
    reason: str


@dataclass(frozen=True, eq=False, slots=True)
class ClearanceStatistics:
    """A gap or a stroke: how near it comes to its end.

    `nominal` (m) at equilibrium, `clearance` (m) the distance it may use up, `sag` (m) what the periodic part of the
    guideway uses up already. `three_sigma` (m); `crossing_rate` (1/s) of one end by Rice's formula, the distance to it
    being the clearance less the sag; `contact_per_hour` the probability of at least one contact in an hour (Poisson):
    at one end for a gap, at either for a stroke.
    """

    name: str
    kind: ClearanceKind
    nominal: float
    clearance: float
    sag: float
    deviation: float
    three_sigma: float
    used: float  # (three_sigma + sag) / clearance
    crossing_rate: float
    contact_per_hour: float
    agreement: Agreement
    reason: str


@dataclass(frozen=True, eq=False, slots=True)
class ActuatorDemand:
    """What one actuator has to give: standard deviations of force (N), its rate (N/s) and stroke velocity (m/s).

    `mean_power` (W) is the mean mechanical power given to the vehicle (negative: taken from it), `supplied_power` the
    mean of its positive part, which a supply without recuperation must give; `energy_per_hour` (J) of that.
    `saturated` is the share of time at which the linear force would exceed the `limit` (N; NaN without a limit).
    """

    name: str
    force: float
    rate: float
    velocity: float
    mean_power: float
    supplied_power: float
    energy_per_hour: float
    limit: float
    three_sigma_share: float  # 3 sigma of the force over the limit
    saturated: float
    agreement: Agreement
    reason: str


@dataclass(frozen=True, eq=False, slots=True)
class AccelerationSpectrum:
    """One-sided power spectral density of a passenger's acceleration, (m/s^2)^2/Hz over `frequency` (Hz)."""

    passenger: str
    axis: str
    frequency: FloatArray
    density: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class PsdMask:
    """Highest allowed power spectral density of an acceleration, straight between its points on logarithmic axes.

    Parameters
    ----------
    name : what it is called
    axis : the axis it is for, "vertical" or "lateral"
    frequency : (n,) Hz, increasing, at least two
    density : (n,) (m/s^2)^2/Hz, one-sided, positive
    source : where the numbers come from

    Raises
    ------
    ValueError : fewer than two points, frequencies that do not increase, or a number that is not positive

    Examples
    --------
    >>> mask = PsdMask("flat", "vertical", [1.0, 10.0], [1e-2, 1e-4])
    >>> round(float(mask.at(np.array([10.0**0.5]))[0]), 9)
    0.001
    """

    name: str
    axis: str
    frequency: ArrayLike
    density: ArrayLike
    source: str = ""

    def __post_init__(self) -> None:
        points = read_only(self.frequency, name=f"mask {self.name}: frequency", shape=(None,))
        levels = read_only(self.density, name=f"mask {self.name}: density", shape=points.shape)
        if points.ndim != 1 or points.size < 2 or points[0] <= 0.0 or np.any(np.diff(points) <= 0.0):
            raise ValueError(
                f"mask {self.name}: frequency: expected two or more positive frequencies in Hz that increase, got "
                f"{points.tolist()}"
            )
        if np.any(levels <= 0.0):
            raise ValueError(f"mask {self.name}: density: expected positive densities, got {levels.tolist()}")
        object.__setattr__(self, "frequency", points)
        object.__setattr__(self, "density", levels)

    def at(self, frequency: FloatArray) -> FloatArray:
        """Allowed densities at frequencies (...) Hz; NaN outside the mask."""
        inside = np.log(np.asarray(frequency, dtype=np.float64))
        points, levels = (np.log(np.asarray(part, dtype=np.float64)) for part in (self.frequency, self.density))
        found = np.exp(np.interp(inside, points, levels))
        outside = (inside < points[0] - 1e-12) | (inside > points[-1] + 1e-12)
        return np.asarray(np.where(outside, np.nan, found))


@dataclass(frozen=True, eq=False, slots=True)
class MaskResult:
    """How near a passenger's acceleration comes to a mask: `worst` density over the allowed one, at `frequency` (Hz).

    At or below one the mask is kept. `compared` counts the frequencies looked at.
    """

    mask: str
    passenger: str
    axis: str
    worst: float
    frequency: float
    compared: int
    agreement: Agreement
    reason: str


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class RideResponse(Shown):
    """The response of one closed loop to a random guideway at one speed (m/s)."""

    _told: ClassVar = ("speed", "passengers", "clearances", "actuators", "agreement")

    speed: float
    passengers: tuple[PassengerRide, ...]
    clearances: tuple[ClearanceStatistics, ...]
    actuators: tuple[ActuatorDemand, ...]
    spectra: tuple[AccelerationSpectrum, ...]
    agreement: Agreement
    largest_difference: float
    reason: str
    masks: tuple[MaskResult, ...] = ()
    signals: tuple[SignalStatistics, ...] = ()
    band: tuple[float, float] | None = None  # Hz, where only a band of the roughness counts
