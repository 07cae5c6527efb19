"""What the response to a random guideway is told by."""

from __future__ import annotations

from dataclasses import dataclass

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import Agreement


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
    guideway uses up already. `three_sigma` (m); `crossing_rate` (1/s) by Rice's formula; `contact_per_hour` the
    probability of at least one contact in an hour (Poisson).
    """

    name: str
    kind: str  # "gap" or "stroke"
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
class RideResponse:
    """The response of one closed loop to a random guideway at one speed (m/s)."""

    speed: float
    passengers: tuple[PassengerRide, ...]
    clearances: tuple[ClearanceStatistics, ...]
    actuators: tuple[ActuatorDemand, ...]
    spectra: tuple[AccelerationSpectrum, ...]
    agreement: Agreement
    largest_difference: float
    reason: str
