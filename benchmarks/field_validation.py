"""Eddy-current forces against closed forms at sizes where the agreement shows: the table of docs/field_validation.md.

Wide plates, long legs and thin sheets, too slow for the tests. Prints one line per row: the largest relative error of
lift (or guidance) and of drag, and the time.

    OMP_NUM_THREADS=1 python benchmarks/field_validation.py [row ...]
"""

from __future__ import annotations

import importlib.util
import os
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.fields.coil import RectangularCoil
from maglev_ctrl.fields.discretize import discretize
from maglev_ctrl.fields.mesh import triangulate
from maglev_ctrl.fields.response import GuidewayResponse, Region
from maglev_ctrl.fields.section import CrossSection
from maglev_ctrl.fields.solve import current_patterns
from maglev_ctrl.fields.wavenumbers import gauss_points, panels
from maglev_ctrl.forces.base import Domain
from maglev_ctrl.forces.eddy_current import FINENESS, Accuracy, EddyCurrentForce

FILE = Path(__file__).resolve().parents[1] / "tests" / "paper" / "closed_forms.py"
spec = importlib.util.spec_from_file_location("closed_forms", FILE)
assert spec is not None and spec.loader is not None
closed_forms = importlib.util.module_from_spec(spec)
sys.modules["closed_forms"] = closed_forms
spec.loader.exec_module(closed_forms)

CONDUCTIVITY = 2.5e7
COIL = RectangularCoil(length=50.8e-3, width=25.4e-3, current=6000.0)
Errors = tuple[float, float]


def over(thickness: float, height: float) -> closed_forms.PlateCoils:  # type: ignore[name-defined]
    """The coil over an infinite slab."""
    return closed_forms.PlateCoils([closed_forms.Placed(COIL, 0.0, height)], closed_forms.slab(thickness, CONDUCTIVITY))


def plate(
    width: float,
    thickness: float,
    heights: tuple[float, ...],
    speeds: tuple[float, ...],
    accuracy: Accuracy = "standard",
) -> Errors:
    """Lift and drag over a plate against the infinite slab."""
    section = CrossSection.plate(width=width, thickness=thickness, conductivity=CONDUCTIVITY)
    model = EddyCurrentForce.solve(
        section, (COIL,), height=(min(heights), max(heights)), gap=None, speed=(min(speeds), max(speeds)),
        accuracy=accuracy,
    )  # fmt: skip
    lift, drag = 0.0, 0.0
    for height in heights:
        closed = over(thickness, height)
        for speed in speeds:
            surge, _, heave, _ = closed.forces(speed)
            found = model.forces(height, None, speed)
            errors = abs(float(found.lift) / heave - 1.0), abs(float(found.drag) / -surge - 1.0)
            print(f"    h {1e3 * height:.4g} mm, v {speed:g} m/s: lift {errors[0]:.2e}, drag {errors[1]:.2e}")
            lift, drag = max(lift, errors[0]), max(drag, errors[1])
    return lift, drag


def unsteady() -> Errors:
    """Q_zz over a plate: modulus, and its imaginary part (the damping)."""
    section = CrossSection.plate(width=0.4, thickness=6.35e-3, conductivity=CONDUCTIVITY)
    model = EddyCurrentForce.solve(
        section, (COIL,), height=(12e-3, 12e-3), gap=None, speed=(5.0, 36.1), frequency=320.0, accuracy="draft"
    )
    whole, damping, closed = 0.0, 0.0, over(6.35e-3, 12e-3)
    for speed in (5.0, 10.0, 36.1):
        for w in 2.0 * np.pi * np.array([0.0, 5.0, 50.0]):
            found = complex(model.motion_stiffness(12e-3, None, speed, w)[0, 2, 2])
            exact = complex(closed.motion_stiffness(speed, w)[2, 2])
            whole = max(whole, abs(found / exact - 1.0))
            damping = max(damping, abs(found.imag / exact.imag - 1.0) if w else 0.0)
    return whole, damping


def perfectly_conducting(section: CrossSection, region: Region, clearance: float, share: float) -> EddyCurrentForce:
    """The limit of infinite rate on a mesh too coarse for a skin: the field is kept out of the metal, node by node."""
    fineness = replace(FINENESS["draft"], order=4)
    ends = panels(clearance, section.size)
    k = gauss_points(ends, fineness.points)
    (left, right), (low, high) = region

    def spacing(points: FloatArray) -> FloatArray:
        y, z = points.T
        dy, dz = np.maximum(np.maximum(left - y, y - right), 0.0), np.maximum(np.maximum(low - z, z - high), 0.0)
        return np.asarray(share * np.hypot(dy, dz) + 0.5 * np.maximum(section.distance(points), 0.0))

    coarsest = 0.1 * section.size
    mesh = triangulate(section, finest=0.5 * share * clearance, in_conductor=coarsest, growth=0.5, local=spacing)
    grid = discretize(mesh, np.full(len(section.conductors), CONDUCTIVITY), order=fineness.order)
    t = np.linspace(0.0, 1.0, 24)
    y, z = left + (right - left) * t, low + (high - low) * t
    sides = [(y, low + 0.0 * t), (y, high + 0.0 * t), (left + 0.0 * t, z), (right + 0.0 * t, z)]
    places = np.unique(np.concatenate([np.stack(side) for side in sides], axis=1), axis=1)
    speeds = (1e7, 1e8)
    found = [
        current_patterns(grid, one, candidates=places, speeds=speeds, frequency=0.0, fineness=fineness)
        for one in k.tolist()
    ]
    modes = max(len(one.time_constants) for one in found)
    projections, constants = np.zeros((len(k), grid.samples.shape[1], modes)), np.zeros((len(k), modes))
    for i, one in enumerate(found):
        projections[i, :, : len(one.time_constants)] = one.projection.T
        constants[i, : len(one.time_constants)] = one.time_constants
    response = GuidewayResponse(
        panels=ends, wavenumbers=k, samples=grid.samples, projections=projections, time_constants=constants,
        regions=(region,), speeds=speeds, frequency=0.0,
    )  # fmt: skip
    domain = Domain(height=(low, high), gap=(1e-6, 1.0), speed=(1.0, 1e9))
    return EddyCurrentForce(section, (COIL,), response, fineness, domain=domain)


def perfect_plate() -> Errors:
    """A plate at infinite rate against the image."""
    section = CrossSection.plate(width=0.3, thickness=25e-3, conductivity=CONDUCTIVITY)
    region = (-12.7e-3, 12.7e-3), (8e-3, 15.875e-3)
    model, worst = perfectly_conducting(section, region, 8e-3, 0.7), 0.0
    model = replace(model, domain=replace(model.domain, gap=None))
    for height in (8e-3, 15.875e-3):
        found = float(model.forces(height, None, 1e8).lift)
        worst = max(worst, abs(found / closed_forms.image_lift(COIL, height) - 1.0))
    return worst, np.nan


def perfect_corner() -> Errors:
    """A corner at infinite rate against three images: lift, guidance."""
    worst = [0.0, 0.0]
    cases = ((0.2, 5e-3, 0.35, ((17.7e-3, 10e-3),)), (0.3, 12.7e-3, 0.6, ((25.4e-3, 15.9e-3), (25.4e-3, 30e-3))))
    for leg, clearance, share, places in cases:
        section = CrossSection.l_shape(leg=leg, thickness=25e-3, conductivity=CONDUCTIVITY, outside=False)
        y, heights = places[0][0], [z for _, z in places]
        region = (y - 12.7e-3, y + 12.7e-3), (min(heights), max(heights))
        model = perfectly_conducting(section, region, clearance, share)
        for _, z in places:
            guidance, lift = closed_forms.corner_images(COIL, y, z)
            found = model.forces(z, y, 1e8)
            errors = abs(float(found.lift) / lift - 1.0), abs(float(found.guidance) / guidance - 1.0)
            print(f"    y {1e3 * y:.4g} mm, z {1e3 * z:.4g} mm: lift {errors[0]:.2e}, guidance {errors[1]:.2e}")
            worst = [max(a, b) for a, b in zip(worst, errors, strict=True)]
    return worst[0], worst[1]


ROWS: dict[str, tuple[str, Callable[[], Errors]]] = {
    "thick": (
        "plate 0.4 m x 6.35 mm, 36.1 m/s; lift, drag",
        lambda: plate(0.4, 6.35e-3, (12e-3, 15.875e-3), (36.1,)),
    ),
    "unsteady": ("Q_zz over the plate, 5 to 36.1 m/s, 0 to 50 Hz; whole, imaginary part", unsteady),
    "perfect_plate": ("plate at infinite rate; lift", perfect_plate),
    "thin": (
        "sheet 0.24 m x 2 mm, 1 to 1000 m/s; lift, drag",
        lambda: plate(0.24, 2e-3, (12e-3,), (1.0, 10.0, 32.0, 100.0, 300.0, 1000.0), "draft"),
    ),
    "perfect_corner": ("corner at infinite rate; lift, guidance", perfect_corner),
}


def main(chosen: list[str]) -> int:
    """Print the rows asked for, or all."""
    for name in chosen or list(ROWS):
        title, run = ROWS[name]
        start = time.process_time()
        first, second = run()
        print(f"{title}: {100 * first:.3f} %, {100 * second:.3f} %  ({time.process_time() - start:.0f} s)", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
