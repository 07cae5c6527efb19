"""Processes that die while a sweep runs, on this machine and on a cluster: no block is lost, none comes twice."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest
from local_cluster import LocalCluster
from sweep_tasks import Sleep

from maglev_ctrl.errors import ModelError
from maglev_ctrl.scenario import load
from maglev_ctrl.study.sweep import cluster as cluster_module
from maglev_ctrl.study.sweep.block import SweepTask
from maglev_ctrl.study.sweep.cluster import on_cluster
from maglev_ctrl.study.sweep.local import ATTEMPTS, on_this_machine
from maglev_ctrl.study.sweep.request import sweep_request
from maglev_ctrl.study.sweep.run import lost_block, run_sweep
from maglev_ctrl.study.sweep.store import alone
from maglev_ctrl.study.workers import Lost

pytestmark = [
    # Clients of Dask leave sockets to the collector when a scheduler is killed under them.
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    made = LocalCluster(tmp_path_factory.mktemp("dask"), workers=2)
    made.wait_for_workers(2)
    yield made
    made.close()


def indices(results) -> list[int]:
    return sorted(index for index, _ in results)


def test_a_process_that_dies_costs_its_block_only_once(tmp_path):
    task = Sleep(0.01, deadly=2, times=1, notes=str(tmp_path))
    found = list(on_this_machine(task, range(6), jobs=2))
    assert indices(found) == list(range(6))
    assert not any(isinstance(block, Lost) for _, block in found)


def test_a_block_that_kills_every_process_is_told_and_the_others_are_there(tmp_path):
    task = Sleep(0.01, deadly=2, times=ATTEMPTS, notes=str(tmp_path))
    found = dict(on_this_machine(task, range(5), jobs=2))
    assert sorted(found) == list(range(5))
    assert [index for index, block in found.items() if isinstance(block, Lost)] == [2]
    assert "was killed (SIGKILL)" in found[2].reason


def test_the_points_of_a_lost_block_say_why():
    scenario = load("scenarios/periodic/girder_passing.toml")
    request = sweep_request(scenario, grid=["speed=30:120:5"], options=["bare", "windings"], parts=["modes"])
    block = lost_block(SweepTask(scenario, request, 2), 2, "not studied: its process was killed")
    assert block.figures.shape[:2] == (1, 2)
    assert np.isnan(block.figures[0, 0, 2])
    assert block.remarks == (
        (0, 0, "not studied: its process was killed"),
        (0, 1, "not studied: its process was killed"),
    )


def test_the_cluster_gives_the_same_numbers_bit_for_bit(cluster, tmp_path):
    scenario = load("scenarios/periodic/girder_passing.toml")
    request = sweep_request(scenario, grid=["speed=30:120:9"], options=["bare"], parts=["modes"])
    here = SweepTask(scenario, request, 9)(0)
    with alone(tmp_path):
        study, store = run_sweep(scenario, request, tmp_path, cluster=cluster.address, block=2)
        there = np.concatenate([store.get(k).figures for k in range(5)])
    assert np.array_equal(there, here.figures)
    assert study.workers == cluster.address


def test_a_worker_of_the_cluster_is_killed(cluster):
    task = Sleep(0.15)
    found: list[int] = []
    for index, block in on_cluster(task, range(24), address=cluster.address):
        assert not isinstance(block, Lost)
        found.append(index)
        if len(found) == 4:
            cluster.kill(cluster.workers[0])
            cluster.workers[0] = cluster._start("worker", cluster.address, "--nthreads", "1")
    assert sorted(found) == list(range(24))


def test_the_scheduler_is_killed_and_started_again(cluster):
    said: list[str] = []
    found: list[int] = []

    def again() -> None:
        time.sleep(1.0)
        for worker in cluster.workers:
            cluster.kill(worker)
        cluster.start_scheduler()
        cluster.start_workers()

    for index, block in on_cluster(Sleep(0.1), range(20), address=cluster.address, say=said.append):
        assert not isinstance(block, Lost)
        found.append(index)
        if len(found) == 5:
            cluster.kill(cluster.scheduler)
            threading.Thread(target=again, daemon=True).start()
    assert sorted(found) == list(range(20))
    assert any("the scheduler is gone" in words for words in said)
    cluster.wait_for_workers(2)


def test_workers_with_other_code_do_not_take_part(cluster, monkeypatch):
    monkeypatch.setattr(cluster_module, "code_identity", lambda: {"version": "9.9", "code": "x", "libraries": "y"})
    with pytest.raises(ModelError, match=r"worker tcp://.* differs in the version of maglev_ctrl and the code"):
        list(on_cluster(Sleep(0.0), range(2), address=cluster.address))


def test_a_scheduler_that_is_not_there_is_told(monkeypatch):
    monkeypatch.setattr(cluster_module, "_CONNECT", 0.5)
    with pytest.raises(ModelError, match=r"tcp://127\.0\.0\.1:9: no Dask scheduler answers there"):
        list(on_cluster(Sleep(0.0), range(2), address="tcp://127.0.0.1:9"))


def test_a_cluster_that_stays_away_ends_the_sweep(cluster, monkeypatch):
    monkeypatch.setattr(cluster_module, "_CONNECT", 0.5)
    with pytest.raises(ModelError, match="the cluster went away and did not come back"):
        for number, _ in enumerate(on_cluster(Sleep(0.1), range(20), address=cluster.address, patience=1.0)):
            if number == 2:
                cluster.kill(cluster.scheduler)
