"""What a sweep costs beside its points: storing, reading, writing NetCDF, sending a block over a cluster.

No peer is measured: these are the figures that docs/guides/scale_sweeps.md argues with. Run it on a quiet machine.
"""

from __future__ import annotations

import os
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from maglev_ctrl.report.sweep.arrays import write_netcdf
from maglev_ctrl.scenario import load
from maglev_ctrl.study.sweep.block import SweepTask
from maglev_ctrl.study.sweep.cluster import on_cluster
from maglev_ctrl.study.sweep.records import SweepBlock
from maglev_ctrl.study.sweep.request import sweep_request
from maglev_ctrl.study.sweep.run import Tally, run_sweep
from maglev_ctrl.study.sweep.store import SweepStore, alone

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "unit"))
SCENARIO = ROOT / "scenarios" / "compare" / "warwick_30t.toml"


def main() -> int:
    scenario = load(SCENARIO)
    for points, size in ((20_000, 10), (200_000, 100), (2_000_000, 1000)):
        request = sweep_request(scenario, grid=[f"speed=20:150:{points // 100}", "payload=0:20t:100"], parts=["modes"])
        task = SweepTask(scenario, request, size)
        columns, options = len(task.columns), len(request.options)
        with tempfile.TemporaryDirectory() as place, alone(Path(place)):
            store, tally = SweepStore.open(Path(place), task), Tally(task)
            put = get = 0.0
            for index in range(task.blocks):
                quantities = request.values(*task.span(index))
                figures = np.full((len(quantities), options, columns), 0.25)
                block = SweepBlock(index, quantities, figures, (), 1.0)
                started = time.perf_counter()
                store.put(block)
                tally.add(block)
                put += time.perf_counter() - started
            started = time.perf_counter()
            for index in range(task.blocks):
                assert store.get(index) is not None
            get = time.perf_counter() - started
            size_on_disk = sum(path.stat().st_size for path in store.path.rglob("*") if path.is_file())
            study, _ = run_sweep(scenario, request, Path(place))
            before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            started = time.perf_counter()
            write_netcdf(Path(place) / "sweep.nc", study, store)
            netcdf = time.perf_counter() - started
            grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024.0
        print(
            f"{points:>9} points, {options} options, blocks of {size}: kept in {1e3 * put / task.blocks:.2f} ms a "
            f"block, read in {1e3 * get / task.blocks:.2f} ms, {size_on_disk / points:.0f} bytes a point, NetCDF in "
            f"{1e6 * netcdf / points:.1f} us a point and {grown:.0f} MiB more memory", flush=True,
        )  # fmt: skip
    return over_a_cluster()


def over_a_cluster() -> int:
    from local_cluster import LocalCluster
    from sweep_tasks import Sleep, Work

    with tempfile.TemporaryDirectory() as place:
        cluster = LocalCluster(Path(place), workers=2)
        try:
            cluster.wait_for_workers(2)
            list(on_cluster(Sleep(0.0), range(20), address=cluster.address))
            started = time.perf_counter()
            count = len(list(on_cluster(Sleep(0.0), range(500), address=cluster.address)))
            empty = (time.perf_counter() - started) / count
            print(f"an empty block over a cluster: {1e3 * empty:.1f} ms of the driver, scheduler and worker together")
            started = time.perf_counter()
            blocks = [block for _, block in on_cluster(Work(1.0), range(30), address=cluster.address)]
            wall, busy = time.perf_counter() - started, sum(block.seconds for block in blocks) / 2.0
            more = 100.0 * (wall / busy - 1.0)
            print(f"30 blocks of 1 s on 2 workers: {wall:.1f} s for {busy:.1f} s of work each, {more:.1f} % more")
        finally:
            cluster.close()
    return 0


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    sys.exit(main())
