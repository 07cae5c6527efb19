"""The page and the arrays of a sweep: every point in its place, every share counted once, nothing said that was not."""

from __future__ import annotations

import json

import numpy as np
import pytest
import xarray

from maglev_ctrl.report.sweep import arrays as arrays_module
from maglev_ctrl.report.sweep.content import counts_table, sweep_report
from maglev_ctrl.report.sweep.digest import SweepDigest, share_interval
from maglev_ctrl.report.sweep.folder import json_text, write_sweep
from maglev_ctrl.scenario import load
from maglev_ctrl.study.sweep import block as block_module
from maglev_ctrl.study.sweep.block import SweepTask
from maglev_ctrl.study.sweep.records import NO_ANSWER, STABLE, UNSTABLE, SweepBlock
from maglev_ctrl.study.sweep.request import sweep_request
from maglev_ctrl.study.sweep.run import run_sweep
from maglev_ctrl.study.sweep.store import alone, remove_store

GIRDER = "scenarios/periodic/girder_passing.toml"


@pytest.fixture(scope="module")
def scenario():
    return load(GIRDER)


@pytest.fixture
def known(monkeypatch):
    """Sweeps whose figures are functions of their quantities, so that the place of each can be checked."""

    def at(self, index, quantities, *, enough=lambda done: False):
        place = {column.name: k for k, column in enumerate(self.columns)}
        figures = np.tile([column.blank for column in self.columns], (len(quantities), len(self.request.options), 1))
        remarks = []
        for k, row in enumerate(quantities):
            for j in range(len(self.request.options)):
                growth = float(np.sum(row * 10.0 ** -np.arange(len(row)))) * (-1.0) ** j
                figures[k, j, place["growth"]] = growth
                figures[k, j, place["state"]] = UNSTABLE if growth > 0.0 else STABLE
                figures[k, j, place["status"]] = 0.0
                if row[0] > 100.0 and j == 0:
                    figures[k, j] = [column.blank for column in self.columns]
                    remarks.append((k, j, f"<b>no</b> =HYPERLINK({row[0]:g})"))
        return SweepBlock(index, quantities, figures, tuple(remarks), 0.01)

    monkeypatch.setattr(block_module.SweepTask, "at", at)


def run(scenario, request, folder, block):
    with alone(folder):
        study, store = run_sweep(scenario, request, folder, block=block)
        paths = write_sweep(study, store, folder)
        remove_store(folder)
    return study, paths


@pytest.mark.parametrize("at_once", [1, 7, 10**6])
@pytest.mark.parametrize(("grid", "block"), [
    (["speed=20:150:11"], 3), (["speed=20:150:5", "payload=0:2t:4"], 3),
    (["speed=20:150:3", "payload=0:2t:4", "lateral_offset=-1cm:1cm:2"], 5),
])  # fmt: skip
def test_every_point_stands_in_its_place(scenario, known, monkeypatch, tmp_path, grid, block, at_once):
    monkeypatch.setattr(arrays_module, "_AT_ONCE", at_once)
    request = sweep_request(scenario, grid=grid, options=["bare", "windings"], parts=["modes"])
    _, paths = run(scenario, request, tmp_path, block)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["sweep.html", "sweep.json", "sweep.nc"]
    with xarray.open_dataset(paths[1]) as found:
        axes = [name for name in found.growth.dims if name != "option"]
        assert [found.sizes[name] for name in axes] == list(request.shape)
        total = sum(found[name] * 10.0**-k for k, name in enumerate(axes))
        for sign, option in ((1.0, "bare"), (-1.0, "windings")):
            growth = found.growth.sel(option=option)
            wanted = (sign * total).broadcast_like(growth)
            there = np.isfinite(growth)
            np.testing.assert_array_equal(growth.values[there.values], wanted.values[there.values])
        missing = ~np.isfinite(found.growth.sel(option="bare"))
        assert bool((missing == (found[axes[0]] > 100.0)).all())
        texts = found.remark_text.values[found.remark.sel(option="bare").values]
        assert set(np.unique(texts)) == {""} | {
            f"<b>no</b> =HYPERLINK({v:g})" for v in found[axes[0]].values if v > 100.0
        }
        assert found.growth.attrs["units"] == "1/s"
        assert found.state.attrs["flag_meanings"] == "stable unresolved unstable no_answer"
        assert found.state.dtype == np.int8


def test_a_sample_has_its_quantities_beside_its_figures(scenario, known, tmp_path):
    request = sweep_request(scenario, vary=["speed=20:150", "payload=0:2t"], points=37, options=["bare"], seed=5,
                            parts=["modes"])  # fmt: skip
    _, paths = run(scenario, request, tmp_path, 10)
    with xarray.open_dataset(paths[1]) as found:
        np.testing.assert_array_equal(np.stack([found.speed, found.payload], axis=1), request.values(0, 37))
        there = np.isfinite(found.growth[0])
        np.testing.assert_array_equal(found.growth[0][there], (found.speed + 0.1 * found.payload)[there])


def test_counts_add_up_and_the_page_says_what_is_missing(scenario, known, tmp_path):
    request = sweep_request(scenario, grid=["speed=20:150:5", "payload=0:2t:4"], options=["bare", "windings"],
                            parts=["modes"])  # fmt: skip
    study, paths = run(scenario, request, tmp_path, 6)
    bare, windings = study.options
    assert bare.states == {"stable": 0, "unresolved": 0, "unstable": 12, "no_answer": 8}
    assert windings.states == {"stable": 20, "unresolved": 0, "unstable": 0, "no_answer": 0}
    page = paths[0].read_text(encoding="utf-8")
    assert "<b>no</b>" not in page  # reasons come from files
    assert "&lt;b&gt;no&lt;/b&gt; =HYPERLINK(#)" in page
    said = json.loads(paths[2].read_text(encoding="utf-8"))
    assert said["options"][0]["states"]["no_answer"] == 8
    assert said["points"] == 20
    assert json.loads(json_text(study)) == said
    table = counts_table(study)
    assert [cell.text for cell in table.rows[0]][:2] == [bare.label, "0"]


def test_the_interval_holds_what_it_says():
    """Coverage of Clopper and Pearson's interval, summed exactly over the binomial distribution."""
    from scipy.stats import binom

    for count, share in ((20, 0.1), (100, 0.5), (300, 0.003)):
        inside = sum(
            binom.pmf(k, count, share) for k in range(count + 1)
            if share_interval(k, count)[0] <= share <= share_interval(k, count)[1]
        )  # fmt: skip
        assert inside >= 0.95
    assert share_interval(50, 50)[1] == 1.0
    low, high = share_interval(1000, 1000)
    assert 0.0036 < 1.0 - low < 0.0038  # 1 - 0.025^(1/1000)
    assert high == 1.0


def test_figures_follow_the_kind_of_the_sweep(scenario, known, tmp_path):
    kinds = {
        ("speed=20:150:5",): ["growth"],
        ("speed=20:150:5", "payload=0:2t:4"): ["maps"],
        ("speed=20:150:3", "payload=0:2t:4", "lateral_offset=-1cm:1cm:2"): ["shares", "growth-distribution"],
    }
    for number, (grid, keys) in enumerate(kinds.items()):
        request = sweep_request(scenario, grid=list(grid), options=["bare", "windings"], parts=["modes"])
        folder = tmp_path / str(number)
        with alone(folder):
            study, store = run_sweep(scenario, request, folder, block=4)
        digest = SweepDigest(study)
        for index in range(study.blocks):
            digest.add(store.get(index))
        assert [chart.key for chart in sweep_report(digest).charts()] == keys
        points = digest.counts[:, :, :, 0].sum(axis=2)
        assert (points == request.points).all()
    assert NO_ANSWER != STABLE


def test_the_store_of_the_task_is_the_one_that_was_measured(scenario):
    request = sweep_request(scenario, grid=["speed=20:150:7"], options=["bare"], parts=["modes"])
    assert SweepTask(scenario, request, 3).blocks == 3
    assert SweepTask(scenario, request, 3).span(2) == (6, 7)
