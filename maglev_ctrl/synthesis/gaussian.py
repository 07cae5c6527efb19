"""Noise of sensors, disturbances and guideway, as the intensities a Kalman filter needs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.synthesis.weights import QuadraticWeights, require_distinct, require_known
from maglev_ctrl.systems import SecondOrderSystem


@dataclass(frozen=True, eq=False, slots=True)
class SensorNoise:
    """A measured output (or state) and its white noise, one-sided density in the output's unit per sqrt(Hz)."""

    sensor: str
    density: float


@dataclass(frozen=True, eq=False, slots=True)
class GuidewayNoise:
    """Guideway roughness w' = -corner w + n, the same and independent for every guideway displacement.

    `velocity_density` of n in m/s per sqrt(Hz), one-sided; `corner` rad/s bounds the displacement below it.
    """

    velocity_density: float
    corner: float = 0.05


@dataclass(frozen=True, eq=False, slots=True)
class NoiseModel:
    """Plant with guideway states, x' = A x + B u + w, y = C x + D u + v, and E[w w'], E[v v'], E[w v'] (two-sided)."""

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    process: FloatArray
    measurement: FloatArray
    cross: FloatArray
    weights: QuadraticWeights
    states: tuple[str, ...]
    measured: tuple[str, ...]


@dataclass(frozen=True, eq=False, slots=True)
class NoiseFactors:
    """Plant with guideway states driven by unit white noises w: x' = A x + B1 w + B u, y = C x + D21 w + D u.

    `disturbances` names the noises: accelerations of the freedoms, roughness of the guideway, noise of the sensors.
    """

    A: FloatArray
    B1: FloatArray
    B: FloatArray
    C: FloatArray
    D21: FloatArray
    D: FloatArray
    weights: QuadraticWeights
    states: tuple[str, ...]
    disturbances: tuple[str, ...]
    measured: tuple[str, ...]


def noise_factors(
    system: SecondOrderSystem,
    weights: QuadraticWeights,
    sensors: Sequence[SensorNoise],
    *,
    disturbance: float,
    guideway: GuidewayNoise | None,
) -> NoiseFactors:
    """Join plant, sensors (perhaps none) and noise sources; guideway displacements become states with `guideway`.

    One-sided densities d give two-sided intensities d^2 / 2, and factors d / sqrt(2).

    Raises
    ------
    ValueError : unknown or doubled sensors, or a density that is not positive
    """
    measured = tuple(sensor.sensor for sensor in sensors)
    _check(system, sensors, disturbance, guideway)
    columns = [system.inputs.index(name) for name in weights.commands]
    A, B = system.state_matrix(), system.input_matrix()[:, columns]
    C, D, E_y = system.output_rows(measured)
    shaken, felt = _disturbed(system, measured)
    size = np.full(len(system.dofs), disturbance)
    names = tuple(f"{name}.disturbance" for name in system.dofs)
    states, weighed = system.states, weights
    if guideway is not None and system.guideway:
        rough = _Roughness.of(system, guideway)
        A, B, C, shaken, felt = rough.grow(A, B, C, E_y, shaken, felt)
        size = np.concatenate([size, np.full(len(system.guideway), guideway.velocity_density)])
        names += tuple(f"{name}.roughness" for name in system.guideway)
        states, weighed = states + system.guideway, rough.weights(system, weights)
    quiet = np.diag([sensor.density for sensor in sensors])
    root = np.sqrt(0.5)
    return NoiseFactors(
        A=A,
        B1=root * np.hstack([shaken * size, np.zeros((A.shape[0], len(sensors)))]),
        B=B, C=C,
        D21=root * np.hstack([felt * size, quiet.reshape(len(sensors), len(sensors))]),
        D=D[:, columns],
        weights=weighed, states=states, disturbances=(*names, *(f"{name}.noise" for name in measured)),
        measured=measured,
    )  # fmt: skip


def noise_model(
    system: SecondOrderSystem,
    weights: QuadraticWeights,
    sensors: Sequence[SensorNoise],
    *,
    disturbance: float,
    guideway: GuidewayNoise | None,
) -> NoiseModel:
    """The same as intensities, for a Kalman filter.

    Raises
    ------
    ValueError : no sensor, unknown or doubled sensors, or a density that is not positive
    """
    if not sensors:
        raise ValueError("sensors: expected at least one")
    found = noise_factors(system, weights, sensors, disturbance=disturbance, guideway=guideway)
    return NoiseModel(
        A=found.A, B=found.B, C=found.C, D=found.D,
        process=found.B1 @ found.B1.T, measurement=found.D21 @ found.D21.T, cross=found.B1 @ found.D21.T,
        weights=found.weights, states=found.states, measured=found.measured,
    )  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class _Roughness:
    """Effect of the guideway states w and of the noise n on x' : A_w w + A_n n."""

    count: int
    corner: float
    A_w: FloatArray
    A_n: FloatArray

    @classmethod
    def of(cls, system: SecondOrderSystem, noise: GuidewayNoise) -> _Roughness:
        place, rate = np.split(system.guideway_matrix(), 2, axis=1)
        return cls(len(system.guideway), noise.corner, place - noise.corner * rate, rate)

    def grow(
        self, A: FloatArray, B: FloatArray, C: FloatArray, E: FloatArray, shaken: FloatArray, felt: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """A, B, C and the two noise matrices with the guideway states appended."""
        k, n = self.count, A.shape[0]
        place, rate = np.split(E, 2, axis=1)
        below = np.hstack([np.zeros((k, n)), -self.corner * np.eye(k)])
        return (
            np.vstack([np.hstack([A, self.A_w]), below]),
            np.vstack([B, np.zeros((k, B.shape[1]))]),
            np.hstack([C, place - self.corner * rate]),
            np.vstack([np.hstack([shaken, self.A_n]), np.hstack([np.zeros((k, shaken.shape[1])), np.eye(k)])]),
            np.hstack([felt, rate]),
        )

    def weights(self, system: SecondOrderSystem, weights: QuadraticWeights) -> QuadraticWeights:
        """The same weights seen from the grown state: outputs may depend on the guideway."""
        _, _, E = system.output_rows(tuple(weight.output for weight in weights.outputs))
        place, rate = np.split(E / np.array([[weight.allowed] for weight in weights.outputs]), 2, axis=1)
        rows = np.hstack([weights.rows, place - self.corner * rate])
        return replace(
            weights,
            rows=read_only(rows, name="rows"),
            Q=read_only(rows.T @ rows, name="Q"),
            N=read_only(rows.T @ weights.through, name="N"),
        )


def _disturbed(system: SecondOrderSystem, measured: tuple[str, ...]) -> tuple[FloatArray, FloatArray]:
    """Effect of accelerations on every freedom on x' and, through accelerometers, on y."""
    n = len(system.dofs)
    shaken = np.vstack([np.zeros((len(system.positions), n)), np.eye(n), system.G_a])
    felt = np.array([
        system.H_a[system.outputs.index(name)] if name in system.outputs else np.zeros(n) for name in measured
    ]).reshape(len(measured), n)  # fmt: skip
    return shaken, felt


def _check(
    system: SecondOrderSystem, sensors: Sequence[SensorNoise], disturbance: float, guideway: GuidewayNoise | None
) -> None:
    for sensor in sensors:
        require_known(sensor.sensor, (*system.outputs, *system.states), what="sensor")
    require_distinct((sensor.sensor for sensor in sensors), what="sensor")
    positive = {f"density of {sensor.sensor!r}": sensor.density for sensor in sensors} | {"disturbance": disturbance}
    if guideway is not None:
        positive |= {"velocity_density": guideway.velocity_density, "corner": guideway.corner}
    for label, value in positive.items():
        if not (np.isfinite(value) and value > 0.0):
            raise ValueError(f"{label}: expected a positive finite value, got {value!r}")
