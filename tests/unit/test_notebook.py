"""What a notebook shows: tables and figures, short words where text is printed, nothing that a hostile name can do."""

from __future__ import annotations

import pickle
import re
from dataclasses import replace
from importlib.resources import files
from typing import get_args

import comparison_fixture
import map_fixture
import numpy as np
import pytest

import maglev_ctrl
from maglev_ctrl.analysis.floquet import floquet
from maglev_ctrl.analysis.loops import Loop
from maglev_ctrl.analysis.margins import loop_margins
from maglev_ctrl.analysis.modes import StabilityVerdict, modes
from maglev_ctrl.analysis.resonance_map import resonance_map
from maglev_ctrl.analysis.tracking import track
from maglev_ctrl.display import Shown
from maglev_ctrl.errors import Agreement, Verdict
from maglev_ctrl.report.model import Block
from maglev_ctrl.report.notebook import html
from maglev_ctrl.report.notebook.content import blocks_of
from maglev_ctrl.report.style import INK, MINUS
from maglev_ctrl.synthesis.laws import design_lqr
from maglev_ctrl.synthesis.weights import InputWeight, OutputWeight
from maglev_ctrl.systems import PeriodicSystem, SecondOrderSystem
from maglev_ctrl.vehicle import Body, Vehicle

HOSTILE = "<script>alert('x')</script>"
MOST_BYTES = 200_000


def car(damping: float = 0.2, *, stiffness: object = ((9.0, -1.0), (-1.0, 5.0))) -> SecondOrderSystem:
    return SecondOrderSystem.from_matrices(
        [[2.0, 0.0], [0.0, 1.0]], damping * np.eye(2), stiffness, dofs=("car.heave", "car.pitch"),
        inputs=("force",), B=[[1.0], [0.2]],
    )  # fmt: skip


def mathieu(depth: float = 0.4, damping: float = 0.0) -> PeriodicSystem:
    return PeriodicSystem.from_matrices([[0, 1], [-1, -damping]], [[[0, 0], [-depth, 0]]], frequency=2.0)


def small_map():
    speeds = np.linspace(1.6, 2.4, 9)
    A_0 = np.tile([[0.0, 1.0], [-1.0, -0.05]], (9, 1, 1))
    A_cos = np.tile([[[0.0, 0.0], [-1.0, 0.0]]], (9, 1, 1, 1))
    return resonance_map(A_0, A_cos, 0.0 * A_cos, speeds, np.linspace(0.0, 0.5, 8), parameter=speeds)


def design():
    return design_lqr(car(), [OutputWeight("car.heave", 0.01), OutputWeight("car.pitch", 0.01)],
                      [InputWeight("force", 1.0)])  # fmt: skip


@pytest.fixture(scope="module")
def results() -> dict[str, object]:
    compared = comparison_fixture.small()
    stack = car(stiffness=[np.diag([9.0 + x, 5.0]) for x in np.linspace(0.0, 3.0, 5)])
    made, whole = modes(car()), loop_margins(Loop.from_transfer_function([25.0], [1.0, 10.0, 10.0, 10.0]))
    law = design()
    vehicle = Vehicle("shuttle", bodies=(Body("car", 88e3, dofs=("heave",)),), reference_height=0.1)
    return {
        "modes": made, "ledger": made.ledger, "tracks": track(stack), "margins": whole, "channel": whole.channels[0],
        "floquet": floquet(mathieu()), "map": small_map(), "plane": map_fixture.plane(count=(24, 12)),
        "design": law, "certificate": law.certificate, "controller": law.controller, "system": car(),
        "periodic": mathieu(), "vehicle": vehicle, "ride": comparison_fixture.response(),
        "worst case": comparison_fixture.worst_case(), "tuning": comparison_fixture.tuning(),
        "comparison": compared, "option": compared.options[0], "requirement": compared.options[0].requirements[0],
    }  # fmt: skip


def test_every_result_shows_tables_and_stays_small(results):
    for name, result in results.items():
        page = result._repr_html_()
        assert page is not None and "<table" in page, name
        assert len(page.encode()) < MOST_BYTES, name
        assert "<script" not in page and "http" not in page.replace("http://www.w3.org/", ""), name
        assert page.count("<div") == page.count("</div>") and page.count("<tr>") == page.count("</tr>"), name
        assert page.startswith('<div class="maglev-ctrl">'), name


def test_figures_come_with_what_has_one(results):
    with_figure = {name for name, result in results.items() if "<svg" in (result._repr_html_() or "")}
    assert with_figure >= {"modes", "tracks", "floquet", "map", "plane", "design", "certificate", "ride", "tuning"}


def test_text_stays_short(results):
    for name, result in results.items():
        assert isinstance(result, Shown), name
        assert len(repr(result)) < 600 and "\n" not in repr(result) and "array(" not in repr(result), name
        assert repr(result).startswith(f"{type(result).__name__}("), name
    labels = "('car heave / car pitch', 'car pitch / car heave')"
    assert repr(results["modes"]) == f"Modes(labels={labels}, verdict='stable', spectral_abscissa=-0.0666996)"
    assert repr(car()) == "SecondOrderSystem(dofs=('car.heave', 'car.pitch'), inputs=('force',))"
    wide = SecondOrderSystem.from_matrices(np.eye(40), np.eye(40), np.eye(40))
    assert repr(wide) == "SecondOrderSystem(dofs=('q1', 'q2', 'q3', 'q4', ... 40 in all))"


def test_the_verdict_has_its_sign_word_and_colour():
    calm, wild = modes(car()), modes(car(-0.2))
    doubtful = replace(calm, verdict=StabilityVerdict.UNRESOLVED)
    for found, slug, word in ((calm, "pass", "✓ PASS"), (wild, "fail", "✗ FAIL"), (doubtful, "unknown", "? NOT EVAL")):
        page = html(found)
        assert f'class="banner {slug}"><strong>{word}' in page
    assert "1/s" in html(calm) and "Hz" in html(calm)
    disagreed = replace(floquet(mathieu(0.1, 0.5)), agreement=Agreement.UNRESOLVED)
    assert 'class="banner unknown"' in html(disagreed) and "do not agree" in html(disagreed)
    law = design()
    unsure = replace(law.certificate, agreed=Agreement.UNRESOLVED, disagreements=("two closings differ",))
    assert 'class="banner unknown"' in html(unsure) and "two closings differ" in html(unsure)
    lost = replace(law.certificate, spectral_abscissa=0.1, lyapunov_positive=False)
    assert 'class="banner fail"' in html(lost)


def test_what_is_unresolved_in_a_map_is_told():
    found = small_map()
    assert "UNRESOLVED: the engines" not in html(found)
    doubt = found.unresolved.copy()
    doubt[2, 3] = True
    assert "1 points are UNRESOLVED: the engines do not agree" in html(replace(found, unresolved=doubt))


def test_hostile_names_are_words():
    named = replace(car(), dofs=(HOSTILE, "car.pitch"))
    compared = comparison_fixture.small()
    option = replace(compared.options[0], label=HOSTILE, summary=(HOSTILE,))
    vehicle = Vehicle(HOSTILE, bodies=(Body(f"car{HOSTILE}", 1e3, dofs=("heave",)),), reference_height=0.1)
    whole = replace(compared, title=HOSTILE, options=(option, *compared.options[1:]))
    for result in (named, modes(named), option, whole, vehicle, track([modes(named), modes(named)])):
        page = html(result)
        assert "<script" not in page and "&lt;script&gt;" in page
        assert "alert" in page  # it is shown, not dropped


def test_ink_follows_the_page():
    page = html(modes(car()))
    drawn = re.sub(r"<style>.*?</style>", "", page, count=1, flags=re.DOTALL)
    outside = re.sub(r"var\(--[a-z]+, #[0-9a-f]+\)", "", drawn)
    assert INK in drawn and f"stroke: {INK}" not in outside and f"fill: {INK}" not in outside
    style = page[page.index("<style>") : page.index("</style>")]
    assert "--ink: currentColor" in style
    assert not re.search(r"(?<![-\w])color: #", style)  # text keeps the page's colour; only tints are its own
    rules = re.sub(r"\{[^}]*\}", "{}", style.removeprefix("<style>"))
    assert all(part.strip().startswith(".maglev-ctrl") for part in re.split(r"\{\}|,", rules) if part.strip())


def growth_by_label(found) -> dict[str, float]:
    table = next(block for block in blocks_of(found) if hasattr(block, "rows"))
    return {c[0].text: float(c[3].text.removesuffix(" 1/s").replace(MINUS, "-")) for c in table.rows}


def test_tables_hold_the_numbers():
    found = modes(car(stiffness=np.diag([9.0, 5.0])))
    told = growth_by_label(found)
    for k, label in enumerate(found.labels):
        assert told[label] == pytest.approx(found.s[k].real, rel=6e-3)
    swapped = growth_by_label(replace(found, s=found.s[::-1]))  # a mutant: growth rates of the wrong modes
    assert any(swapped[label] != pytest.approx(found.s[k].real, rel=6e-3) for k, label in enumerate(found.labels))


def test_every_kind_of_block_has_its_form():
    form = files("maglev_ctrl.report").joinpath("templates", "notebook.html.j2").read_text(encoding="utf-8")
    for kind in get_args(Block):
        assert f'kind == "{kind.__name__}"' in form, kind


def test_what_has_no_page_is_left_to_its_text():
    assert html(3.0) is None and html([1, 2]) is None
    sweep_like = comparison_fixture.ride()
    assert sweep_like._repr_html_() is None and repr(sweep_like).startswith("RideStudy(")


def test_records_stay_what_they_were():
    found = modes(car())
    assert not hasattr(found, "__dict__")
    with pytest.raises(AttributeError):
        found.s = found.s  # type: ignore[misc]
    again = pickle.loads(pickle.dumps(found))
    np.testing.assert_array_equal(again.s, found.s)
    assert replace(found, labels=("a", "b")).labels == ("a", "b")


def test_a_scenario_shows_its_options(tmp_path):
    from pathlib import Path

    source = next(Path(__file__).parents[2].joinpath("scenarios").glob("**/eds_135t.toml"), None)
    source = source or next(Path(__file__).parents[2].joinpath("scenarios", "compare").glob("*.toml"))
    scenario = maglev_ctrl.load(source)
    page = scenario._repr_html_()
    assert all(option.name in page for option in scenario.options) and "Suspension options" in page
    assert len(repr(scenario)) < 1000 and repr(scenario).startswith("Scenario(title=")
    renamed = scenario.model_copy(update={"title": HOSTILE})
    assert "<script" not in renamed._repr_html_() and "&lt;script&gt;" in renamed._repr_html_()


def test_requirements_tell_wishes_and_bounds():
    wish = comparison_fixture.wish()
    assert "(a wish)" in html(wish)
    assert Verdict.FAIL.value in html(comparison_fixture.comfort(0.9))
