"""The page of a design: figures with units, tables and words that say no more than is proved, and files for others."""

from __future__ import annotations

import copy
import ctypes
import io
import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from design_fixture import law, small_study

from maglev_ctrl.errors import ModelError, Verdict
from maglev_ctrl.proofs.claims import DecayClaim
from maglev_ctrl.proofs.file import DesignFile, from_document
from maglev_ctrl.proofs.makers import energy_claim
from maglev_ctrl.report.chart import Area, Chart, Line
from maglev_ctrl.report.design import write_design
from maglev_ctrl.report.design.charts import budget_chart, gain_chart, manoeuvre_chart, poles_chart, region_area
from maglev_ctrl.report.design.content import design_model
from maglev_ctrl.report.design.exports import FALLBACK, export_design, sampled_form
from maglev_ctrl.report.design.tables import budget_table, claim_table, gain_table, manoeuvre_table
from maglev_ctrl.report.design.words import claim_words, claims_in_short, gathered, rounded_claim, short_names
from maglev_ctrl.report.html import html
from maglev_ctrl.report.model import FigureBlock, Table
from maglev_ctrl.report.vector import svg
from maglev_ctrl.study.design.records import DesignStudy
from maglev_ctrl.synthesis.damping.budget import damping_budget
from maglev_ctrl.synthesis.damping.places import DampingPlace
from maglev_ctrl.synthesis.lmi.regions import contains, damping, disk, half_plane, intersection
from maglev_ctrl.synthesis.result import proven
from maglev_ctrl.systems import Controller, SecondOrderSystem
from maglev_ctrl.systems.plant import Plant

UNIT = re.compile(r"\((1/s|rad/s|Hz|dB|%|kN s/m|s|m/s|km/h)\)$|^(mm|kN|m/s\^2|m/s|deg|deg/s)$")
COMPILER = shutil.which("cc")


@pytest.fixture(scope="module")
def study() -> DesignStudy:
    return small_study()


@pytest.fixture(scope="module")
def charts(study: DesignStudy) -> tuple[Chart, ...]:
    return tuple(design_model(study).charts())


def design_of(study: DesignStudy, name: str) -> DesignFile:
    document = law(study, name).document
    assert document is not None
    return from_document(copy.deepcopy(document))


def test_every_axis_has_a_name_and_a_unit(charts: tuple[Chart, ...]) -> None:
    assert len(charts) >= 8 and len({chart.key for chart in charts}) == len(charts)
    for chart in charts:
        assert chart.caption.endswith(".") and len(chart.caption) < 300 and chart.alt.endswith(".")
        for panel in chart.panels:
            assert all(UNIT.search(axis.label) for axis in (panel.x, panel.y)), (chart.key, panel.x, panel.y)


def test_no_legend_has_two_entries_alike_and_every_tick_is_in_sight(charts: tuple[Chart, ...]) -> None:
    for chart in charts:
        for panel in chart.panels:
            labels = [item.label for item in panel.items if getattr(item, "label", "")]
            assert len(labels) == len(set(labels)), chart.key
            for axis in (panel.x, panel.y):
                if axis.limits is not None and axis.ticks:
                    assert axis.limits[0] <= min(axis.ticks) and max(axis.ticks) <= axis.limits[1]


def test_every_figure_draws(charts: tuple[Chart, ...]) -> None:
    for chart in charts:
        assert svg(chart).lstrip().startswith("<") and "nan" not in svg(chart)[:200]


@pytest.mark.parametrize(
    ("region", "window"),
    [
        (damping(0.3), (-13.0, 3.0, 29.0)),
        (damping(0.95), (-13.0, 3.0, 29.0)),  # the cone leaves the window by its side, far below its corners
        (disk(0.0, 5.0), (-13.0, 3.0, 29.0)),
        (disk(-8.0, 2.0), (-13.0, 3.0, 29.0)),
        (half_plane(4.0), (-13.0, 3.0, 29.0)),
        (intersection(damping(0.6), half_plane(1.0), disk(0.0, 12.0)), (-13.0, 3.0, 29.0)),
    ],
)
def test_the_outline_of_a_region_is_inside_the_region_and_the_window(region, window) -> None:
    area = region_area(region, window)
    assert area is not None
    left, right, height = window
    assert np.all((area.x >= left - 1e-9) & (area.x <= right + 1e-9) & (np.abs(area.y) <= height * (1.0 + 1e-12)))
    centre = complex(np.mean(area.x), np.mean(area.y))
    outline = area.x + 1j * area.y
    assert np.all(contains(region, centre + (1.0 - 1e-6) * (outline - centre)))
    # and it is no smaller than it need be: beyond it is outside of the one or the other
    beyond = centre + 1.02 * (outline - centre)
    out = (beyond.real < left) | (beyond.real > right) | (np.abs(beyond.imag) > height)
    assert np.mean(out | ~contains(region, beyond)) > 0.99


def test_a_region_out_of_sight_is_not_drawn() -> None:
    assert region_area(half_plane(50.0), (-13.0, 3.0, 29.0)) is None


def test_poles_and_gains_are_those_of_the_study(study: DesignStudy) -> None:
    one = law(study, "worst")
    chart = poles_chart(one)
    assert chart is not None
    closed = next(item for item in chart.panels[0].items if getattr(item, "label", "") == "with the law")
    assert np.array_equal(np.sort(closed.x), np.sort(one.corners[0].closed_loop.real))
    gain = gain_chart(one)
    assert gain is not None and one.gain is not None
    line = next(item for item in gain.panels[0].items if isinstance(item, Line) and item.label == "with the law")
    assert np.max(10.0 ** (line.y / 20.0)) == pytest.approx(np.max(one.gain.closed_loop))
    said = float(re.search(r"stay below ([\d.]+)\.", gain.caption)[1])  # type: ignore[index]
    assert said >= one.gain.level
    steady = replace(one.corners[0], open_loop=np.array([-1.0 + 1.0j, -1.0 - 1.0j]))
    calm = gain_chart(replace(one, corners=(steady,)))
    assert calm is not None and "unstable" not in calm.caption
    falling = replace(one.corners[0], open_loop=np.array([-1.0 + 0.0j, 1.0 + 0.0j]))
    warned = gain_chart(replace(one, corners=(falling,)))
    assert warned is not None and "Without the law the loop is unstable" in warned.caption
    assert any(getattr(item, "label", "") == "without the law, unstable" for item in warned.panels[0].items)
    assert poles_chart(replace(one, corners=())) is None and gain_chart(replace(one, gain=None)) is None


def test_a_region_is_drawn_where_a_law_asks_for_one(study: DesignStudy) -> None:
    chart = poles_chart(replace(law(study, "lqr"), region=damping(0.1)))
    assert chart is not None and any(isinstance(item, Area) for item in chart.panels[0].items)


def test_manoeuvre_is_named_in_titles_and_told_in_numbers(study: DesignStudy) -> None:
    one = law(study, "mpc")
    assert one.predictive is not None
    chart = manoeuvre_chart(one, one.predictive)
    assert [panel.title for panel in chart.panels] == [signal.name for signal in one.predictive.signals]
    table = manoeuvre_table(one.predictive)
    stroke = next(signal for signal in one.predictive.signals if signal.name.endswith(".stroke"))
    row = next(row for row in table.rows if row[0].text == stroke.name)
    assert row[1].text == "20.0 mm"
    assert float(row[2].text.split()[0]) == pytest.approx(1e3 * np.max(np.abs(stroke.predicted)), rel=0.01)
    outside = 0.02 * np.sum(np.abs(stroke.saturated) > 0.02 * (1 + 1e-6))
    assert float(row[5].text.split()[0]) == pytest.approx(outside, abs=1e-3)


def test_claims_are_rounded_to_the_safe_side() -> None:
    said = rounded_claim("every pole decays at 1.99999 1/s; the gain is below 2.00001, and |u| < 1234.5678")
    assert said == "every pole decays at 1.999 1/s; the gain is below 2.001, and |u| < 1235"
    assert (
        rounded_claim("decays at 0.5 1/s; is below 3.75; of 5 loops") == "decays at 0.5 1/s; is below 3.75; of 5 loops"
    )
    rng = np.random.default_rng(0)
    for value in 10.0 ** rng.uniform(-6, 5, 300):
        rate = float(rounded_claim(f"decays at {value:.10g} 1/s").split()[2])
        bound = float(rounded_claim(f"below {value:.10g}").split()[1])
        assert rate <= value * (1 + 1e-9) and bound >= value * (1 - 1e-9)
        assert rate >= value * 0.9985 and bound <= value * 1.0015


def test_claims_in_few_words(study: DesignStudy) -> None:
    one = law(study, "scheduled").synthesis
    assert one is not None
    assert claim_words(one, 0).startswith("the loop is stable everywhere from speed 60 m/s to speed 100 m/s while")
    (short,) = claims_in_short(one)
    slowest = min(claim.speed_limit for claim in one.claims)  # type: ignore[union-attr]
    assert "between 3 nodes" in short and float(short.split(" at ")[1].split()[0]) <= slowest
    failed = replace(one, proofs=(replace(one.proofs[0], holds=False, reason="too fast"), *one.proofs[1:]))
    assert any(words.startswith("NOT PROVED: ") and "too fast" in words for words in claims_in_short(failed))
    table = claim_table(replace(law(study, "scheduled"), synthesis=failed))
    assert [row[1].text for row in table.rows] == ["✗ FAIL", "✓ PASS"] and table.rows[0][3].text == "too fast"


def test_one_bound_for_several_points_is_the_weakest() -> None:
    plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]])
    plants = (plant, replace(plant, A=plant.A - 1.0), replace(plant, A=plant.A - 2.0))
    law = Controller.static([[-3.0]], measured=("x1",), commands=("u1",))
    claims = [DecayClaim((i,), (0,), rate, np.ones((1, 1, 1))) for i, rate in enumerate((1.90009, 2.5, 3.5))]
    claims.append(DecayClaim((0, 1, 2), (0, 0, 0), 1.0, np.ones((1, 1, 1))))
    made = proven("demo", plants, [law], claims=claims)
    first, second = claims_in_short(made)
    assert first == "every pole of the closed loop decays at 1.9 1/s or faster (at each of 3 operating points)"
    assert second.startswith("every pole of each of the 3 closed loops")
    norms = [energy_claim(plants[i], law, level, index=i) for i, level in enumerate((0.6, 0.5, 0.7))]
    (bound,) = claims_in_short(proven("demo", plants, [law], claims=norms))
    assert bound.endswith("is below 0.7 (at each of 3 operating points)")


def test_names_in_few_words() -> None:
    assert short_names(("a_b_c", "d_b_c")) == ("a", "d") and short_names(("a_b", "a_b_c")) == ("b", "b_c")
    assert short_names(("leg_front",)) == ("leg_front",) and short_names(()) == ()
    assert gathered("a_1, a_2, a_3, b and c_1, c_2") == "a_1 to a_3, b and c_1, c_2"
    assert gathered("limits (s, m_1.gap, m_2.gap, m_4.gap)") == "limits (s, m_1.gap, m_2.gap, m_4.gap)"
    assert gathered("a sentence, of words, as it is") == "a sentence, of words, as it is"


def test_budget_of_two_places(study: DesignStudy) -> None:
    chain = SecondOrderSystem.from_matrices(
        [[1.0, 0.0], [0.0, 1.0]], np.zeros((2, 2)), [[2000.0, -1000.0], [-1000.0, 2000.0]]
    )
    places = [DampingPlace("first_damper_leg", [1.0, 0.0], cost=1e3), DampingPlace("second_damper_leg", [0.0, 1.0])]
    told: list[str] = []
    budget = damping_budget([chain], places, margins=[0.1, 0.2], step=told.append)
    assert told[0] == "decay rate 0.1 1/s, all places" and any("second_damper_leg alone" in words for words in told)
    one = law(study, "dampers")
    table = budget_table(budget, 0.2)
    assert table.columns[:3] == ("Decay rate", "first", "second") and max(map(len, table.columns)) < 20
    assert table.rows[1][0].text == "0.200 1/s (chosen)"
    chart = budget_chart(one, budget, chosen=0.2)
    left, right = ({item.label for item in panel.items if getattr(item, "label", "")} for panel in chart.panels)
    assert {"all places", "only second", "chosen"} <= left and {"first", "second"} <= right
    none = damping_budget([chain], places, margins=[0.1, 0.2], time_limit=0.0)
    assert not none.together.certified.any() and set(none.alone[0].reasons) == {"the time limit was reached"}
    assert [row[5].text for row in budget_table(none, 0.2).rows if row] and svg(budget_chart(one, none, chosen=0.2))
    with pytest.raises(ValueError, match="time_limit: expected a time"):
        damping_budget([chain], places, margins=[0.1], time_limit=float("nan"))


def test_the_page_tells_what_is_not_proved(study: DesignStudy) -> None:
    good, bad = law(study, "lqr"), law(study, "worst")
    assert bad.synthesis is not None
    proofs = tuple(replace(proof, holds=False, reason="an eigenvalue is positive") for proof in bad.synthesis.proofs)
    failed = replace(bad, synthesis=replace(bad.synthesis, proofs=proofs))
    lost = replace(law(study, "mpc"), failure="no terminal set was found", synthesis=None)
    report = design_model(replace(study, options=(good, failed, lost)))
    assert report.subtitle == "3 laws of small" and report.sections[0].verdict is Verdict.FAIL
    page = html(report, {chart.key: svg(chart) for chart in report.charts()})
    for words in (
        "an eigenvalue is positive",
        "No law: no terminal set was found",
        "Every claim is proved.",
        "NOT EVALUATED",
    ):
        assert words in page
    assert "conj(s)" not in page
    single = design_model(replace(study, options=(good,)))
    assert single.subtitle == "1 law of small" and single.sections[0].verdict is Verdict.PASS


def test_tables_are_whole(study: DesignStudy) -> None:
    blocks = [block for section in design_model(study).sections for block in section.blocks]
    assert sum(isinstance(block, FigureBlock) for block in blocks) >= 8
    for table in (block for block in blocks if isinstance(block, Table)):
        assert all(len(row) == len(table.columns) for row in table.rows), table.caption
        assert all(name for name in table.columns)


def test_thin_margins_are_told(study: DesignStudy) -> None:
    one = law(study, "lqr")
    assert one.margins is not None
    first = one.margins.channels[0]
    thin = replace(first, gain_increase=replace(first.gain_increase, value=1.05))
    margins = replace(one.margins, channels=(thin, *one.margins.channels[1:]))

    def said(option) -> str:
        report = design_model(replace(study, options=(option,)))
        return html(report, {chart.key: "" for chart in report.charts()})

    assert "Proved is not robust: LQR has less than" in said(replace(one, margins=margins))
    assert "Proved is not robust" not in said(one)


# --- files for other tools ---------------------------------------------------------------------------------------


def test_exports_carry_their_origin(study: DesignStudy) -> None:
    design = design_of(study, "lqr")
    made = {name: content for target in ("mat", "json", "c", "python") for name, content in
            export_design(design, target).items()}  # fmt: skip
    assert list(made) == ["lqr.mat", "lqr.json", "lqr.h", "lqr.c", "lqr.py", "lqr_sampled.py"]
    for name, content in made.items():
        if not name.endswith(".mat"):  # texts of MATLAB files are UTF-16
            assert study.scenario_hash.encode() in content and b"0.75 MN/m" in content, name
            assert b"sign of the feedback" in content
    from scipy.io import loadmat

    read = loadmat(io.BytesIO(made["lqr.mat"]), simplify_cells=True)
    assert study.scenario_hash in read["origin"]
    names = [one["name"] for one in read["controllers"]]
    assert names == ["lqr", "lqr, sampled every 0.002 s"]
    assert np.array_equal(np.atleast_2d(read["controllers"][0]["D"]), design.controllers[0].D)
    assert read["plants"]["name"] == "design point" and read["claims"]["kind"] == "DecayClaim"
    alone = json.loads(made["lqr.json"])
    assert np.array_equal(alone["controllers"][0]["D"], design.controllers[0].D)
    assert alone["sampled"]["period"] == 0.002 and "plants" not in alone
    assert alone["origin"]["scenario"]["hash"] == study.scenario_hash


@pytest.mark.skipif(COMPILER is None, reason="there is no C compiler (cc) on this machine")
def test_scheduled_c_follows_the_parameter(study: DesignStudy, tmp_path: Path) -> None:
    design = design_of(study, "scheduled")
    for name, content in export_design(design, "c").items():
        (tmp_path / name).write_bytes(content)
    library = tmp_path / "law.so"
    flags = ["-std=c99", "-Wall", "-Werror", "-pedantic", "-shared", "-fPIC"]
    subprocess.run([COMPILER, *flags, "-o", library, tmp_path / "scheduled.c"], check=True, capture_output=True)
    step = ctypes.CDLL(str(library)).scheduled_step
    y = np.random.default_rng(1).standard_normal(len(design.controllers[0].measured))
    doubles = ctypes.POINTER(ctypes.c_double)
    gains = [one.D for one in design.controllers]
    for speed, gain in ((60.0, gains[0]), (80.0, 0.5 * (gains[0] + gains[1])), (140.0, gains[2]), (900.0, gains[2])):
        u = np.zeros(1)
        step(ctypes.c_double(speed), y.ctypes.data_as(doubles), u.ctypes.data_as(doubles))
        np.testing.assert_allclose(u, gain @ y, rtol=1e-12)
        assert not np.allclose(u, -gain @ y)


def test_scheduled_python_is_the_table(study: DesignStudy) -> None:
    design = design_of(study, "scheduled")
    made = export_design(design, "python")
    script: dict[str, object] = {}
    exec(compile(made["scheduled.py"], "scheduled.py", "exec"), script)
    at = script["law"](80.0)  # type: ignore[operator]
    np.testing.assert_allclose(at.D, 0.5 * (design.controllers[0].D + design.controllers[1].D), rtol=1e-12)
    np.testing.assert_array_equal(script["law"](140.0).D, design.controllers[2].D)  # type: ignore[operator]
    with pytest.raises(ValueError, match=r"expected 60\.0 to 140\.0, got 141"):
        script["law"](141.0)  # type: ignore[operator]
    assert json.loads(export_design(design, "json")["scheduled.json"])["schedule"]["nodes"] == [60.0, 100.0, 140.0]


def test_a_predictive_design_exports_the_law_behind_it_and_says_so(study: DesignStudy) -> None:
    design = design_of(study, "mpc")
    made = export_design(design, "c")
    assert list(made) == ["mpc_fallback.h", "mpc_fallback.c"]
    words = b" ".join(made["mpc_fallback.h"].replace(b"\n *", b"").split())
    assert FALLBACK.encode() in words and b"MPC_FALLBACK_DT 0.02" in words
    with pytest.raises(ModelError, match=r"designed for samples every 20\.0 ms and runs at no other"):
        export_design(design, "c", period=0.01)


def test_dampers_are_not_programmed(study: DesignStudy) -> None:
    with pytest.raises(ModelError, match="dampers are built, not programmed"):
        export_design(design_of(study, "dampers"), "c")
    assert list(export_design(design_of(study, "dampers"), "mat")) == ["dampers.mat"]


def test_a_sampled_loop_is_proved_before_it_is_written(study: DesignStudy) -> None:
    design = design_of(study, "worst")
    with pytest.raises(ModelError, match="C needs a sampling period, and the design has none; give one"):
        export_design(design, "c")
    held = sampled_form(design, 0.001)
    assert held is not None and "proved stable at the operating point" in held.proved
    assert list(export_design(design, "c", period=0.001)) == ["worst.h", "worst.c"]
    with pytest.raises(ModelError, match="sampled every 500 ms the loop is not stable at design point"):
        export_design(design, "c", period=0.5)
    with pytest.raises(ValueError, match="period: expected a positive time"):
        export_design(design, "json", period=-1.0)
    with pytest.raises(ValueError, match="target: expected mat, json, c, python"):
        export_design(design, "fortran")
    stored = design_of(study, "lqr")
    held = stored.extra["sampled"]["controllers"]
    held[0]["D"] = [[-value for value in row] for row in held[0]["D"]]  # a law of the wrong sign, written into the file
    with pytest.raises(ModelError, match="the loop is not stable"):
        export_design(stored, "c")


def test_signals_have_their_units(study: DesignStudy) -> None:
    design = design_of(study, "lqr")
    header = export_design(design, "c")["lqr.h"].decode()
    assert "/* car.heave, m */" in header and "/* car.heave.velocity, m/s */" in header
    assert "/* cylinder_bogie.force, N */" in header and "/* cylinder_bogie, N */" in header
    table = gain_table(law(study, "lqr"))
    assert table is not None
    units = {row[1].text: row[3].text for row in table.rows}
    assert units["car.heave"] == "N/m" and units["car.heave.velocity"] == "N/(m/s)"
    held = export_design(design_of(study, "scheduled"), "c")["scheduled.h"].decode()
    assert "parameter speed, m/s" in held


def test_names_become_identifiers(study: DesignStudy) -> None:
    design = design_of(study, "worst")
    for name, wanted in (("H-inf, 2", "H_inf_2"), ("2nd", "law_2nd"), ("while", "law_while"), ("../x", "x")):
        assert list(export_design(replace(design, name=name), "c", period=0.001)) == [f"{wanted}.h", f"{wanted}.c"]


def test_the_folder(study: DesignStudy, tmp_path: Path) -> None:
    unstable = law(study, "lqr")
    document = copy.deepcopy(unstable.document)
    assert document is not None
    for one in document["extra"]["sampled"]["controllers"]:
        one["D"] = [[-value for value in row] for row in one["D"]]
    paths = write_design(replace(study, options=(replace(unstable, document=document), law(study, "mpc"))), tmp_path)
    assert [path.name for path in paths] == ["design.html", "design.pdf", "design.json", "export"]
    assert sorted(path.name for path in (tmp_path / "export").iterdir()) == [
        "lqr.json", "lqr.mat", "lqr.py",
        "mpc_fallback.c", "mpc_fallback.h", "mpc_fallback.json", "mpc_fallback.mat", "mpc_fallback.py",
    ]  # fmt: skip
    text = (tmp_path / "export" / "mpc_fallback.py").read_text(encoding="utf-8")
    assert study.created in text  # when it was made is part of the origin
    made = subprocess.run(
        [sys.executable, str(tmp_path / "export" / "lqr.py")], capture_output=True, text=True, check=False
    )
    assert made.returncode == 0, made.stderr


def test_no_export_overwrites_another(study: DesignStudy, tmp_path: Path) -> None:
    one, other = law(study, "lqr"), law(study, "worst")
    assert other.document is not None
    named = replace(other, document={**other.document, "name": "lqr_sampled"})
    write_design(replace(study, options=(one, named)), tmp_path)
    names = sorted(path.name for path in (tmp_path / "export").iterdir())
    assert [name for name in names if name.endswith(".py")] == ["lqr.py", "lqr_sampled.py", "lqr_sampled_law.py"]
    text = (tmp_path / "export" / "lqr_sampled.py").read_text(encoding="utf-8")
    assert "one step every 0.002 s" in text  # still the sampled form of lqr
