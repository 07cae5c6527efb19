"""Forces of a scenario's magnet over height, gap and speed: lift, guidance, drag, stiffness, damping, torque."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import ModelError
from maglev_ctrl.fields.section import CrossSection
from maglev_ctrl.forces import AbstractForceModel, Domain, MagnetDerivatives, MagnetForces
from maglev_ctrl.forces.force_map import ForceMap, MapQuality
from maglev_ctrl.scenario import Scenario, build_vehicle, with_solved_force
from maglev_ctrl.scenario.eddy_current import box_clearance, study_domain
from maglev_ctrl.scenario.force_schema import CoefficientForces
from maglev_ctrl.scenario.guideway_schema import EddyCurrentForces
from maglev_ctrl.scenario.layout import layout
from maglev_ctrl.study.eddy_current import SolvedMagnet, solved_magnet
from maglev_ctrl.study.forces import describe_forces

if TYPE_CHECKING:
    from maglev_ctrl.fields.mesh import Triangulation
    from maglev_ctrl.forces.eddy_current import Accuracy, EddyCurrentForce

SLOW: Final = 2.0 * np.pi
"""Frequency at which damping is told, rad/s: 1 Hz, slow against the currents."""
_GRID, _FINE, _COARSE = 41, 121, 25
_SOLVING: Final = 0.7

Tell = Callable[[str, float], None]


@dataclass(frozen=True, eq=False, slots=True)
class Damping:
    """Force on the magnet per velocity at `SLOW`; above zero it feeds the motion.

    `along` (n,) heights (m) or speeds (m/s); `heave` c_ll, `sway` c_gg, `sway_by_heave` c_gl, `surge` c_xx, (n,) N s/m.
    """

    along: FloatArray
    heave: FloatArray
    sway: FloatArray
    sway_by_heave: FloatArray
    surge: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class Line:
    """Forces along one parameter, the others at the design point: values (n,), forces and partials (n,) each."""

    values: FloatArray
    forces: MagnetForces
    slopes: MagnetDerivatives


@dataclass(frozen=True, eq=False, slots=True)
class Geometry:
    """Cross-section, coils and mesh of an eddy-current model; `coils` as (2, 2) ends in the plane at the design."""

    section: CrossSection
    coils: tuple[FloatArray, ...]
    clearance: float
    mesh: Triangulation


@dataclass(frozen=True, eq=False, slots=True)
class ForceSurvey:
    """Everything `maglev-ctrl forces` says about one magnet.

    `heights`, `gaps`, `speeds` axes of `table` (heights, gaps, speeds), m, m, m/s; `gaps` is (1,) NaN without a wall;
    `slopes` (heights, gaps) partials at the design speed. `drag_peak` m/s, None where the drag has none inside the
    range. `heave_changes` speeds (m/s) at which the vertical damping changes its sign. `error` of the exact forces,
    estimated by solving again, finer; None where nothing was solved. Torques are N m, y towards z.
    """

    title: str
    name: str
    model: str
    scenario_hash: str
    facts: tuple[str, ...]
    assumptions: tuple[str, ...]
    height: float
    gap: float | None
    speed: float
    domain: Domain
    heights: FloatArray
    gaps: FloatArray
    speeds: FloatArray
    table: MagnetForces
    slopes: MagnetDerivatives
    over_speed: Line
    forces: MagnetForces
    partials: MagnetDerivatives
    drag_peak: float | None
    damping_over_speed: Damping | None
    damping_over_height: Damping | None
    heave_damping: float | None
    heave_changes: tuple[float, ...]
    torque_over_speed: FloatArray | None
    torque_over_height: FloatArray | None
    torque: float | None
    quality: MapQuality | None
    error: float | None
    geometry: Geometry | None

    @property
    def height_index(self) -> int:
        """Grid height nearest to the design point's."""
        return int(np.argmin(np.abs(self.heights - self.height)))

    @property
    def gap_index(self) -> int:
        """Grid gap nearest to the design point's."""
        return 0 if self.gap is None else int(np.argmin(np.abs(self.gaps - self.gap)))

    @property
    def speed_index(self) -> int:
        """Grid speed nearest to the design point's."""
        return int(np.argmin(np.abs(self.speeds - self.speed)))


def survey(
    scenario: Scenario, *, accuracy: Accuracy | None = None, jobs: int = 1, progress: Tell | None = None
) -> ForceSurvey:
    """Forces of one magnet of a scenario over the ranges its study uses.

    Parameters
    ----------
    accuracy : of eddy-current forces; None = the scenario's
    jobs : processes for solving; with more than one, call from under `if __name__ == "__main__":`
    progress : told what is done and the fraction of the whole

    Raises
    ------
    ModelError : the scenario has no magnets whose forces depend on the height, or they cannot be solved
    """
    if isinstance(scenario.forces, CoefficientForces):
        raise ModelError(
            f'{scenario.path}: forces.model "coefficients" gives matrices and no forces over height; '
            "there is nothing to draw"
        )
    tell = progress or (lambda what, fraction: None)
    solved: SolvedMagnet | None = None
    if isinstance(scenario.forces, EddyCurrentForces):
        solved = solved_magnet(
            scenario, accuracy=accuracy, jobs=jobs, progress=lambda what, part: tell(what, _SOLVING * part)
        )
        scenario = with_solved_force(scenario, solved.map)
    vehicle = build_vehicle(scenario)
    force = vehicle.magnets[0].force
    exact, error = None, None
    if solved is not None and isinstance(force, ForceMap):
        exact = solved.exact.scaled(force.strength)
        tell("error of the forces", _SOLVING)
        error = solved.error()
    tell("forces over height, gap and speed", 0.8)
    return _survey(scenario, force, exact, error, facts=describe_forces(scenario, vehicle), tell=tell)


def _survey(
    scenario: Scenario,
    force: AbstractForceModel,
    exact: EddyCurrentForce | None,
    error: float | None,
    *,
    facts: tuple[str, ...],
    tell: Tell,
) -> ForceSurvey:
    operating = scenario.operating
    domain = _shown_domain(scenario, force)
    height, speed = operating.height, operating.speed
    gap = None if domain.gap is None else operating.gap
    heights, speeds = _axis(domain.height, _GRID, height), _axis(domain.speed, _COARSE, speed)
    gaps = np.array([np.nan]) if domain.gap is None else _axis(domain.gap, _GRID, gap or 0.0)
    asked = None if domain.gap is None else gaps[None, :, None]
    table = force.forces(heights[:, None, None], asked, speeds[None, None, :])
    slopes = force.derivatives(heights[:, None], None if asked is None else gaps[None, :], speed)
    fine = np.linspace(*domain.speed, _FINE)
    line = Line(fine, force.forces(height, gap, fine), force.derivatives(height, gap, fine))
    tell("damping", 0.9)
    by_speed, by_height = (
        _damping(force, exact, heights=one, gap=gap, speeds=other)
        for one, other in ((np.array([height]), speeds), (heights, np.array([speed])))
    )
    at_design = _damping(force, exact, heights=np.array([height]), gap=gap, speeds=np.array([speed]))
    changes = () if by_speed is None else _changes(force, exact, by_speed, height=height, gap=gap)
    torques = [None, None, None] if exact is None else [
        exact.roll_torque(*at) for at in ((height, gap, speeds), (heights, gap, speed), (height, gap, speed))
    ]  # fmt: skip
    tell("done", 1.0)
    return ForceSurvey(
        title=scenario.title, name=scenario.name, model=scenario.forces.model, scenario_hash=scenario.hash, facts=facts,
        assumptions=tuple(scenario.assumptions), height=height, gap=gap, speed=speed, domain=domain, heights=heights,
        gaps=gaps, speeds=speeds, table=table, slopes=slopes, over_speed=line,
        forces=force.forces(height, gap, speed), partials=force.derivatives(height, gap, speed),
        drag_peak=_peak(force, domain, height, gap), damping_over_speed=by_speed, damping_over_height=by_height,
        heave_damping=None if at_design is None else float(at_design.heave[0]), heave_changes=changes,
        torque_over_speed=torques[0], torque_over_height=torques[1],
        torque=None if torques[2] is None else float(torques[2]),
        quality=force.quality if isinstance(force, ForceMap) else None, error=error,
        geometry=None if exact is None else _geometry(exact, height, gap),
    )  # fmt: skip


def _shown_domain(scenario: Scenario, force: AbstractForceModel) -> Domain:
    """The model's own ranges where it has any, those of the study within them where they have no end."""
    own, wanted = force.domain, study_domain(scenario, has_gap=layout(scenario.vehicle).has_walls)
    if isinstance(scenario.forces, EddyCurrentForces):
        return own

    def within(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
        low, high = max(a[0], b[0]), min(a[1], b[1])
        return (low, high) if low <= high else b

    gap = None if own.gap is None else own.gap
    if gap is not None:
        beside = scenario.operating.gap or 0.0
        gap = within(wanted.gap or (beside, beside), gap)
    return Domain(height=within(wanted.height, own.height), gap=gap, speed=within(wanted.speed, own.speed))


def _axis(span: tuple[float, float], count: int, design: float) -> FloatArray:
    """Evenly spaced values; the one nearest to the design value is moved onto it."""
    low, high = span
    if not high > low:
        return np.array([low])
    values = np.linspace(low, high, count)
    values[int(np.argmin(np.abs(values - design)))] = min(max(design, low), high)
    return values


def _damping(
    force: AbstractForceModel, exact: EddyCurrentForce | None, *, heights: FloatArray, gap: float | None,
    speeds: FloatArray,
) -> Damping | None:  # fmt: skip
    """Damping at every height and speed (one of them a single value); None where a model knows none."""
    points = [(float(h), float(v)) for h in heights for v in speeds]
    along = heights if len(heights) > 1 else speeds
    if exact is not None:
        c = np.array([exact.coefficients(h, gap, v, SLOW)[1][0] for h, v in points])
        return Damping(along, heave=c[:, 2, 2], sway=c[:, 1, 1], sway_by_heave=c[:, 1, 2], surge=c[:, 0, 0])
    found = force.derivatives([h for h, _ in points], gap, [v for _, v in points])
    vertical, lateral = found.by_vertical_velocity, found.by_lateral_velocity
    if not np.any(vertical.lift) and not np.any(lateral.guidance):
        return None
    return Damping(
        along, heave=vertical.lift, sway=lateral.guidance, sway_by_heave=vertical.guidance, surge=-found.by_speed.drag
    )


def _changes(
    force: AbstractForceModel, exact: EddyCurrentForce | None, damping: Damping, *, height: float, gap: float | None
) -> tuple[float, ...]:
    """Speeds at which c_ll changes its sign (Davis and Wilkie 1971)."""

    def heave(speed: float) -> float:
        found = _damping(force, exact, heights=np.array([height]), gap=gap, speeds=np.array([speed]))
        assert found is not None
        return float(found.heave[0])

    sign = np.sign(damping.heave)
    return tuple(
        float(brentq(heave, damping.along[i], damping.along[i + 1], xtol=1e-4))
        for i in np.flatnonzero(sign[1:] * sign[:-1] < 0.0)
    )


def _peak(force: AbstractForceModel, domain: Domain, height: float, gap: float | None) -> float | None:
    """Speed of the largest drag; None where it lies at an end of the range."""
    low, high = domain.speed
    speeds = np.geomspace(low, high, _FINE) if high > low else np.array([low])
    drag = force.forces(height, gap, speeds).drag
    at = int(np.argmax(drag))
    if at in (0, len(speeds) - 1) or not drag[at] > 0.0:
        return None
    found = minimize_scalar(
        lambda v: -float(force.forces(height, gap, v).drag),
        bounds=(speeds[at - 1], speeds[at + 1]), method="bounded", options={"xatol": 1e-6 * speeds[at]},
    )  # fmt: skip
    return float(found.x)


def _geometry(exact: EddyCurrentForce, height: float, gap: float | None) -> Geometry:
    """The cross-section with the mesh it was solved on."""
    from maglev_ctrl.fields.solve import guideway_mesh

    coils, known, beside = exact.coils, exact.response, 0.0 if gap is None else gap
    mesh = guideway_mesh(
        exact.section,
        regions=known.regions, speeds=known.speeds, frequency=known.frequency, fineness=exact.fineness,
    )  # fmt: skip
    near = box_clearance(exact.section, coils, (height, height), (beside, beside))
    return Geometry(exact.section, tuple(coil.sides(beside, height) for coil in coils), near, mesh)
