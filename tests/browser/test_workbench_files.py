"""What the page hands out: every download is the thing it says it is, and a report arrives whatever happens between."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import xarray as xr
from browser_watch import Watch, gone, picture
from page_server import HOSTILE, PATIENCE, SMALL, TRAIN, Bench, Server

from maglev_ctrl.scenario import load

TEXT = SMALL.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    running = Server(tmp_path_factory.mktemp("workbench"))
    yield running
    assert (running.stop(), running.complaints()) == (130, [])


def test_the_scenario_downloads_with_the_sliders_in_it(watch: Watch, server: Server, tmp_path: Path) -> None:
    bench = Bench.open(watch, server.address)
    count = bench.shown
    bench.type("speed", "250")
    bench.after(count)
    path = tmp_path / "downloaded.toml"
    path.write_bytes(bench.downloaded("download-scenario", ""))
    found = load(path)
    assert found.operating.speed == pytest.approx(250.0 / 3.6)
    assert [option.name for option in found.options] == [option.name for option in load(SMALL).options]
    assert "# What to look for in the report" in path.read_text(encoding="utf-8")


def kinds(bench: Bench) -> list[tuple[str, str]]:
    """Every download that is offered: view and kind."""
    return [
        (str(link.get_attribute("data-view")), str(link.get_attribute("data-kind")))
        for link in bench.page.locator(".downloads a").all()
    ]


def checked(kind: str, content: bytes, folder: Path) -> None:
    """Read a download as what it says it is."""
    match kind:
        case "svg":
            root = ElementTree.fromstring(content)
            assert root.tag.endswith("svg") and len(list(root.iter())) > 10
        case "png":
            assert content.startswith(b"\x89PNG\r\n") and len(content) > 2000
        case "csv":
            rows = [row for row in csv.reader(io.StringIO(content.decode())) if row and not row[0].startswith("#")]
            assert len(rows) > 1 and any(re.search(r"\d", cell) for row in rows[1:] for cell in row)
        case "nc":
            path = folder / "downloaded.nc"
            path.write_bytes(content)
            with xr.open_dataset(path, engine="scipy" if content.startswith(b"CDF") else "h5netcdf") as found:
                assert found.sizes or found.data_vars


def test_every_view_downloads(watch: Watch, server: Server, tmp_path: Path) -> None:
    bench = Bench.open(watch, f"{server.address}?scenario={TRAIN}&option=combined")
    bench.page.wait_for_function("Number(document.documentElement.dataset.compared) > 0", timeout=PATIENCE)
    modes = bench.modes()
    bench.page.locator("#host-eigenvalues select").select_option(
        index=next(k for k, words in enumerate(modes) if " Hz, " in words)  # the others have no ledger to download
    )
    bench.page.wait_for_timeout(500)
    label = bench.page.locator("#host-eigenvalues select option:checked").inner_text().partition(":")[0]
    assert label.encode() in bench.downloaded("ledger", "csv")
    offered = kinds(bench)
    assert {view for view, _ in offered} == {"eigenvalues", "map", "ledger", "shape", "margins", "comparison"}
    for view, kind in offered:
        content = bench.downloaded(view, kind)
        checked(kind, content, tmp_path)


def test_downloaded_numbers_are_those_on_the_screen(watch: Watch, server: Server, tmp_path: Path) -> None:
    bench = Bench.open(watch, server.address)
    path = tmp_path / "eigenvalues.nc"
    path.write_bytes(bench.downloaded("eigenvalues", "nc"))
    drawn = np.array([x for x, _ in bench.eigenvalues()])
    with xr.open_dataset(path, engine="scipy" if path.read_bytes().startswith(b"CDF") else "h5netcdf") as found:
        numbers = np.concatenate([np.ravel(value) for value in found.variables.values() if value.dtype.kind == "f"])
    assert all(np.any(np.isclose(numbers, x, rtol=1e-9, atol=1e-15)) for x in drawn)


def test_a_download_that_cannot_be_made_is_told(watch: Watch, server: Server) -> None:
    watch.expected = ["409"]
    bench = Bench.open(watch, server.address)
    bench.page.locator("a[data-view='map'][data-kind='svg']").click()
    bench.page.wait_for_function("document.getElementById('message').textContent !== ''", timeout=PATIENCE)
    assert bench.at("message").inner_text().startswith("The download is not there: ")
    bench.no_trace()


def report_done(bench: Bench) -> None:
    """Wait for the links to a report."""
    bench.page.locator("#report-links a").first.wait_for(timeout=4 * PATIENCE)
    assert bench.at("report-words").inner_text().startswith("The report is ready")


def test_a_report_is_made_found_again_and_opened(watch: Watch, server: Server) -> None:
    """The page closes in the middle and another one of the same scenario finds the report."""
    bench = Bench.open(watch, server.address)
    bench.at("make-report").click()
    bench.page.wait_for_function(
        "document.getElementById('report-words').textContent.startsWith('Making the report')", timeout=PATIENCE
    )
    picture(bench.page, "page_report_running", whole=False)
    address = bench.page.url
    bench.page.context.close()
    again = Bench.open(watch, address)
    report_done(again)
    picture(again.page, "page_report_done", whole=False)
    names = [str(link.get_attribute("href")).rpartition("/")[2] for link in again.page.locator("#report-links a").all()]
    assert names == ["report.html", "report.pdf", "report.json"]
    with again.page.expect_popup() as opened:
        again.page.locator("#report-links a").first.click()
    report = opened.value
    report.wait_for_load_state("domcontentloaded")
    assert load(SMALL).title in report.locator("h1").inner_text()
    report.wait_for_selector("figure[data-drawn=yes]", timeout=PATIENCE)
    picture(report, "page_report_opened", whole=False)
    (folder,) = (server.folder / "out" / "workbench").iterdir()
    assert {path.name for path in folder.iterdir()} >= {"report.html", "report.pdf", "report.json"}


def test_a_report_is_cancelled(watch: Watch, server: Server) -> None:
    bench = Bench.open(watch, server.address)
    count = bench.shown
    bench.type("speed", "333")
    bench.after(count)
    bench.at("make-report").click()
    bench.at("cancel-report").click(timeout=PATIENCE)
    bench.page.wait_for_function(
        "document.getElementById('report-words').textContent.includes('cancelled')", timeout=PATIENCE
    )
    assert bench.at("make-report").is_enabled()
    assert bench.page.locator("#report-links a").count() == 0


def test_a_report_with_a_script_in_its_name_is_text(watch: Watch, server: Server) -> None:
    title = load(SMALL).title
    bench = Bench.open(watch, server.address)
    count = bench.shown
    bench.upload("hostile.toml", TEXT.replace(title, HOSTILE).encode())
    bench.after(count)
    bench.at("make-report").click()
    report_done(bench)
    links = [str(link.get_attribute("href")) for link in bench.page.locator("#report-links a").all()]
    page = watch.page(server.address.rstrip("/") + links[0])
    page.wait_for_selector("figure[data-drawn=yes]", timeout=PATIENCE)
    assert HOSTILE in page.locator("h1").inner_text() and gone(page, "window.hacked")
    assert page.locator("main img[src=x], main script").count() == 0
    pdf = page.request.get(server.address.rstrip("/") + links[1]).body()
    assert pdf.startswith(b"%PDF") and b"/JavaScript" not in pdf
