"""Ride, gaps, strokes and actuators of one closed loop on one random guideway at one speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from maglev_ctrl.analysis.response.channels import (
    Noise,
    Process,
    RideChannel,
    Signal,
    passenger_signals,
    ride_channel,
    track_processes,
)
from maglev_ctrl.analysis.response.covariance import modal_residues
from maglev_ctrl.analysis.response.frequency import spectral_density
from maglev_ctrl.analysis.response.gaussian import (
    SECONDS_PER_HOUR,
    crossing_rate,
    probability_per_hour,
    share_beyond,
    supplied_power,
)
from maglev_ctrl.analysis.response.masks import third_octave_grid, worst_over_mask
from maglev_ctrl.analysis.response.moments import Moments, moments
from maglev_ctrl.analysis.response.records import (
    AccelerationSpectrum,
    ActuatorDemand,
    ClearanceStatistics,
    MaskResult,
    PassengerRide,
    PsdMask,
    RideResponse,
    SignalStatistics,
)
from maglev_ctrl.analysis.response.requests import Clearance, Passenger, Port
from maglev_ctrl.analysis.response.sources import Observed
from maglev_ctrl.analysis.response.weighting import Weighting, comfort_class, vector_sum, weighting
from maglev_ctrl.arrays import FloatArray, read_only, read_only_any
from maglev_ctrl.errors import Agreement
from maglev_ctrl.guideway.correlation import TrackInputs
from maglev_ctrl.guideway.shaping import ShapingFilter, shaping_filter
from maglev_ctrl.guideway.spectra import Roughness
from maglev_ctrl.systems import SecondOrderSystem
from maglev_ctrl.systems.feedback import Controller

NAN = float("nan")


def ride_response(
    system: SecondOrderSystem,
    controller: Controller | None,
    *,
    track: TrackInputs,
    speed: float,
    vertical: Roughness | None = None,
    cross_level: Roughness | None = None,
    lateral: Roughness | None = None,
    passengers: Sequence[Passenger] = (),
    clearances: Sequence[Clearance] = (),
    ports: Sequence[Port] = (),
    signals: Sequence[Signal] = (),
    masks: Sequence[PsdMask] = (),
    noises: Sequence[Noise] = (),
    band: tuple[float, float] | None = None,
    frequency: FloatArray | None = None,
    weightings: Sequence[Weighting] = (),
    verified: bool = True,
) -> RideResponse:
    """Everything about one closed loop on one random guideway at one speed; every variance by two methods.

    A number that does not exist, or on which the two methods differ, is NaN with the reason; nothing is guessed.

    Parameters
    ----------
    controller : None without a law, or where `system` is a closed loop already
    track : delays and weights of the guideway inputs (`track_inputs`)
    speed : m/s
    vertical, cross_level, lateral : roughness of each independent process (m, rad, m); None: smooth
    passengers, clearances, ports : what is asked about; `signals` are others whose deviation is wanted
    masks : compared with every passenger's spectrum of their axis
    noises : white noises of the sensors
    band : Hz; only this part of roughness and noise counts
    frequency : (F,) Hz of the spectra; one-third-octave bands from 0.1 to 80 Hz, ten points each, when left out
    weightings : further weightings by their names, beside those of ISO 2631-1
    verified : False leaves the second method, spectra and masks out, for search loops; nothing is AGREED then

    Raises
    ------
    ValueError : unknown names, or inputs of the track that are not those of the system
    NotStable : the closed loop is not stable

    Examples
    --------
    >>> from maglev_ctrl.guideway.correlation import track_inputs
    >>> from maglev_ctrl.guideway.spectra import inverse_square
    >>> car = SecondOrderSystem.from_matrices([[1000.0]], [[800.0]], [[40e3]], dofs=("car.heave",),
    ...     guideway=("heave@magnet",), K_w=[[40e3]], outputs=("car.heave.acceleration", "magnet.gap"),
    ...     H_a=[[1.0], [0.0]], H_q=[[0.0], [1.0]], H_w=[[0.0], [-1.0]])
    >>> found = ride_response(car, None, track=track_inputs(["heave@magnet"], [[0.0, 0.0]], speed=100.0), speed=100.0,
    ...     vertical=inverse_square(1.5e-6), passengers=[Passenger("middle")],
    ...     clearances=[Clearance("gap", "gap", "magnet.gap", nominal=0.1, clearance=0.08)])
    >>> found.passengers[0].comfort, found.agreement
    ('a little uncomfortable', <Agreement.AGREED: 'AGREED'>)
    >>> found.clearances[0].reason
    'infinite variance of the rate: high frequency'
    """
    own = {one.name: one for one in weightings}
    asked = _Asked.collect(system, passengers, clearances, ports, signals, own)
    if not asked.signals:
        raise ValueError("passengers, clearances, ports, signals: expected at least one of them")
    channel = ride_channel(system, controller, asked.signals, noises=noises)
    processes = track_processes(
        track,
        vertical=None if vertical is None else _shaped(vertical, speed),
        cross_level=None if cross_level is None else _shaped(cross_level, speed),
        lateral=None if lateral is None else _shaped(lateral, speed),
    )
    found = moments(channel, processes, asked.observed, pairs=asked.pairs, band=band, verified=verified)
    grid = third_octave_grid(0.1, 80.0) if frequency is None else read_only(frequency, name="frequency", shape=(None,))
    told = _Told(found, {one.name: i for i, one in enumerate(asked.observed)})
    riders = tuple(_passenger(told, one, axes) for one, axes in zip(passengers, asked.axes, strict=True))
    spectra = _spectra(channel, processes, passengers, asked, grid) if verified else ()
    largest = float(np.nanmax(found.difference, initial=0.0))
    settled = all(found.settled)
    return RideResponse(
        speed=float(speed),
        passengers=riders,
        clearances=tuple(_clearance(told, one) for one in clearances),
        actuators=tuple(_port(told, port, float(found.pairs[k])) for k, port in enumerate(ports)),
        spectra=spectra,
        agreement=Agreement.AGREED if settled else Agreement.UNRESOLVED,
        largest_difference=largest,
        reason="" if settled else "; ".join(dict.fromkeys(
            f"{name}: {reason}" for name, reason, good in zip(found.names, found.reasons, found.settled, strict=True)
            if not good
        )),
        masks=_masks(channel, processes, passengers, asked, masks, verified=verified),
        signals=tuple(_signal(told, one) for one in signals),
        band=band,
    )  # fmt: skip


@lru_cache(maxsize=64)
def _shaped(roughness: Roughness, speed: float) -> ShapingFilter:
    """A search asks for the same filter thousands of times."""
    return shaping_filter(roughness, speed=speed)


@dataclass(frozen=True, eq=False, slots=True)
class _Asked:
    """Signals of the channel, what is observed of them, and pairs (force, velocity) of the ports."""

    signals: tuple[Signal, ...]
    observed: tuple[Observed, ...]
    pairs: tuple[tuple[int, int], ...]
    axes: tuple[tuple[tuple[str, Observed, Observed], ...], ...]

    @classmethod
    def collect(
        cls,
        system: SecondOrderSystem,
        passengers: Sequence[Passenger],
        clearances: Sequence[Clearance],
        ports: Sequence[Port],
        others: Sequence[Signal],
        own: dict[str, Weighting],
    ) -> _Asked:
        signals: dict[str, Signal] = {}
        observed: list[Observed] = []

        def watch(signal: Signal, filtered: Weighting | None = None, label: str = "") -> Observed:
            known = signals.setdefault(signal.name, signal)
            if known.terms != signal.terms:
                raise ValueError(f"signals: {signal.name!r} is used for two different signals")
            one = Observed(signal.name, filtered, label)
            held = next((old for old in observed if old.name == one.name), None)
            if held is None:
                observed.append(one)
            return held or one

        shared: dict[str, Weighting] = {}

        def filtered(name: str) -> Weighting:
            return shared.setdefault(name, own[name] if name in own else weighting(name))

        axes = []
        for passenger in passengers:
            rows = []
            for axis, signal in passenger_signals(
                system, passenger.body, x=passenger.x, y=passenger.y, z=passenger.z, name=passenger.name
            ):
                name = passenger.vertical if axis == "vertical" else passenger.lateral
                rows.append((axis, watch(signal, filtered(name)), watch(signal)))
            axes.append(tuple(rows))
        for clearance in clearances:
            watch(Signal.of(clearance.output, unit="m"))
        for port in ports:
            watch(port.force)
            watch(port.velocity)
        for signal in others:
            watch(signal)
        names = [one.name for one in observed]
        pairs = tuple((names.index(port.force.name), names.index(port.velocity.name)) for port in ports)
        return cls(tuple(signals.values()), tuple(observed), pairs, tuple(axes))


@dataclass(frozen=True, eq=False, slots=True)
class _Told:
    found: Moments
    place: dict[str, int]

    def deviation(self, name: str) -> float:
        return float(self.found.deviations[self.place[name]])

    def rate(self, name: str) -> float:
        return float(self.found.rates[self.place[name]])

    def reasons(self, *names: str, rates: bool = False) -> str:
        told = [self.found.reasons[self.place[name]] for name in names]
        if rates:
            told += [self.found.rate_reasons[self.place[name]] for name in names[:1]]
        return "; ".join(dict.fromkeys(reason for reason in told if reason))

    def agreement(self, *names: str) -> Agreement:
        return self.found.agreement(*(self.place[name] for name in names))


def _passenger(told: _Told, asked: Passenger, axes: tuple[tuple[str, Observed, Observed], ...]) -> PassengerRide:
    weighted = np.array([told.deviation(one.name) for _, one, _ in axes])
    plain = np.array([told.deviation(one.name) for _, _, one in axes])
    factors = [asked.factors[0] if axis == "vertical" else asked.factors[1] for axis, _, _ in axes]
    total = vector_sum(weighted, factors)
    return PassengerRide(
        name=asked.name, x=asked.x, y=asked.y,
        axes=tuple(axis for axis, _, _ in axes),
        weighted=read_only_any(weighted),
        unweighted=read_only_any(plain),
        total=total,
        comfort=comfort_class(total),
        agreement=told.agreement(*(one.name for _, one, _ in axes)),
        reason="; ".join(
            f"{label}{axis}: {told.reasons(one.name)}"
            for axis, filtered, bare in axes
            for label, one in (("", filtered), ("unweighted ", bare))
            if told.reasons(one.name)
        ),
    )  # fmt: skip


def _clearance(told: _Told, asked: Clearance) -> ClearanceStatistics:
    deviation, rate = told.deviation(asked.output), told.rate(asked.output)
    free = asked.clearance - asked.sag
    crossings = crossing_rate(deviation, rate, free) if free > 0.0 and deviation >= 0.0 else NAN
    contact = probability_per_hour(crossings * (1.0 if asked.kind == "gap" else 2.0))
    reason = told.reasons(asked.output, rates=True)
    if free <= 0.0:
        contact, reason = 1.0, "; ".join(filter(None, ("the sag uses up the whole clearance", reason)))
    return ClearanceStatistics(
        name=asked.name, kind=asked.kind, nominal=asked.nominal, clearance=asked.clearance, sag=asked.sag,
        deviation=deviation, three_sigma=3.0 * deviation,
        used=(3.0 * deviation + asked.sag) / asked.clearance,
        crossing_rate=crossings, contact_per_hour=contact,
        agreement=told.agreement(asked.output), reason=reason,
    )  # fmt: skip


def _port(told: _Told, port: Port, covariance: float) -> ActuatorDemand:
    force, velocity = told.deviation(port.force.name), told.deviation(port.velocity.name)
    # A force that is zero gives no power, however wild the velocity.
    product = 0.0 if force == 0.0 or velocity == 0.0 else force * velocity
    mean = 0.0 if product == 0.0 else covariance if np.isfinite(product) else NAN
    supplied = 0.0 if product == 0.0 else supplied_power(force, velocity, mean / product) if np.isfinite(mean) else NAN
    unsettled = "two methods differ" if np.isfinite(product) and not np.isfinite(mean) else ""
    limit = NAN if port.limit is None else port.limit
    return ActuatorDemand(
        name=port.name, force=force, rate=told.rate(port.force.name), velocity=velocity,
        mean_power=mean,
        supplied_power=supplied, energy_per_hour=SECONDS_PER_HOUR * supplied, limit=limit,
        three_sigma_share=3.0 * force / limit,
        saturated=share_beyond(force, limit) if port.limit is not None else NAN,
        agreement=Agreement.UNRESOLVED if unsettled else told.agreement(port.force.name, port.velocity.name),
        reason="; ".join(
            f"{word}: {reason}"
            for word, reason in (
                ("force", told.reasons(port.force.name, rates=True)), ("velocity", told.reasons(port.velocity.name)),
                ("power", unsettled),
            )
            if reason
        ),
    )  # fmt: skip


def _signal(told: _Told, signal: Signal) -> SignalStatistics:
    i = told.place[signal.name]
    found = told.found
    return SignalStatistics(
        name=signal.name, unit=signal.unit, deviation=float(found.deviations[i]), by_lyapunov=float(found.exact[i]),
        by_frequency=float(found.integral[i]), difference=float(found.difference[i]), rate=float(found.rates[i]),
        agreement=found.agreement(i), reason=told.reasons(signal.name, rates=True),
    )  # fmt: skip


def _spectra(
    channel: RideChannel,
    processes: tuple[Process, ...],
    passengers: Sequence[Passenger],
    asked: _Asked,
    grid: FloatArray,
) -> tuple[AccelerationSpectrum, ...]:
    felt = [(one.name, axis, bare) for one, axes in zip(passengers, asked.axes, strict=True) for axis, _, bare in axes]
    if not felt:
        return ()
    density = spectral_density(channel, processes, [bare for _, _, bare in felt], grid)
    return tuple(
        AccelerationSpectrum(name, axis, read_only_any(grid), read_only_any(row))
        for (name, axis, _), row in zip(felt, density, strict=True)
    )


def _masks(
    channel: RideChannel,
    processes: tuple[Process, ...],
    passengers: Sequence[Passenger],
    asked: _Asked,
    masks: Sequence[PsdMask],
    *,
    verified: bool,
) -> tuple[MaskResult, ...]:
    results: list[MaskResult] = []
    for mask in masks:
        for passenger, axes in zip(passengers, asked.axes, strict=True):
            for axis, _, bare in axes:
                if axis != mask.axis:
                    continue
                if not verified:
                    reason = "spectra are left out without the second method"
                    results.append(
                        MaskResult(mask.name, passenger.name, axis, NAN, NAN, 0, Agreement.UNRESOLVED, reason)
                    )
                    continue
                worst, at, looked = worst_over_mask(channel, processes, bare.output, mask)
                results.append(
                    MaskResult(mask.name, passenger.name, axis, worst, at, looked, *_mask_check(
                        channel, processes, bare, mask, worst, at
                    ))
                )  # fmt: skip
    return tuple(results)


def _mask_check(
    channel: RideChannel, processes: tuple[Process, ...], bare: Observed, mask: PsdMask, worst: float, at: float
) -> tuple[Agreement, str]:
    """The worst density again from partial fractions."""
    point = np.array([at])
    again = sum(
        float(2.0 * np.abs(part.at(np.asarray(2j * np.pi * point))[0, 0]) ** 2)
        for part in modal_residues(channel, processes, [bare])
    ) / float(mask.at(point)[0])
    if abs(again - worst) <= 1e-6 * worst:
        return Agreement.AGREED, ""
    return Agreement.UNRESOLVED, f"two methods differ: {worst:.9g} and {again:.9g}"
