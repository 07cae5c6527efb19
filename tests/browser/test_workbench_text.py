"""Texts people bring: edited, uploaded, wrong, huge, nested, hostile; words, no trace, nothing lost."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from browser_watch import Watch, findings, gone, picture
from page_server import HOSTILE, PATIENCE, SMALL, Bench, Server
from playwright.sync_api import expect

from maglev_ctrl.scenario import load

TEXT = SMALL.read_text(encoding="utf-8")
MEBIBYTE = 2**20


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    running = Server(tmp_path_factory.mktemp("workbench"))
    yield running
    assert (running.stop(), running.complaints()) == (130, [])


def test_a_text_is_edited_and_applied(watch: Watch, server: Server) -> None:
    bench = Bench.open(watch, server.address)
    before, count = bench.eigenvalues(), bench.shown
    bench.write(bench.text().replace('height = "100 mm"', 'height = "50 mm"').replace("Heave and surge", "Changed"))
    bench.at("apply-text").click()
    bench.after(count)
    assert bench.at("title").inner_text().startswith("Changed")
    assert bench.page.url.partition("#")[2].startswith("s=")
    after, count = bench.eigenvalues(), bench.shown
    assert after != before
    bench.at("undo").click()
    bench.after(count)
    np.testing.assert_allclose(bench.eigenvalues(), before, rtol=1e-7, atol=1e-8)


def test_a_wrong_text_is_told_by_line_and_the_figures_stay(watch: Watch, server: Server) -> None:
    bench = Bench.open(watch, server.address)
    before = bench.eigenvalues()
    lines = bench.text().splitlines()
    number = next(k for k, line in enumerate(lines, 1) if line.startswith("mass ="))
    lines[number - 1] = 'mass = "20 volts"'
    bench.write("\n".join(lines))
    bench.page.locator("#problems li").first.wait_for()
    assert f"Line {number}, column" in bench.page.locator("#problems .jump").first.inner_text()
    assert "volt" in bench.at("problems").inner_text()
    np.testing.assert_allclose(
        bench.eigenvalues(), before, rtol=1e-7, atol=1e-8
    )  # not applied: what was shown is shown
    bench.page.locator("#problems .jump").first.click()
    selected = bench.at("scenario-text").evaluate("t => t.value.slice(0, t.selectionStart).split('\\n').length")
    assert selected == number
    picture(bench.page, "page_wrong_text")
    assert findings(bench.page) == []
    bench.at("revert-text").click()
    bench.page.wait_for_function("document.getElementById('problems').children.length === 0")
    bench.no_trace()


def test_a_wrong_text_that_is_applied_is_refused_and_undone(watch: Watch, server: Server) -> None:
    bench = Bench.open(watch, server.address)
    before, count = bench.eigenvalues(), bench.shown
    bench.write(bench.text() + "\n[oops\n")
    bench.at("apply-text").click()
    bench.settled("failed")
    assert "fault" in bench.at("verdict").inner_text()
    assert bench.at("editor").get_attribute("open") is not None
    bench.page.locator("#problems .jump").first.wait_for()
    picture(bench.page, "page_text_refused")
    assert findings(bench.page) == []
    bench.at("undo").click()
    bench.after(count)
    np.testing.assert_allclose(bench.eigenvalues(), before, rtol=1e-7, atol=1e-8)
    bench.no_trace()


def test_an_upload_is_shown(watch: Watch, server: Server) -> None:
    bench = Bench.open(watch, server.address)
    count = bench.shown
    bench.upload("mine.toml", TEXT.replace("Heave and surge", "Mine").encode())
    bench.after(count)
    assert bench.at("title").inner_text().startswith("Mine")
    assert bench.at("source").locator("option:checked").inner_text() == "mine (yours)"


def nested(depth: int) -> str:
    return "format = 1\n[" + ".".join(["a"] * depth) + "]\nb = 1\n"


WRONG = {
    "not_toml": b"this is = = not [toml",
    "empty": b"",
    "long_line": nested(20_000).encode(),
    "nested_tables": nested(9_000).encode(),
    "nested_lists": b"format = 1\na = " + b"[\n" * 50_000 + b"]\n" * 50_000,
    "nested_inline": b"format = 1\na = " + b"{a = " * 3_000 + b"1" + b"}" * 3_000,
    "nul": b"format = 1\n\x00\x00",
    "no_scenario": b'[project]\nname = "other"\n',
    "numbers": TEXT.replace('mass = "20 t"', 'mass = "1e400 t"').encode(),
    "paths": (TEXT + '\n[forces]\ntable = "/etc/passwd"\n').encode(),
}


def test_wrong_uploads_are_refused_in_words(watch: Watch, server: Server) -> None:
    bench = Bench.open(watch, server.address)
    before = bench.eigenvalues()
    for name, content in WRONG.items():
        count = bench.shown
        bench.upload(f"{name}.toml", content)
        bench.settled("failed")
        words = bench.at("verdict-words").inner_text() + bench.at("problems").inner_text()
        assert len(words) > 20 and "root:" not in words, name
        bench.no_trace()
        bench.at("undo").click()
        bench.after(count)
        np.testing.assert_allclose(bench.eigenvalues(), before, rtol=1e-7, atol=1e-8, err_msg=name)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("huge.toml", b"# " + b"x" * (50 * MEBIBYTE), "50.0 MiB; expected at most 1 MiB"),
        ("latin.toml", "title = 'Größe'".encode("latin-1"), "expected UTF-8 text"),
        ("binary.toml", bytes(range(256)), "expected UTF-8 text"),
    ],
)  # fmt: skip
def test_an_upload_that_is_no_text_changes_nothing(
    watch: Watch, server: Server, name: str, content: bytes, words: str
) -> None:
    bench = Bench.open(watch, server.address)
    before = bench.eigenvalues()
    bench.upload(name, content)
    bench.page.wait_for_function("document.getElementById('upload-words').textContent !== ''")
    assert words in bench.at("upload-words").inner_text() and name in bench.at("upload-words").inner_text()
    np.testing.assert_allclose(bench.eigenvalues(), before, rtol=1e-7, atol=1e-8)
    assert bench.state in ("preview", "settled")
    picture(bench.page, f"page_upload_{name.partition('.')[0]}", whole=False)
    assert findings(bench.page) == []


def hostile_text() -> str:
    """A scenario whose every name that a person may choose holds a script."""
    words = HOSTILE.replace('"', "'")
    scenario = load(SMALL)
    text = TEXT.replace(scenario.title, words)
    for place, option in enumerate(scenario.options):
        if option.label:
            text = text.replace(f'label = "{option.label}"', f'label = "{words} {place}"')
    return text


def test_names_with_scripts_are_shown_as_text(watch: Watch, server: Server) -> None:
    bench = Bench.open(watch, server.address)
    count = bench.shown
    bench.upload("<img src=x onerror=hacked>.toml", hostile_text().encode())
    expect(bench.at("title")).to_have_text(HOSTILE, timeout=PATIENCE)
    bench.after(count)
    expect(bench.page.locator("#host-comparison")).to_contain_text(HOSTILE, timeout=PATIENCE)
    assert HOSTILE in bench.page.title()
    assert HOSTILE in bench.at("option").inner_text()
    assert gone(bench.page, "window.hacked")
    assert bench.page.locator("main img[src=x], aside img[src=x], main script").count() == 0
    picture(bench.page, "page_hostile")
    for figure in ("eigenvalues", "map", "shape"):
        if bench.page.locator(f"#view-{figure} .downloads a").count():
            svg = bench.downloaded(figure, "svg") if figure == "eigenvalues" else b""
            assert b"<script>window" not in svg and b"<img" not in svg
    bench.write("nonsense " + HOSTILE)
    bench.at("apply-text").click()
    bench.settled("failed")
    assert gone(bench.page, "window.hacked")
