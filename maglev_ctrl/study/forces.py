"""What stands behind the forces of a study, in words: model, domain, how well a table was fitted."""

from __future__ import annotations

from typing import assert_never

from maglev_ctrl.fields.section import CrossSection
from maglev_ctrl.forces import Domain, FitQuality, MagnetForces, TabulatedForce
from maglev_ctrl.forces.electromagnet import Electromagnet, circuit
from maglev_ctrl.forces.force_map import ForceMap
from maglev_ctrl.scenario import Scenario
from maglev_ctrl.scenario.eddy_current import section_of
from maglev_ctrl.scenario.force_schema import (
    CoefficientForces,
    CornerImageForces,
    ElectromagnetForces,
    ImageForces,
    TableForces,
)
from maglev_ctrl.scenario.guideway_schema import EddyCurrentForces
from maglev_ctrl.vehicle import Vehicle


def describe_forces(scenario: Scenario, vehicle: Vehicle) -> tuple[str, ...]:
    """The scenario's force model, one line a fact; for a table its residuals, its check and its domain."""
    forces = scenario.forces
    match forces:
        case ImageForces():
            lines = [f"Image force (Eq. 15), exponent n = {forces.exponent:g}, all partial derivatives exact."]
            if forces.vertical_velocity == "receding_image":
                lines.append("Vertical velocity through receding images of a line current over a thin sheet.")
            return tuple(lines)
        case CornerImageForces():
            return ("Coil in a perfectly conducting corner: the limit of infinite speed, conservative, no drag.",)
        case EddyCurrentForces():
            return _eddy_current(forces, vehicle)
        case ElectromagnetForces():
            return _electromagnet(scenario, vehicle)
        case CoefficientForces():
            return ("Magnetic mass, damping and stiffness matrices as given (Eq. 11).",)
        case TableForces():
            return _table(forces, vehicle)
        case _ as never:
            assert_never(never)


def domain_words(domain: Domain) -> str:
    """The ranges of a force model, in a sentence.

    Examples
    --------
    >>> domain_words(Domain(height=(0.005, 0.05), gap=None, speed=(10.0, 100.0)))
    'Domain: height 5 to 50 mm, speed 36 to 360 km/h; nothing is extrapolated.'
    """
    gap = "" if domain.gap is None else f", gap {domain.gap[0] * 1e3:.4g} to {domain.gap[1] * 1e3:.4g} mm"
    return (
        f"Domain: height {domain.height[0] * 1e3:.4g} to {domain.height[1] * 1e3:.4g} mm{gap}, "
        f"speed {domain.speed[0] * 3.6:.4g} to {domain.speed[1] * 3.6:.4g} km/h; nothing is extrapolated."
    )


def _eddy_current(forces: EddyCurrentForces, vehicle: Vehicle) -> tuple[str, ...]:
    lines = [
        "Eddy currents in the guideway's metal, finite elements in its cross-section for each wavenumber along the "
        f"track ({forces.accuracy}); quasi-static: no damping by the magnets' own vertical or lateral motion.",
        section_words(section_of(forces.guideway), forces.guideway.shape),
        "Scaled so that the magnets lift the weight." if not forces.absolute else "Currents as given.",
    ]
    for model in (magnet.force for magnet in vehicle.magnets[:1]):
        if isinstance(model, ForceMap):
            lines += [map_words(model), domain_words(model.domain)]
    return tuple(lines)


def _electromagnet(scenario: Scenario, vehicle: Vehicle) -> tuple[str, ...]:
    """The magnets and what they need at the design point, as they are sized there."""
    height, lines = scenario.operating.height, []
    for magnet in vehicle.magnets[:1]:
        if isinstance(magnet.force, Electromagnet):
            one = circuit(magnet.force, height)
            windings = sum(each.count for each in vehicle.magnets)
            power = windings * one.power
            lift = windings * one.force / vehicle.gravity
            lines = [
                f"Attractive electromagnets under a rail, driven by {magnet.force.drive}; heights are their air gaps, "
                "which close where the vehicle rises. No fringing, no drag, no lateral force.",
                f"At {height * 1e3:.4g} mm each of {windings:g} windings carries {one.current:.4g} A at "
                f"{one.voltage:.4g} V, with {float(magnet.force.flux_density(height)):.3g} T in the gap and "
                f"{one.inductance * 1e3:.4g} mH; together {power / 1e3:.4g} kW, {power / lift:.3g} W per kg lifted.",
                f"Force per current {one.force_by_current:.4g} N/A, which is also the voltage per speed; stiffness "
                f"{-one.force_by_closing / 1e6:.4g} MN/m per winding: a gap that opens loses force.",
                "A force table knows no rail: read as one, these forces would float over a guideway.",
            ]
    return tuple(lines)


def section_words(section: CrossSection, shape: str) -> str:
    """A guideway's cross-section, in a sentence."""
    low, high = section.bounds
    across, up = (high - low) * 1e3
    metals = sorted({one.conductivity for one in section.conductors})
    metal = " and ".join(f"{value / 1e6:.4g} MS/m" for value in metals)
    pieces = "" if len(section.conductors) == 1 else f", {len(section.conductors)} conductors"
    return f"Guideway: {shape.replace('_', ' ')}, {across:.4g} mm across and {up:.4g} mm high{pieces}, {metal}."


def map_words(found: ForceMap) -> str:
    """How far a map is from the forces it was made of, in a sentence."""
    q = found.quality
    return (
        f"A map of the forces, {q.nodes[0]} x {q.nodes[1]} x {q.nodes[2]} nodes: at {q.checks} points held back, ends "
        f"of the ranges included, it is off by at most {100.0 * q.forces:.2g} % in lift or guidance, "
        f"{100.0 * q.drag:.2g} % in drag, {100.0 * q.stiffness:.2g} % in a stiffness."
    )


def _table(forces: TableForces, vehicle: Vehicle) -> tuple[str, ...]:
    models = [magnet.force for magnet in vehicle.magnets if isinstance(magnet.force, TabulatedForce)]
    if not models:
        return ()
    table = models[0]
    quality, domain = table.quality, table.domain
    return (
        f"Force table {forces.file}: {quality.samples} samples, {table.method} fit.",
        domain_words(domain),
        f"Largest residual of the fit: {_parts(quality.residual_max)}.",
        _check(quality),
    )


def _check(quality: FitQuality) -> str:
    if quality.check_max is None:
        return "The table is too small to check the fit against samples it was not shown."
    return f"Largest error against samples the fit was not shown ({quality.check}): {_parts(quality.check_max)}."


def _parts(errors: MagnetForces) -> str:
    return ", ".join(
        f"{name} {float(getattr(errors, name)):.3g} N" for name in ("lift", "guidance", "drag")
    )  # fmt: skip
