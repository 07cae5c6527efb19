"""A law that knows the phase of the guideway against the option's own constant gain, on the option's own weights."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from maglev_ctrl.analysis.floquet import floquet
from maglev_ctrl.analysis.plane_records import PeriodicFamily, StabilityPlane
from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.errors import MaglevError
from maglev_ctrl.guideway import passing_frequency
from maglev_ctrl.kernels.fourier_matrix import FourierMatrix
from maglev_ctrl.study.forcing import delays_are_short, slowed_vehicle
from maglev_ctrl.study.map.records import PeriodicLawStudy
from maglev_ctrl.study.modulation import modulation_of
from maglev_ctrl.study.situation import PADE_ORDER, OptionModel, Situation
from maglev_ctrl.synthesis.design import Design
from maglev_ctrl.synthesis.neutral import NEUTRAL_RATE, prepare
from maglev_ctrl.synthesis.periodic import PeriodicProblem, PeriodicRegulator, periodic_lqr
from maglev_ctrl.synthesis.periodic_constant import PeriodicComparison, compare_laws, law_rating
from maglev_ctrl.systems import PeriodicSystem, SecondOrderSystem, at_depth, modulate
from maglev_ctrl.vehicle import Vehicle, linearize

OWN = "the option's own gain"
SAME = 1e-6  # relative difference below which two gains are the same
_HARMONICS_BELOW = 1e-6  # harmonics of the gain that together stay below this share are left out of the loop
_AGREE = 1e-6  # relative difference of the spectral radii by which the map's loop may differ from the certificate's
_KEPT_AT_MOST = 1024  # open plants kept for other depths

Draw = Callable[[PeriodicFamily], StabilityPlane]


@dataclass(frozen=True, eq=False, slots=True)
class PhaseLockedLaw:
    """u = -(mean + depth / design_depth * harmonics of `gain`) x, the harmonics locked to the phase of the guideway.

    Designed at one speed and depth. At another speed the same coefficients pass at another frequency, because they
    belong to places of the guideway; at another depth the harmonics are scaled with it. `gain` (m, n) over the plant's
    states `measured`, `commands` the actuators.
    """

    gain: FourierMatrix
    measured: tuple[str, ...]
    commands: tuple[str, ...]
    design_depth: float

    def close(self, plant: SecondOrderSystem, unit: PeriodicSystem, depth: float) -> PeriodicSystem:
        """The loop at an actual depth.

        Parameters
        ----------
        plant : the open plant; states beyond `measured` (of delays) are not fed back
        unit : the same plant with its modulation at unit depth
        depth : actual depth

        Raises
        ------
        ValueError : the plant lacks a state or an actuator of the law
        """
        B = plant.input_matrix()[:, [plant.inputs.index(name) for name in self.commands]]
        seen = np.zeros((len(self.measured), len(plant.states)))
        seen[np.arange(len(self.measured)), [plant.states.index(name) for name in self.measured]] = 1.0
        size, own = len(unit.A_cos), self.gain.harmonics
        waves: list[FloatArray] = []
        for plant_wave, law_wave in ((unit.A_cos, self.gain.cosine), (unit.A_sin, self.gain.sine)):
            wave = np.zeros((max(size, own), *unit.A_0.shape))
            wave[:size] += depth * plant_wave
            wave[:own] -= (depth / self.design_depth) * (B @ law_wave @ seen)
            waves.append(wave)
        A_0 = unit.A_0 - B @ self.gain.mean @ seen
        return replace(unit, A_0=read_only_any(A_0), A_cos=read_only_any(waves[0]), A_sin=read_only_any(waves[1]))


@dataclass(frozen=True, eq=False, slots=True)
class LawFamily:
    """The loop under a phase-locked law over speed (m/s) and depth of modulation."""

    model: OptionModel
    vehicle: Vehicle
    law: PhaseLockedLaw
    _open: dict[float, tuple[SecondOrderSystem, PeriodicSystem]]

    def __call__(self, x: float, y: float) -> PeriodicSystem:
        """The loop at a speed and a depth.

        Raises
        ------
        ModelError : there is no equilibrium
        OutOfDomain : the forces are not known there
        """
        known = self._open.get(x)
        if known is None:
            known = open_plant(self.model, self.vehicle, x)
            if len(self._open) < _KEPT_AT_MOST:
                self._open[x] = known
        return self.law.close(*known, y)


def periodic_law_study(
    model: OptionModel, design: Design | None, *, draw: Draw | None = None, simulate: bool = True
) -> tuple[PeriodicLawStudy | None, str]:
    """The periodic law of least cost at the design speed and expected depth, against constant gains and over a map.

    Plant without delays, weights and measured states are those of the option's own LQR. The law counts only where its
    independent check, the loop as the map closes it, and the loop with the actuators' delays all bear it out.

    Parameters
    ----------
    design : the option's law; None for a passive option
    draw : draws the map of a family over speed (m/s) and depth; None leaves the map out
    simulate : whether the certificate simulates the cost, its slowest part

    Returns
    -------
    the study, None where the option has no LQR; and why ("" where there is a study)
    """
    if design is None:
        return None, "No periodic law: the option has no controller."
    if design.law != "LQR" or design.weights is None:
        return None, f"No periodic law: it is compared with LQR options only, this one has {design.law}."
    expected = modulation_of(model.scenario).depth
    if not expected > 0.0:
        return None, "No periodic law: the expected depth of modulation is zero."
    try:
        return _study(model, design, expected, draw, simulate), ""
    except (MaglevError, ValueError, np.linalg.LinAlgError) as fault:
        return PeriodicLawStudy(None, (), None, f"{fault}"), ""


def open_plant(
    model: OptionModel, vehicle: Vehicle, speed: float, *, pade_order: int = PADE_ORDER
) -> tuple[SecondOrderSystem, PeriodicSystem]:
    """The plant with its loops open at a speed, and the same with its modulation at unit depth.

    Raises
    ------
    ModelError : there is no equilibrium
    OutOfDomain : the forces are not known there
    """
    modulation = modulation_of(model.scenario)
    held, balanced = model.balance_of(vehicle, replace(Situation.of_design(model.scenario), speed=speed))
    plant = linearize(held, balanced, pade_order=pade_order)
    K_cos, K_sin = modulation(held, balanced)
    return plant, modulate(plant, K_cos, K_sin, frequency=passing_frequency(speed, modulation.wavelength))


def _study(
    model: OptionModel, design: Design, expected: float, draw: Draw | None, simulate: bool
) -> PeriodicLawStudy:  # fmt: skip
    speed = model.scenario.operating.speed
    plant, unit = open_plant(model, model.vehicle(), speed, pade_order=0)
    problem, offset = own_problem(design, plant, at_depth(unit, expected))
    regulator = periodic_lqr(problem, simulate=simulate)
    comparison = _with_own(compare_laws(regulator, offset=offset), regulator, design, offset, plant)
    whole = comparison.periodic.gain.truncated(_HARMONICS_BELOW)
    law = PhaseLockedLaw(whole, plant.states, design.controller.commands, expected)
    told, faults = _judged(model, regulator, law, (plant, unit))
    unresolved = "; ".join(faults)
    plane = None
    if not unresolved and draw is not None:
        vehicle = model.vehicle()
        short = delays_are_short(model, vehicle, design.controller)
        plane = draw(LawFamily(model, slowed_vehicle(vehicle) if short else vehicle, law, {}))
    return PeriodicLawStudy(comparison, told, plane, unresolved)


def own_problem(
    design: Design, plant: SecondOrderSystem, system: PeriodicSystem
) -> tuple[PeriodicProblem, FloatArray]:  # fmt: skip
    """The periodic problem with an LQR's own weights, and the constant part of the law its cross weight N makes.

    With u = v - R^-1 N'x the cost x'Qx + 2 x'Nu + u'Ru becomes x'(Q - N R^-1 N')x + v'Rv on A - B R^-1 N'.

    Parameters
    ----------
    plant : the plant the option's law was designed on
    system : the same with its modulation at the expected depth

    Raises
    ------
    ModelError : a mode stands in the way of any law
    ValueError : the design has no weights
    """
    weights = design.weights
    if weights is None:
        raise ValueError(f"design: {design.name!r} has no weights")
    B = plant.input_matrix()[:, [plant.inputs.index(name) for name in weights.commands]]
    prepared = prepare(
        plant.state_matrix(), B, weights, states=plant.states, neutral_rate=NEUTRAL_RATE, uncontrollable="refuse"
    )  # fmt: skip
    offset = np.linalg.solve(weights.R, weights.N.T)
    moved = replace(system, A_0=read_only_any(system.A_0 - B @ offset))
    return PeriodicProblem.of(moved, B, prepared.Q - weights.N @ offset, weights.R), np.asarray(offset)


def _with_own(
    found: PeriodicComparison, regulator: PeriodicRegulator, design: Design, offset: FloatArray,
    plant: SecondOrderSystem,
) -> PeriodicComparison:  # fmt: skip
    """The comparison with the option's own gain, which is the averaged design where nothing went wrong."""
    own = -design.controller.D[:, [design.controller.measured.index(name) for name in plant.states]]
    first = found.constants[0]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(regulator.P.mean), 1e-300))
    distance = float(np.linalg.norm((first.gain.mean - own) * scale))
    if first.name == "averaged system" and distance <= SAME * float(np.linalg.norm(own * scale)):
        return replace(found, constants=(replace(first, name=f"{OWN} (LQR of the averaged system)"),
                                         *found.constants[1:]))  # fmt: skip
    gain = FourierMatrix.of(own - offset, frequency=regulator.gain.frequency)
    return replace(found, constants=(law_rating(regulator, gain, name=OWN, offset=offset), *found.constants))


def _judged(
    model: OptionModel, regulator: PeriodicRegulator, law: PhaseLockedLaw,
    designed: tuple[SecondOrderSystem, PeriodicSystem],
) -> tuple[tuple[str, ...], tuple[str, ...]]:  # fmt: skip
    """What the checks found, one line each, and what speaks against the law."""
    proof = regulator.certificate
    faults = list(proof.disagreements)
    speed, depth = model.scenario.operating.speed, law.design_depth
    closed = floquet(law.close(*designed, depth))
    if closed.stable is not True or abs(closed.spectral_radius - proof.spectral_radius) > _AGREE:
        faults.append(
            f"the loop as the map closes it has a spectral radius of {closed.spectral_radius:.6g}, "
            f"the certificate {proof.spectral_radius:.6g}"
        )
    delayed = floquet(law.close(*open_plant(model, model.vehicle(), speed), depth))
    if delayed.stable is not True:
        faults.append(
            f"with the actuators' delays the two engines do not confirm stability: growth {delayed.growth_rate:.3g} 1/s"
        )
    mapped = f"designed at {speed * 3.6:.4g} km/h and depth {100.0 * depth:.3g} %, carried to other speeds with its "
    told = (
        f"residual of the periodic Riccati equation between samples {proof.residual:.1e}, harmonics left out "
        f"{regulator.series_error:.1e}, change with twice the segments {regulator.refinement_change:.1e}",
        f"spectral radius of the loop {proof.spectral_radius:.6g}; multipliers differ by "
        f"{proof.multiplier_difference:.1e} from those the solver implies",
        f"simulated cost differs by {proof.cost_difference:.1e}" if np.isfinite(proof.cost_difference)
        else "cost not simulated",
        f"the loop as the map closes it: growth {closed.growth_rate:.6g} 1/s, engines {closed.agreement.value}; with "
        f"the actuators' delays {delayed.growth_rate:.6g} 1/s, engines {delayed.agreement.value}",
        f"{mapped}phase locked to the guideway, to other depths with its harmonics in proportion: away from the design "
        "point it is not the law of least cost",
        *regulator.notes,
    )  # fmt: skip
    return told, tuple(faults)
