"""The documentation keeps its promises: commands exist, files exist, every page can be reached, README runs."""

from __future__ import annotations

import importlib.util
import json
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from maglev_ctrl.cli_help import VERBS

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
SKIPPED = {"_build", "_ext", "_static", "images", "jupyter_execute"}
PAGES = sorted(p for p in DOCS.rglob("*.md") if not SKIPPED & set(p.relative_to(DOCS).parts))
TEXTS = [ROOT / "README.md", *PAGES]
DEV_VERBS = {"test", "lint", "docs", "validation", "bench", "setup", "hold", "cluster"}


def extension(name: str) -> ModuleType:
    """A module of docs/_ext, which is no package."""
    spec = importlib.util.spec_from_file_location(name, DOCS / "_ext" / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look for their module there
    spec.loader.exec_module(module)
    return module


def dev_verbs(text: str) -> set[str]:
    """Verbs that follow dev.py in a text."""
    return set(re.findall(r"dev\.py ([a-z]+)", text))


def scenario_files(text: str) -> set[str]:
    """Scenario files that a text names."""
    return set(re.findall(r"scenarios/[\w/]+\.toml", text))


def toctree_entries(page: Path, text: str) -> set[Path]:
    """Pages that a page's tables of contents name."""
    found: set[Path] = set()
    for block in re.findall(r"```\{toctree\}\n(.*?)```", text, re.DOTALL):
        for line in block.splitlines():
            entry = line.strip()
            if not entry or entry.startswith(":"):
                continue
            titled = re.fullmatch(r".* <(.+)>", entry)
            found |= set(page.parent.glob(f"{titled[1] if titled else entry}.md"))
    return found


@pytest.mark.parametrize("path", TEXTS, ids=lambda p: str(p.relative_to(ROOT)))
def test_commands_exist(path: Path) -> None:
    assert dev_verbs(path.read_text(encoding="utf-8")) <= DEV_VERBS | set(VERBS)


def test_dev_handles_the_verbs_of_its_own() -> None:
    text = (ROOT / "dev.py").read_text(encoding="utf-8")
    assert {verb for verb in DEV_VERBS if f'verb == "{verb}"' in text} == DEV_VERBS


def test_an_unknown_command_would_be_caught() -> None:
    assert dev_verbs("run `python3 dev.py frobnicate x`") == {"frobnicate"}
    assert not {"frobnicate"} & (DEV_VERBS | set(VERBS))


@pytest.mark.parametrize("path", TEXTS, ids=lambda p: str(p.relative_to(ROOT)))
def test_scenario_files_exist(path: Path) -> None:
    missing = [name for name in scenario_files(path.read_text(encoding="utf-8")) if not (ROOT / name).is_file()]
    assert not missing


def test_every_page_is_in_a_table_of_contents() -> None:
    reached: set[Path] = {DOCS / "index.md"}
    waiting = [DOCS / "index.md"]
    while waiting:
        page = waiting.pop()
        for found in toctree_entries(page, page.read_text(encoding="utf-8")) - reached:
            reached.add(found)
            waiting.append(found)
    assert sorted(str(p.relative_to(DOCS)) for p in set(PAGES) - reached) == []


def test_a_page_outside_would_be_caught(tmp_path: Path) -> None:
    (tmp_path / "inside.md").write_text("x")
    (tmp_path / "outside.md").write_text("x")
    assert toctree_entries(tmp_path / "index.md", "```{toctree}\ninside\n```") == {tmp_path / "inside.md"}
    assert toctree_entries(tmp_path / "index.md", "```{toctree}\nIn here <inside>\n```") == {tmp_path / "inside.md"}


@pytest.mark.parametrize("path", TEXTS, ids=lambda p: str(p.relative_to(ROOT)))
def test_pictures_exist(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    pictures = re.findall(r"!\[[^\]]*\]\(([^)\s]+)\)", text)
    missing = [name for name in pictures if "://" not in name and not (path.parent / name).is_file()]
    assert not missing


def test_every_equation_of_the_paper_is_mapped() -> None:
    text = (DOCS / "paper" / "equation_map.md").read_text(encoding="utf-8")
    mapped: set[int] = set()
    for cell in re.findall(r"^\| ([\d, -]+) \|", text, re.MULTILINE):
        for part in cell.split(","):
            first, _, last = part.strip().partition("-")
            mapped |= set(range(int(first), int(last or first) + 1))
    assert set(range(1, 52)) - mapped == set()


def test_code_named_in_the_equation_map_exists() -> None:
    text = (DOCS / "paper" / "equation_map.md").read_text(encoding="utf-8")
    modules = set(re.findall(r"`((?:analysis|forces|vehicle|systems|synthesis|guideway)[\w.]*)", text))
    assert modules
    for name in modules:
        parts = name.split(".")
        for length in range(len(parts), 0, -1):
            path = ROOT / "maglev_ctrl" / Path(*parts[:length])
            if path.is_dir() or path.with_suffix(".py").is_file():
                source = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
                rest = parts[length:]
                assert not rest or rest[0] in source.read_text(encoding="utf-8"), (
                    f"{name}: no {rest[0]} in {source.name}"
                )
                break
        else:
            pytest.fail(f"{name} names no module")


def pinned(text: str) -> list[tuple[str, str]]:
    """(file, test) of every test that a page names."""
    return re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", text)


def test_tests_named_by_the_errata_exist() -> None:
    named = pinned((DOCS / "paper" / "errata.md").read_text(encoding="utf-8"))
    assert len(named) >= 20
    missing = [name for file, name in named if f"def {name}(" not in (ROOT / file).read_text(encoding="utf-8")]
    assert not missing


def test_a_misspelt_test_would_be_missed() -> None:
    (found,) = pinned("| x | `tests/house/test_docs.py::test_no_such_thing` |")
    assert f"def {found[1]}(" not in (ROOT / found[0]).read_text(encoding="utf-8").replace(found[1] + "`", "")


def named_test_files(text: str) -> set[str]:
    """Test files that a page names."""
    return set(re.findall(r"`(tests/[\w/]+\.py)[`:]", text))


def test_test_files_named_by_the_pages_exist() -> None:
    named = {name for page in PAGES for name in named_test_files(page.read_text(encoding="utf-8"))}
    assert len(named) >= 40
    assert sorted(name for name in named if not (ROOT / name).is_file()) == []


def test_a_test_file_that_is_not_there_would_be_missed() -> None:
    (found,) = named_test_files("| x | `tests/unit/test_no_such_file.py` |")
    assert not (ROOT / found).is_file()


@pytest.mark.parametrize("path", sorted((DOCS / "theory").glob("*.md")), ids=lambda p: p.stem)
def test_every_theory_page_tells_its_limits_and_references(path: Path) -> None:
    headings = re.findall(r"^## (\w+)", path.read_text(encoding="utf-8"), re.MULTILINE)
    assert {"Limits", "References"} <= set(headings)


LOCAL_PAGE = """<html><head><link rel="canonical" href="https://example.org/"><link rel="stylesheet" href="a.css">
<style>p { background: url("paper.png") }</style><script src="a.js"></script></head>
<body id="top"><svg xmlns="http://www.w3.org/2000/svg"></svg><img src="data:image/png;base64,AA//AA">
<a href="https://example.org/">out</a><a href="#top">up</a><a href="other.html#there">on</a></body></html>"""


def built_site(folder: Path, page: str) -> list[str]:
    """What the build would say of a site of two pages, a style sheet and a script."""
    checks = extension("local_only")
    (folder / "index.html").write_text(page)
    (folder / "other.html").write_text('<h1 id="there">x</h1>')
    (folder / "a.css").write_text("@font-face { src: url(font.ttf); }")
    (folder / "a.js").write_text("/* https://example.org/licence */ const space = 'http://www.w3.org/2000/svg';")
    pages = checks.read_site(folder)
    return [*checks.outside_loads(folder, pages), *checks.dead_links(folder, pages)]


def test_a_site_that_is_whole_and_local_passes(tmp_path: Path) -> None:
    assert built_site(tmp_path, LOCAL_PAGE) == []


@pytest.mark.parametrize(
    ("local", "outside"),
    [
        ('<script src="a.js">', '<script src="https://cdn.example.org/mathjax.js">'),
        ('<script src="a.js">', '<script src="//cdn.example.org/mathjax.js">'),
        ('<script src="a.js">', "<script>fetch('https://example.org/track')</script><script>"),
        ('rel="stylesheet" href="a.css"', 'rel="stylesheet" href="https://fonts.example.org/css"'),
        ('rel="canonical"', 'rel="preconnect"'),
        ('url("paper.png")', "url(https://example.org/paper.png)"),
        ('<img src="', '<img src="https://example.org/logo.png" alt="'),
        ('<img src="', '<img srcset="a.png, https://example.org/logo.png 2x" alt="'),
        ("<svg ", '<svg><image xlink:href="http://example.org/a.svg"/></svg><svg '),
        ("<svg ", '<p style="background: url(//example.org/a.png)"></p><svg '),
        ("<svg ", '<iframe src="https://example.org/"></iframe><svg '),
        ('href="#top"', 'href="#bottom"'),
        ("other.html#there", "other.html#here"),
        ("other.html#there", "gone.html"),
    ],
)
def test_a_page_that_loads_from_outside_or_leads_nowhere_fails_the_build(
    tmp_path: Path, local: str, outside: str
) -> None:
    assert local in LOCAL_PAGE
    assert len(built_site(tmp_path, LOCAL_PAGE.replace(local, outside, 1))) == 1


def test_outside_loads_in_style_sheets_and_scripts_are_seen(tmp_path: Path) -> None:
    built_site(tmp_path, LOCAL_PAGE)
    (tmp_path / "a.css").write_text('@import "https://fonts.example.org/css";')
    (tmp_path / "a.js").write_text('const feed = "https://example.org/feed";')
    checks = extension("local_only")
    assert len(list(checks.outside_loads(tmp_path, {}))) == 2


def test_every_claim_names_its_tests_and_they_exist() -> None:
    recorder = extension("record_validation")
    checks = extension("validation")
    rows = re.findall(r"^\| (?!what|claim|-).*\|$", (DOCS / "validation.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert len(rows) > 80
    assert [row for row in rows if not recorder.named_tests(row)] == []
    assert checks.missing_tests(recorder.named_tests("\n".join(rows))) == []
    assert checks.missing_tests([("tests/unit/test_gone.py", ""), ("tests/house/test_docs.py", "test_gone")]) == [
        "tests/unit/test_gone.py",
        "tests/house/test_docs.py::test_gone",
    ]


def test_the_record_of_the_validation_holds_no_failure() -> None:
    record = json.loads((DOCS / "_data" / "validation.json").read_text(encoding="utf-8"))
    said = [(file, test, outcomes) for file, kept in record.items() for test, outcomes in kept["tests"].items()]
    assert [(file, test) for file, test, outcomes in said if "failed" in outcomes] == []
    assert all({"version", "commit", "day"} <= set(kept) for kept in record.values())


def test_what_tests_say_reaches_the_page() -> None:
    recorder = extension("record_validation")
    checks = extension("validation")
    told = recorder.read_results(
        """<testsuites><testsuite>
        <testcase classname="tests.unit.test_a" name="test_one[1]" time="0.5"><properties>
          <property name="error" value="1e-12"/><property name="allowed" value="1e-9"/></properties></testcase>
        <testcase classname="tests.unit.test_a" name="test_one[2]" time="0.25"><properties>
          <property name="error" value="5e-10"/><property name="allowed" value="1e-9"/></properties></testcase>
        <testcase classname="tests.unit.test_a.TestTwo" name="test_two" time="0"><skipped/></testcase>
        <testcase classname="tests.unit.test_b" name="test_three" time="0"><failure/></testcase>
        </testsuite></testsuites>"""
    )
    a, b = "tests/unit/test_a.py", "tests/unit/test_b.py"
    assert told[a]["seconds"] == 0.75
    assert checks.told(told, [(a, "")]) == ("2 passed, 1 skipped, largest error 5e-10, allowed 1e-09", "passed")
    assert checks.told(told, [(a, "test_two")]) == ("1 skipped", "unknown")
    assert checks.told(told, [(a, ""), (b, "")])[1] == "failed"
    assert checks.told(told, [(a, "test_gone")]) == ("not recorded yet", "unknown")
    assert checks.told({}, [(a, "")]) == ("not recorded yet", "unknown")


@pytest.mark.slow
def test_the_readme_example_runs() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert blocks
    for block in blocks:
        done = subprocess.run([sys.executable, "-c", block], cwd=ROOT, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        assert done.stdout.splitlines()[0] == "unstable"
