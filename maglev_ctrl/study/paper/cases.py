"""Guideways the paper leaves open: the default, what else it could have been, and the two with one leg lengthened."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import pi
from typing import Final

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.forces import AbstractForceModel, CornerImageForce, Domain
from maglev_ctrl.study.paper.magnet_forces import SPEED
from maglev_ctrl.study.paper.records import GuidewayCase, SolvedCase

LEG: Final = 76.2e-3  # S of Sec. 4.4, m
COIL_LENGTH: Final = 50.8e-3
COIL_WIDTH: Final = 25.4e-3
MAGNET_THICKNESS: Final = 6.35e-3
CURRENT: Final = 6000.0
HEIGHT_RANGE: Final = (5e-3, 45e-3)
GAP_RANGE: Final = (5e-3, 45e-3)
SPEED_RANGE: Final = (5.0, 100.0)
SOLVED_RANGE: Final = (4e-3, 48e-3)  # m, of heights and gaps: wider than what is used, accuracy falls off at its ends
HIGHEST_FREQUENCY: Final = 10.0 * 2.0 * pi  # rad/s, of the magnet's own motion
# A map is worst at the ends of its range, so that it reaches a little farther than it is asked.
MAPPED_RANGE: Final = (4.2e-3, 47e-3)
_CHECKS: Final = 24


_D: Final = 6.35e-3
DEFAULT: Final = GuidewayCase(
    "default", "default", thickness=_D, wall=LEG - _D, floor=LEG - _D, conductivity=2.5e7,
    loop_height=0.5 * MAGNET_THICKNESS,
)  # fmt: skip

ASSUMPTIONS: Final = (
    "Both legs are 6.35 mm thick; the paper gives no thickness.",
    "76.2 mm is the outside length of a leg (69.85 mm inside); the paper does not say which it is.",
    "The levitation height is measured to the magnet's bottom face, its equivalent loop lies 3.175 mm higher; the "
    "guidance gap from the magnet's side face to the inner face of the lateral leg.",
    "The conductivity of 6061-T6 aluminium is 25 MS/m.",
    "The wheel's guideway is straight and uniform along the track, and electrically one piece at the corner.",
    "The magnet is one rectangular loop of 25.4 mm by 50.8 mm with 6000 A at mid-height, as the paper found it to be.",
)


def _with_thickness(name: str, factor: float) -> GuidewayCase:
    d = factor * _D
    label = f"thickness {1e3 * d:.2f} mm ({100 * (factor - 1):+.0f} %)"
    return replace(DEFAULT, name=name, label=label, thickness=d, wall=LEG - d, floor=LEG - d, question="sensitivity")


def _with_conductivity(name: str, factor: float) -> GuidewayCase:
    label = f"conductivity {25.0 * factor:.1f} MS/m ({100 * (factor - 1):+.0f} %)"
    return replace(DEFAULT, name=name, label=label, conductivity=factor * DEFAULT.conductivity, question="sensitivity")


LONG_WALL: Final = replace(
    DEFAULT, name="long_wall", label="lateral leg twice as long", wall=2.0 * DEFAULT.wall, question="edge"
)
LONG_FLOOR: Final = replace(
    DEFAULT, name="long_floor", label="lift leg twice as long", floor=2.0 * DEFAULT.floor, question="edge"
)
SENSITIVITY: Final = (
    _with_thickness("thin", 0.8),
    _with_thickness("thick", 1.2),
    replace(DEFAULT, name="inside", label="76.2 mm is the inside length", wall=LEG, floor=LEG, question="sensitivity"),
    replace(DEFAULT, name="mid_height", label="h is measured to mid-height", loop_height=0.0, question="sensitivity"),
    _with_conductivity("poor", 0.9),
    _with_conductivity("good", 1.1),
)

Provider = Callable[[GuidewayCase], SolvedCase]
"""Solves the forces of a case; of a module's top level, so that another process can import it."""


def outline(case: GuidewayCase) -> list[tuple[float, float]]:
    """Vertices (y, z) of the L, m: lateral leg at y in [-d, 0], lift leg at z in [-d, 0], counter-clockwise.

    Examples
    --------
    >>> [round(max(column), 5) for column in zip(*outline(LONG_FLOOR), strict=True)]
    [0.1397, 0.06985]
    """
    d = case.thickness
    return [(-d, -d), (case.floor, -d), (case.floor, 0.0), (0.0, 0.0), (0.0, case.wall), (-d, case.wall)]


def eddy_current(case: GuidewayCase) -> SolvedCase:
    """Forces of a case from the eddy currents in its metal, by finite elements in the cross-section."""
    from maglev_ctrl.fields.coil import RectangularCoil
    from maglev_ctrl.fields.section import Conductor, CrossSection
    from maglev_ctrl.forces.eddy_current import EddyCurrentForce
    from maglev_ctrl.forces.force_map import ForceMap

    section = CrossSection((Conductor("L", np.array(outline(case)), case.conductivity),))
    coil = RectangularCoil(
        length=COIL_LENGTH, width=COIL_WIDTH, current=CURRENT, lateral=0.5 * COIL_WIDTH, height=case.loop_height
    )
    solved = EddyCurrentForce.solve(
        section, (coil,),
        height=SOLVED_RANGE, gap=SOLVED_RANGE, speed=SPEED_RANGE, frequency=HIGHEST_FREQUENCY,
        # Other cases are compared with the paper's to a tenth of a millimetre; only its own has to be better.
        accuracy="draft" if case.question else "standard",
    )  # fmt: skip
    mapped = Domain(height=MAPPED_RANGE, gap=MAPPED_RANGE, speed=(SPEED, SPEED))
    swift = ForceMap.of(replace(solved, domain=mapped))
    forces, stiffness = map_residuals(swift, solved)
    method = (
        "eddy currents in the guideway's metal by 2.5-D finite elements in its cross-section, one solve a wavenumber "
        "(about 0.2 %); the magnet is a rectangular current loop. Curves and boundaries use a map of them at "
        f"{SPEED:g} m/s, which at {_CHECKS} points held back, ends of the range included, differs by at most "
        f"{100.0 * forces:.2g} % in a force and {100.0 * stiffness:.2g} % in a stiffness"
    )
    return SolvedCase(case, swift, solved, solved, method)


def map_residuals(swift: AbstractForceModel, solved: AbstractForceModel) -> tuple[float, float]:
    """Largest relative differences of a map from its model, in force and in stiffness, over the range that is used.

    Forces to the larger of lift and guidance, stiffnesses to the largest of the four, at points of a fixed sequence.
    """
    places = np.random.default_rng(7).random((2, _CHECKS))
    places[:, :4] = [[0.0, 0.0, 1.0, 1.0], [0.0, 1.0, 0.0, 1.0]]
    places[0, 4:7], places[1, 7:10] = 0.0, 0.0
    ranges = (HEIGHT_RANGE, GAP_RANGE)
    h, g = (low + (high - low) * part for (low, high), part in zip(ranges, places, strict=True))

    def both(model: AbstractForceModel) -> tuple[FloatArray, FloatArray]:
        forces, slopes = model.forces(h, g, SPEED), model.derivatives(h, g, SPEED)
        ways = (slopes.by_height, slopes.by_gap)
        stiffnesses = [part for way in ways for part in (way.lift, way.guidance)]
        return np.stack([forces.lift, forces.guidance]), np.stack(stiffnesses)

    residuals = [
        float(np.max(np.abs(got - true) / np.max(np.abs(true), axis=0)))
        for got, true in zip(both(swift), both(solved), strict=True)
    ]
    return residuals[0], residuals[1]


def perfect_conductor(case: GuidewayCase) -> SolvedCase:
    """The limit of infinite speed and infinite legs: a perfectly conducting corner, whatever the case's metal.

    Examples
    --------
    >>> bool(perfect_conductor(DEFAULT).force.forces(0.0127, 0.0127, 36.1).lift > 8.0)
    True
    """
    coil = CornerImageForce(CURRENT, length=COIL_LENGTH, width=COIL_WIDTH, thickness=2.0 * case.loop_height)
    return SolvedCase(case, coil, None, None, "three image loops in a perfectly conducting corner with endless legs")
