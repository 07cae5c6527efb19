"""What stands behind the forces of a study, in words: model, domain, how well a table was fitted."""

from __future__ import annotations

from typing import assert_never

from maglev_ctrl.forces import FitQuality, MagnetForces, TabulatedForce
from maglev_ctrl.scenario import Scenario
from maglev_ctrl.scenario.force_schema import CoefficientForces, CornerImageForces, ImageForces, TableForces
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
        case CoefficientForces():
            return ("Magnetic mass, damping and stiffness matrices as given (Eq. 11).",)
        case TableForces():
            return _table(forces, vehicle)
        case _ as never:
            assert_never(never)


def _table(forces: TableForces, vehicle: Vehicle) -> tuple[str, ...]:
    models = [magnet.force for magnet in vehicle.magnets if isinstance(magnet.force, TabulatedForce)]
    if not models:
        return ()
    table = models[0]
    quality, domain = table.quality, table.domain
    gap = "" if domain.gap is None else f", gap {domain.gap[0] * 1e3:.4g} to {domain.gap[1] * 1e3:.4g} mm"
    return (
        f"Force table {forces.file}: {quality.samples} samples, {table.method} fit.",
        f"Domain: height {domain.height[0] * 1e3:.4g} to {domain.height[1] * 1e3:.4g} mm{gap}, "
        f"speed {domain.speed[0] * 3.6:.4g} to {domain.speed[1] * 3.6:.4g} km/h; nothing is extrapolated.",
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
