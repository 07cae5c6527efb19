"""What a force map costs: solving the guideway, mapping every force and stiffness, and asking the map.

The default guideway over heights of 5 to 50 mm and gaps of 3 to 40 mm at one speed, in two processes. `residual` is the
largest difference from the model at the points held back; `draft` and `standard` differ by `change`, the largest of
any force over a grid inside. Run with one thread a process:

    OMP_NUM_THREADS=1 python benchmarks/force_map.py [processes]
"""

from __future__ import annotations

import os
import sys
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from maglev_ctrl.fields.coil import RectangularCoil
from maglev_ctrl.fields.section import CrossSection
from maglev_ctrl.forces.eddy_current import Accuracy, EddyCurrentForce
from maglev_ctrl.forces.force_map import ForceMap
from maglev_ctrl.study.spread import spread_over

GUIDEWAY = CrossSection.l_shape(leg=76.2e-3, thickness=6.35e-3, conductivity=2.5e7)
MAGNET = RectangularCoil(length=50.8e-3, width=25.4e-3, current=6000.0, lateral=12.7e-3, height=3.175e-3)
HEIGHTS, GAPS, SPEED = (5e-3, 50e-3), (3e-3, 40e-3), 36.1
POINTS = 20_000
ACCURACIES: tuple[Accuracy, ...] = ("draft", "standard")


def row(accuracy: Accuracy, processes: int) -> tuple[ForceMap, tuple[float, ...]]:
    """A map, and the seconds to solve, to map, a point of the model and a point of the map."""
    spread = spread_over(processes)
    start = time.perf_counter()
    model = EddyCurrentForce.solve(
        GUIDEWAY, (MAGNET,), height=HEIGHTS, gap=GAPS, speed=(SPEED, SPEED), accuracy=accuracy, spread=spread
    )
    solved = time.perf_counter()
    mapped = model.map(spread=spread)
    done = time.perf_counter()
    rng = np.random.default_rng(1)
    h, g = (low + (high - low) * rng.random(POINTS) for low, high in (HEIGHTS, GAPS))
    began = time.perf_counter()
    mapped.forces(h, g, SPEED)
    mapped.derivatives(h, g, SPEED)
    asked = time.perf_counter()
    model.forces(h[:20], g[:20], SPEED)
    model.derivatives(h[:20], g[:20], SPEED)
    one = (time.perf_counter() - asked) / 20
    return mapped, (solved - start, done - solved, one, (asked - began) / POINTS)


def main(processes: int) -> int:
    """Print the table."""
    print(f"{'accuracy':>9} {'solve':>8} {'map':>8} {'nodes':>7} {'residual':>9} {'model point':>12} {'map point':>10}")
    maps = []
    for accuracy in ACCURACIES:
        mapped, (solve, made, one, asked) = row(accuracy, processes)
        nodes = "x".join(str(n) for n in mapped.quality.nodes[:2])
        print(f"{accuracy:>9} {solve:6.1f} s {made:6.1f} s {nodes:>7} {mapped.quality.worst:9.1e} "
              f"{1e3 * one:9.1f} ms {1e6 * asked:7.1f} us", flush=True)  # fmt: skip
        maps.append(mapped)
    h, g = np.meshgrid(np.linspace(*HEIGHTS, 40), np.linspace(*GAPS, 40))
    rough, fine = (one.forces(h, g, SPEED) for one in maps)
    scale = np.maximum(np.abs(fine.lift), np.abs(fine.guidance))
    change = max(float(np.max(np.abs(getattr(rough, n) - getattr(fine, n)) / scale)) for n in ("lift", "guidance"))
    print(f"change from draft to standard: {change:.1e} of the larger of lift and guidance")
    return 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 2))
