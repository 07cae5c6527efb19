"""Units of the records of ride, worst cases, nonlinear check and tuning, by "Record.field"."""

from __future__ import annotations

from typing import Final

_DENSITY: Final = "(m/s^2)^2/Hz"
SI: Final = "SI"  # numbers whose unit another field tells: times its scale they are in that unit

UNITS_RIDE: Final[dict[str, str]] = {
    "RidePoint.speed": "m/s", "RidePoint.payload": "kg", "RideResponse.speed": "m/s", "RideResponse.band": "Hz",
    "MaskResult.frequency": "Hz", "MaskResult.mask_frequency": "Hz", "MaskResult.mask_density": _DENSITY,
    "SpanPassing.span": "m", "SpanPassing.sag": "m", "SpanPassing.speeds": "m/s", "SpanPassing.gap": "m",
    "SpanPassing.acceleration": "m/s^2", "SpanPassing.design_gap": "m", "SpanPassing.design_acceleration": "m/s^2",
    "SpanPassing.worst_speed": "m/s", "SpanPassing.worst_gap": "m",
    "FlexibleSpan.frequency": "Hz", "FlexibleSpan.deflection": "m", "FlexibleSpan.static_deflection": "m",
    "FlexibleSpan.gap": "m", "FlexibleSpan.acceleration": "m/s^2",
    "StepPassing.height": "m", "StepPassing.ramp": "m", "StepPassing.gap": "m", "StepPassing.acceleration": "m/s^2",
    "PassengerRide.x": "m", "PassengerRide.y": "m", "PassengerRide.weighted": "m/s^2",
    "PassengerRide.unweighted": "m/s^2", "PassengerRide.total": "m/s^2",
    "ClearanceStatistics.nominal": "m", "ClearanceStatistics.clearance": "m", "ClearanceStatistics.sag": "m",
    "ClearanceStatistics.deviation": "m", "ClearanceStatistics.three_sigma": "m",
    "ClearanceStatistics.crossing_rate": "1/s",
    "ActuatorDemand.force": "N", "ActuatorDemand.rate": "N/s", "ActuatorDemand.velocity": "m/s",
    "ActuatorDemand.mean_power": "W", "ActuatorDemand.supplied_power": "W", "ActuatorDemand.energy_per_hour": "J",
    "ActuatorDemand.limit": "N",
    "AccelerationSpectrum.frequency": "Hz", "AccelerationSpectrum.density": _DENSITY,
    "WorstCase.seconds": "s", "WorstCase.growth": "1/s", "FactorBounds.frequency": "rad/s",
    "WorstPoint.percent": "%", "WorstPoint.frequency": "rad/s",
    "CommonDelay.delay": "s", "CommonDelay.frequency": "rad/s", "MarginSites.command_frequencies": "rad/s",
    "NonlinearStudy.duration": "s", "NonlinearStudy.step": "s", "NonlinearStudy.speed": "m/s",
    "NonlinearStudy.time": "s", "NonlinearStudy.seconds": "s",
    "SimulatedEvent.time": "s", "SimulatedEvent.value": "m/s",
    "TuningStudy.seconds": "s", "TunedOption.seconds": "s", "TunedOption.front": SI,
    "TunedOption.front_variables": SI, "TunedVariable.lower": SI, "TunedVariable.upper": SI, "TunedVariable.value": SI,
}  # fmt: skip
