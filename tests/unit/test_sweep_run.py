"""A sweep's figures against the study's own pieces, and the store that keeps them: nothing lost, nothing mixed up."""

from __future__ import annotations

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from maglev_ctrl.analysis.floquet import floquet
from maglev_ctrl.analysis.margins import loop_margins
from maglev_ctrl.errors import ModelError, ScenarioError
from maglev_ctrl.scenario import load
from maglev_ctrl.scenario.quantity_paths import find_quantity, with_quantity
from maglev_ctrl.study.forcing import periodic_system
from maglev_ctrl.study.law import designed_option
from maglev_ctrl.study.loops import option_loops
from maglev_ctrl.study.modulation import modulation_of
from maglev_ctrl.study.situation import Situation
from maglev_ctrl.study.sweep import point as point_module
from maglev_ctrl.study.sweep import store as store_module
from maglev_ctrl.study.sweep.block import SweepTask
from maglev_ctrl.study.sweep.records import FAILED, UNSTABLE
from maglev_ctrl.study.sweep.request import sweep_request
from maglev_ctrl.study.sweep.run import run_sweep
from maglev_ctrl.study.sweep.store import STORE, SweepStore, alone, remove_store
from maglev_ctrl.systems import at_depth

GIRDER = "scenarios/periodic/girder_passing.toml"
GRID = ["speed=30:120:4", "payload=0:4t:3"]


@pytest.fixture(scope="module")
def scenario():
    return load(GIRDER)


@pytest.fixture(scope="module")
def request_(scenario):
    return sweep_request(scenario, grid=GRID, options=["bare", "windings"], parts=["modes"])


@pytest.fixture(scope="module")
def whole(scenario, request_):
    """The sweep in one block."""
    return SweepTask(scenario, request_, 12)(0)


def figures_of(store: SweepStore) -> np.ndarray:
    blocks = [store.get(index) for index in range(store.task.blocks)]
    assert all(block is not None for block in blocks)
    return np.concatenate([block.figures for block in blocks])


def column(task: SweepTask, name: str) -> int:
    return next(k for k, one in enumerate(task.columns) if one.name == name)


def test_every_figure_is_the_studys_own_at_that_point(scenario):
    """Eigenvalues, Floquet growth and margins by the pieces a report is made of, the situation set by hand."""
    request = sweep_request(
        scenario, grid=["speed=40:120:2", "vehicle.car.mass=18t:26t:2", "depth=0.05:0.15:2"], options=["windings"],
        parts=["floquet", "margins"],
    )  # fmt: skip
    task = SweepTask(scenario, request, 8)
    block = task(0)
    mass = find_quantity(scenario, "vehicle.car.mass")
    for k in (1, 2, 7):
        speed, kilograms, depth = block.quantities[k]
        changed = with_quantity(scenario, ((mass, kilograms),))
        option = next(one for one in changed.options if one.name == "windings")
        model, _ = designed_option(changed, option)
        situation = replace(Situation.of_design(changed), speed=speed)
        A = model.closed_of(model.vehicle(None), situation, None).state_matrix()
        growth = float(np.max(np.linalg.eigvals(A).real))
        bound = block.figures[k, 0, column(task, "growth_bound")]
        # Two calls of one eigenvalue solver on one matrix, balanced and not: apart by the bound at most.
        assert abs(block.figures[k, 0, column(task, "growth")] - growth) <= bound + 1e-12 * abs(growth)
        unit = periodic_system(model, model.vehicle(None), situation, None, modulation_of(changed))
        assert block.figures[k, 0, column(task, "modulated_growth")] == floquet(at_depth(unit, depth)).growth_rate
        margins = loop_margins(option_loops(model, situation, None).loop())
        assert block.figures[k, 0, column(task, "disk_margin")] == min(
            margins.multi_loop.alpha, *(one.disk.alpha for one in margins.channels)
        )
    # the mutant: a quantity that is not set leaves its figures where they were
    assert len(np.unique(block.figures[:, 0, column(task, "modulated_growth")])) == 8


def test_points_are_the_same_bit_for_bit_however_they_are_cut(scenario, request_, whole):
    for size in (1, 5):
        task = SweepTask(scenario, request_, size)
        order = list(range(task.blocks))[::-1]  # a process may get any block first
        parts = {index: task(index).figures for index in order}
        assert np.array_equal(np.concatenate([parts[k] for k in sorted(parts)]), whole.figures)


def test_processes_and_blocks_change_no_bit_and_the_counts_fit(scenario, request_, whole, tmp_path):
    with alone(tmp_path):
        study, store = run_sweep(scenario, request_, tmp_path, jobs=2, block=5)
        assert np.array_equal(figures_of(store), whole.figures)
    states = [list(one.states.values()) for one in study.options]
    assert [sum(one) for one in states] == [12, 12]
    assert study.options[0].states["unstable"] == int(np.sum(whole.figures[:, 0, 1] == UNSTABLE)) > 0


def test_a_point_that_cannot_be_computed_is_told_and_the_others_are_not_touched(scenario, monkeypatch):
    request = sweep_request(scenario, vary=["vehicle.car.mass=20t~150%"], points=40, options=["bare"], parts=["modes"],
                            method="random", seed=3)  # fmt: skip
    task = SweepTask(scenario, request, 40)
    block = task(0)
    negative = block.quantities[:, 0] <= 0.0
    assert negative.any()
    assert not negative.all()
    failed = block.figures[:, 0, 0] == FAILED
    assert np.array_equal(failed, negative)
    assert np.isnan(block.figures[failed, 0, column(task, "growth")]).all()
    assert {k for k, _, _ in block.remarks} == set(np.flatnonzero(failed).tolist())
    assert all("mass" in words for _, _, words in block.remarks)

    def broken(*arguments: object) -> None:
        raise TypeError("no such thing")

    monkeypatch.setattr(point_module, "settled_modes", broken)
    broken_block = SweepTask(scenario, request, 40)(0)
    assert (broken_block.figures[:, 0, 0] == FAILED).all()
    assert "unexpected TypeError: no such thing" in {words for _, _, words in broken_block.remarks}


def test_an_interrupted_sweep_goes_on_where_it_was(scenario, request_, whole, tmp_path):
    told: list[str] = []

    def interrupt(what: str, fraction: float) -> None:
        if fraction > 0.4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), alone(tmp_path):
        run_sweep(scenario, request_, tmp_path, block=2, progress=interrupt)
    with alone(tmp_path):
        study, store = run_sweep(
            scenario, request_, tmp_path, block=5, progress=lambda what, fraction: told.append(what)
        )  # fmt: skip
        assert np.array_equal(figures_of(store), whole.figures)
    assert study.block == 2  # as it was begun
    assert 0 < study.resumed < 6
    assert any("of them kept" in what for what in told)


@pytest.mark.parametrize("harm", ["a bit", "cut short", "emptied", "two changed places", "removed"])
def test_a_damaged_block_is_computed_anew(scenario, request_, whole, tmp_path, harm):
    with alone(tmp_path):
        run_sweep(scenario, request_, tmp_path, block=4)
    files = sorted((tmp_path / STORE / "figures" / "c").rglob("0"), key=lambda path: path.parent.name)
    files = [path for path in files if path.is_file()]
    assert len(files) == 3
    content = files[1].read_bytes()
    if harm == "a bit":
        flipped = bytearray(content)
        flipped[len(content) // 2] ^= 4
        files[1].write_bytes(bytes(flipped))
    elif harm == "cut short":
        files[1].write_bytes(content[: len(content) // 2])
    elif harm == "emptied":
        files[1].write_bytes(b"")
    elif harm == "two changed places":
        files[1].write_bytes(files[0].read_bytes())
    else:
        files[1].unlink()
    with alone(tmp_path):
        study, store = run_sweep(scenario, request_, tmp_path, block=4)
        assert np.array_equal(figures_of(store), whole.figures)
    assert study.resumed == 2
    assert study.damaged == (harm != "removed")


def test_remarks_come_back_as_they_were_and_a_lost_one_costs_its_block(scenario, tmp_path):
    request = sweep_request(scenario, vary=["vehicle.car.mass=20t~150%"], points=40, options=["bare"], parts=["modes"],
                            method="random", seed=3)  # fmt: skip
    with alone(tmp_path):
        _, store = run_sweep(scenario, request, tmp_path, block=40)
        before = store.get(0)
        assert before.remarks
        shutil.rmtree(tmp_path / STORE / "remarks" / "c")
        assert store.get(0) is None
        study, store = run_sweep(scenario, request, tmp_path)
        assert study.damaged == 1
        assert store.get(0).remarks == before.remarks


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"grid": ["speed=30:121:4", "payload=0:4t:3"]}, "the points"),
        ({"options": ["windings"]}, "the options"),
        ({"parts": ["margins"]}, "what is computed"),
    ],
)
def test_the_store_of_another_sweep_is_refused(scenario, request_, tmp_path, changes, words):
    with alone(tmp_path):
        SweepStore.open(tmp_path, SweepTask(scenario, request_, 4))
    asked = {"grid": GRID, "options": ["bare", "windings"], "parts": ["modes"], **changes}
    with alone(tmp_path), pytest.raises(ScenarioError, match=f"another sweep, which differs in .*{words}"):
        run_sweep(scenario, sweep_request(scenario, **asked), tmp_path)


def test_another_scenario_and_another_code_are_refused(scenario, request_, tmp_path, monkeypatch):
    with alone(tmp_path):
        SweepStore.open(tmp_path, SweepTask(scenario, request_, 4))
    mass = find_quantity(scenario, "vehicle.car.mass")
    text = Path(GIRDER).read_text(encoding="utf-8")
    heavier = tmp_path / "heavier.toml"
    heavier.write_text(text.replace('speed = "505 km/h"', 'speed = "504 km/h"'), encoding="utf-8")
    assert mass.value > 0.0
    other = load(heavier)
    assert other.hash != scenario.hash
    asked = sweep_request(other, grid=GRID, options=["bare", "windings"], parts=["modes"])
    with alone(tmp_path), pytest.raises(ScenarioError, match="differs in the scenario or its data files"):
        run_sweep(other, asked, tmp_path)
    from maglev_ctrl.study.sweep import identity

    monkeypatch.setattr(identity, "code_digest", lambda: "0" * 64)
    with alone(tmp_path), pytest.raises(ScenarioError, match="differs in the code of maglev_ctrl; choose"):
        run_sweep(scenario, request_, tmp_path)


def test_two_sweeps_do_not_write_one_store(tmp_path):
    with (
        alone(tmp_path),
        pytest.raises(ScenarioError, match="another sweep is writing into this folder"),
        alone(tmp_path),
    ):
        pass
    with alone(tmp_path):  # the lock went with the one that held it
        pass


def test_a_store_that_is_damaged_or_a_strangers_is_refused_in_a_sentence(scenario, request_, tmp_path):
    task = SweepTask(scenario, request_, 4)
    harms = {
        "zarr.json": [b"", b"{", b"[]", b'{"zarr_format": 3, "node_type": "group", "attributes": {"about": "1"}}'],
        "figures/zarr.json": [b"", b"{}", b'{"codecs": [{"name": "pickle"}]}'],
    }
    for place, contents in harms.items():
        for content in contents:
            remove_store(tmp_path)
            SweepStore.open(tmp_path, task)
            (tmp_path / STORE / place).write_bytes(content)
            with pytest.raises(ScenarioError, match="the store is damaged") as caught:
                SweepStore.begun_in(tmp_path)
                SweepStore.open(tmp_path, task)
            assert "\n" not in str(caught.value)
    remove_store(tmp_path)
    SweepStore.open(tmp_path, task)
    about = tmp_path / STORE / "figures" / "zarr.json"
    said = json.loads(about.read_text())
    said["shape"] = [10**12, said["shape"][1]]
    about.write_text(json.dumps(said))
    with pytest.raises(ScenarioError, match="its arrays have another shape"):
        SweepStore.open(tmp_path, task)


def test_a_full_disk_stops_the_sweep_with_a_sentence_and_keeps_what_is_done(
    scenario, request_, whole, tmp_path, monkeypatch
):
    real, calls = os.replace, []
    import zarr.storage._local as local

    def full(path: Path, *arguments: object, **options: object) -> object:
        if "figures/c" in path.as_posix():
            calls.append(path)
            if len(calls) > 2:
                raise OSError(28, "No space left on device")
        return put(path, *arguments, **options)

    put = local._put
    monkeypatch.setattr(local, "_put", full)
    with alone(tmp_path), pytest.raises(ModelError, match="No space left on device; what is done is kept"):
        run_sweep(scenario, request_, tmp_path, block=2)
    monkeypatch.setattr(local, "_put", put)
    assert os.replace is real
    with alone(tmp_path):
        study, store = run_sweep(scenario, request_, tmp_path, block=2)
        assert study.resumed == 2
        assert np.array_equal(figures_of(store), whole.figures)


def test_a_folder_that_is_removed_does_not_come_to_life_again(scenario, request_, tmp_path):
    folder = tmp_path / "gone"

    def remove(what: str, fraction: float) -> None:
        if fraction > 0.4:
            shutil.rmtree(folder, ignore_errors=True)

    with pytest.raises(ModelError, match="the store was removed while the sweep ran"), alone(folder):
        run_sweep(scenario, request_, folder, block=2, progress=remove)
    assert not (folder / STORE / "figures" / "zarr.json").exists()


def test_a_clock_that_jumps_changes_nothing(scenario, request_, whole, tmp_path, monkeypatch):
    import time

    jumps = iter(range(10**6))
    monkeypatch.setattr(time, "time", lambda: 1e9 + (-1.0) ** next(jumps) * 1e7)
    with alone(tmp_path):
        study, store = run_sweep(scenario, request_, tmp_path, block=4)
        assert np.array_equal(figures_of(store), whole.figures)
    assert 0.0 < study.busy <= study.seconds < 1e5


def test_the_store_opens_in_any_reader_of_zarr(scenario, request_, whole, tmp_path):
    import zarr

    with alone(tmp_path):
        run_sweep(scenario, request_, tmp_path, block=5)
    group = zarr.open_group(tmp_path / STORE, mode="r")
    table = np.asarray(group["figures"])
    assert np.array_equal(table[:, :2], request_.values(0, 12))
    assert json.loads(group.attrs["about"])["options"] == ["bare", "windings"]
    assert group["remarks"].shape[2] == store_module.REMARK
