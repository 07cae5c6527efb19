"""Time from a slider's new value to the view on the workbench page, against computing the same map and modes anew.

A random walk moves one slider after another, each drawn with the same chance; every step is one `LiveStudy.preview`
with a map of 100 x 100. Theirs: `stability_plane` with every point computed, and the modes at every speed of the
tracks. The options have maps of 4, 12 and 20 states. Median and 90 % of the steps in milliseconds of wall time, the
median of the steps that move more than speed and depth (those two only move a marker), and that of the processor time
of all steps, which other work on the machine disturbs less. At some steps the states of the map are compared: a point
counts as wrong where its state differs and it lies farther than one point from an edge of an unstable region of the
checked map.

The exit status is 1 if any point is wrong. Run with one thread in BLAS:

    OMP_NUM_THREADS=1 python benchmarks/live_update.py
"""

from __future__ import annotations

import os
import sys
import time
from dataclasses import replace

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy import ndimage

from maglev_ctrl.analysis.modes import modes
from maglev_ctrl.analysis.plane_records import UNSTABLE
from maglev_ctrl.scenario import load
from maglev_ctrl.study.live import LiveQuantity, LiveStudy, LiveView
from maglev_ctrl.study.live.designed import designed
from maglev_ctrl.study.live.fast_map import plane_of
from maglev_ctrl.study.situation import Situation

STEPS = 40
COMPARED = 3
WARM = 4
CASES = (
    (4, "scenarios/compare/warwick_30t.toml", "secondary_damper"),
    (12, "scenarios/compare/eds_135t.toml", "combined"),
    (20, "scenarios/compare/eds_135t.toml", "active_primary_lqg"),
)
STILL = ("speed", "depth")


def moved(quantity: LiveQuantity, value: float, rng: np.random.Generator) -> float:
    """A step of a tenth of the slider either way, kept within its ends."""
    if quantity.logarithmic:
        low, high, at = np.log(quantity.low), np.log(quantity.high), np.log(value)
        return float(np.exp(np.clip(at + rng.uniform(-0.1, 0.1) * (high - low), low, high)))
    return float(
        np.clip(value + rng.uniform(-0.1, 0.1) * (quantity.high - quantity.low), quantity.low, quantity.high)
    )  # fmt: skip


def anew(study: LiveStudy, view: LiveView) -> tuple[float, int]:
    """Seconds the whole computation takes at the values of a view, and how many points of the view are wrong."""
    assert view.map is not None and view.tracks is not None
    chosen = {one.name: one.value for one in view.values}
    changes = study._changes(chosen)
    started = time.perf_counter()
    own = designed(study.scenario, study.option_name, changes)
    moved_there = {name: chosen[name] for name in ("speed", "height", "gap", "payload") if name in chosen}
    situation = replace(Situation.of_design(study.scenario), **moved_there)
    plane = plane_of(own, situation, view.map.speed, view.map.depth, checks=0)
    for speed in view.tracks.parameter:
        modes(own.closed(replace(situation, speed=float(speed)))[0])
    seconds = time.perf_counter() - started
    exact, fast = plane.state.T, view.map.state
    square, unstable = np.ones((3, 3), dtype=bool), exact == UNSTABLE
    edge = ndimage.binary_dilation(unstable, square) & ndimage.binary_dilation(~unstable, square)
    return seconds, int(np.sum((fast != exact) & ~edge))


def main() -> int:
    """Print the table; 1 if a map is wrong."""
    wrong = 0
    print("   n   median   90 %   moving more than the marker   processor   anew   ratio   wrong points")
    for n, path, option in CASES:
        study, rng = LiveStudy(load(path), option), np.random.default_rng(n)
        quantities = study.quantities()
        values = {one.name: one.value for one in quantities}
        wall, heavy, processor, theirs, bad = [], [], [], [], 0
        for step in range(WARM + STEPS):
            quantity = quantities[int(rng.integers(len(quantities)))]
            values[quantity.name] = moved(quantity, values[quantity.name], rng)
            begin, used = time.perf_counter(), time.process_time()
            view = study.preview(values)
            took, used = time.perf_counter() - begin, time.process_time() - used
            if view.failure or view.map is None:
                print(f"{view.failure or view.map_reason}", file=sys.stderr)
                return 1
            if step < WARM:
                continue
            wall.append(took)
            processor.append(used)
            if quantity.name not in STILL:
                heavy.append(took)
            if step % (STEPS // COMPARED) == 0:
                seconds, points = anew(study, view)
                theirs.append(seconds)
                bad += points
        median = float(np.median(wall))
        print(
            f"{n:4d} {1e3 * median:6.0f} ms {1e3 * np.quantile(wall, 0.9):4.0f} ms {1e3 * np.median(heavy):23.0f} ms "
            f"{1e3 * np.median(processor):11.0f} ms {1e3 * np.median(theirs):5.0f} ms "
            f"{np.median(theirs) / np.median(heavy):5.1f} {bad:10d}"
        )
        wrong += bad
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
