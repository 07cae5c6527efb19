"""Every written page in a real browser: figures come alive, keys work, nothing is fetched, axe has nothing serious."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import comparison_fixture
import design_fixture
import map_fixture
import pytest
import report_fixture
from browser_watch import Watch, findings, gone, picture
from playwright.sync_api import Page
from ride_scenario import ONE_MASS, read

from maglev_ctrl.report import write
from maglev_ctrl.report.design.folder import write_design
from maglev_ctrl.report.map.folder import write_map
from maglev_ctrl.report.paper.files import write_reproduction
from maglev_ctrl.report.simulation.folder import write_simulation
from maglev_ctrl.study.nonlinear import compared, survey
from maglev_ctrl.study.paper import cases
from maglev_ctrl.study.paper.run import reproduce

HOSTILE = (
    "<script>window.hacked = 1</script><img src=x onerror='window.hacked = 2'></title></script>"
    "<svg onload='window.hacked = 3'> %{x} {{ 7*7 }} javascript:window.hacked=4"
)


def comparison_page(folder: Path) -> None:
    write(comparison_fixture.enriched(report_fixture.comparison(points=6, cells=8)), folder, formats=("html",))


def map_page(folder: Path) -> None:
    write_map(map_fixture.map_study(), folder)


def design_page(folder: Path) -> None:
    write_design(design_fixture.small_study(), folder)


def simulation_page(folder: Path) -> None:
    scenario = read(folder, ONE_MASS)
    request = scenario.simulation.model_copy(update={"duration": 0.6, "settle": 0.0})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compared, "DECAYS", 2.0)
        study = survey.survey_simulation(
            scenario, scenario.options[0], request, everything=False, progress=lambda what, share: None
        )
    write_simulation(study, folder)


def reproduction_page(folder: Path) -> None:
    write_reproduction(reproduce(cases.perfect_conductor, quick=True), folder)


PAGES: dict[str, Callable[[Path], None]] = {
    "comparison": comparison_page,
    "map": map_page,
    "design": design_page,
    "simulation": simulation_page,
    "reproduction": reproduction_page,
}


OWN = ("comparison", "map")
"""Pages that are looked at every time; the others with MAGLEV_BROWSER=all."""


@pytest.fixture(scope="module", params=list(PAGES) if os.environ.get("MAGLEV_BROWSER") == "all" else OWN)
def written(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """A kind of page, and the address of its file."""
    folder = tmp_path_factory.mktemp(request.param)
    PAGES[request.param](folder)
    (page,) = folder.glob("*.html")
    return request.param, page.as_uri()


SCROLL_THROUGH = """
async () => {
  const drawn = (figure) => new Promise((done) => {
    const look = () => (figure.dataset.drawn === "yes" ? done() : setTimeout(look, 20));
    look();
  });
  const figures = [...document.querySelectorAll("figure[data-chart]")];
  for (const figure of figures) { figure.scrollIntoView(); await drawn(figure); }
  scrollTo(0, 0);
  return figures.map((figure) => figure.dataset.chart);
}
"""


def all_figures_drawn(page: Page) -> list[str]:
    """Scroll through the page until every live figure is drawn; the keys of those drawn."""
    page.wait_for_function("!document.getElementById('live').disabled")
    keys: list[str] = page.evaluate(SCROLL_THROUGH)
    return keys


def test_every_figure_comes_alive(watch: Watch, written: tuple[str, str]) -> None:
    kind, address = written
    page = watch.page(address)
    keys = all_figures_drawn(page)
    assert keys and len(set(keys)) == len(keys)
    for key in keys:
        figure = page.locator(f"figure[data-chart='{key}']")
        assert figure.locator(".dynamic .main-svg").count() > 0, key
        box = figure.locator(".dynamic").bounding_box()
        assert box is not None and box["width"] > 300 and box["height"] > 100, key
        assert figure.locator(".static").is_hidden(), key
    picture(page, f"report_{kind}_live")
    page.locator("#live").uncheck()
    assert page.locator("figure .static:visible").count() == len(keys)
    assert page.locator("figure .dynamic:visible").count() == 0


def test_figures_stand_still_without_scripts_and_on_paper(watch: Watch, written: tuple[str, str]) -> None:
    kind, address = written
    page = watch.page(address, scripts=False)
    count = page.locator("figure[data-chart]").count()
    assert count > 0 and page.locator("figure .static svg:visible").count() == count
    picture(page, f"report_{kind}_still", whole=False)
    page = watch.page(address)
    page.wait_for_selector("figure[data-drawn=yes]")
    page.emulate_media(media="print")
    assert page.locator("figure .static svg:visible").count() == count
    assert page.locator("figure .dynamic:visible").count() == 0


def test_a_page_is_read_by_keyboard(watch: Watch, written: tuple[str, str]) -> None:
    _, address = written
    page = watch.page(address)
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.getAttribute('href')") == "#content"
    box = page.evaluate("(({x, y, width}) => ({x, y, width}))(document.activeElement.getBoundingClientRect())")
    assert box["x"] >= 0 and box["y"] >= 0 and box["width"] > 0, "the skip link is not seen when it has the focus"
    page.keyboard.press("Enter")
    assert page.evaluate("document.activeElement.id") == "content"
    page = watch.page(address)
    page.emulate_media(reduced_motion="reduce")  # a jump, past figures that would each be drawn on the way
    links = page.locator("nav a[href^='#']")
    last = links.nth(links.count() - 1)
    for _ in range(links.count() + 2):
        page.keyboard.press("Tab")
        if last.evaluate("link => link === document.activeElement"):
            break
    assert last.evaluate("link => link === document.activeElement"), "the last entry is not reached by Tab"
    page.keyboard.press("Enter")
    target = page.locator(str(last.get_attribute("href")))
    page.wait_for_function(
        "id => { const t = document.querySelector(id).getBoundingClientRect().top; "
        "return t > -5 && t < innerHeight }", arg=last.get_attribute("href"), timeout=60_000,
    )  # fmt: skip
    assert target.inner_text()


def test_axe_has_nothing_serious(watch: Watch, written: tuple[str, str]) -> None:
    kind, address = written
    page = watch.page(address)
    all_figures_drawn(page)
    told = {}
    for look in ("light", "dark", "narrow"):
        page.emulate_media(color_scheme="dark" if look == "dark" else "light")
        if look == "narrow":
            page.set_viewport_size({"width": 380, "height": 900})
        page.wait_for_timeout(300)  # figures are drawn again in the other colours
        picture(page, f"report_{kind}_{look}", whole=False)
        # Inside of a plot there are thousands of elements that axe weighs one by one: its words are its label.
        told[look] = findings(page, without=".main-svg")
    assert told == {"light": [], "dark": [], "narrow": []}
    # Nothing but tables and listings, which scroll by themselves, may be wider than the window.
    assert page.evaluate("document.documentElement.scrollWidth") <= 380


def test_words_of_a_scenario_are_never_run(watch: Watch, tmp_path: Path) -> None:
    found = comparison_fixture.small()
    first = found.options[1]
    judged = replace(first.requirements[0], name=HOSTILE, worst_at=HOSTILE, reason=HOSTILE, description=HOSTILE)
    option = replace(first, label=HOSTILE, name=HOSTILE, notes=(HOSTILE,), requirements=(judged,))
    hostile = replace(
        found, title=HOSTILE, description=HOSTILE, scenario_text=HOSTILE, scenario_path=HOSTILE,
        options=(option, *found.options[2:]), tuning=None,
    )  # fmt: skip
    (path,) = write(hostile, tmp_path / "out", formats=("html",))
    page = watch.page(path.as_uri())
    all_figures_drawn(page)
    assert gone(page, "window.hacked")
    assert HOSTILE in page.locator("h1").inner_text()
    assert page.title() == HOSTILE
    assert page.locator("main script, main img, main [onload], main [onerror]").count() == 0
    picture(page, "report_hostile")


def test_words_on_a_map_are_never_run(watch: Watch, tmp_path: Path) -> None:
    study = map_fixture.map_study()
    options = tuple(replace(one, label=HOSTILE) for one in study.options[:1])
    write_map(replace(study, title=HOSTILE, options=options), tmp_path / "map")
    page = watch.page((tmp_path / "map" / "map.html").as_uri())
    all_figures_drawn(page)
    assert gone(page, "window.hacked")
    assert HOSTILE in page.locator("h1").inner_text()
    assert page.locator("main script, main img, main [onload], main [onerror]").count() == 0


def test_a_script_on_a_page_would_be_seen(watch: Watch) -> None:
    page = watch.page()
    watch.expected = ["x"]
    page.set_content(f"<h1>{HOSTILE}</h1>")
    page.wait_for_timeout(100)
    assert not gone(page, "window.hacked")
