"""The documentation keeps its promises: commands exist, files exist, every page can be reached, README runs."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
SKIPPED = {"_build", "_ext", "_static", "images", "jupyter_execute"}
PAGES = sorted(p for p in DOCS.rglob("*.md") if not SKIPPED & set(p.relative_to(DOCS).parts))
TEXTS = [ROOT / "README.md", *PAGES]
DEV_VERBS = {"test", "lint", "docs", "bench", "setup"}


def cli_verbs() -> set[str]:
    """Names of the functions registered with app.command() in the command line's module, as decorators or by a call."""
    text = (ROOT / "maglev_ctrl" / "cli.py").read_text(encoding="utf-8")
    return {
        node.name
        for node in ast.parse(text).body
        if isinstance(node, ast.FunctionDef) and any("command" in ast.unparse(d) for d in node.decorator_list)
    } | {
        name or function
        for name, function in re.findall(r'^app\.command\((?:name="(\w+)")?\)\((\w+)\)$', text, re.MULTILINE)
    }


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
            found |= set(page.parent.glob(f"{entry}.md"))
    return found


@pytest.mark.parametrize("path", TEXTS, ids=lambda p: str(p.relative_to(ROOT)))
def test_commands_exist(path: Path) -> None:
    assert dev_verbs(path.read_text(encoding="utf-8")) <= DEV_VERBS | cli_verbs()


def test_dev_handles_the_verbs_of_its_own() -> None:
    text = (ROOT / "dev.py").read_text(encoding="utf-8")
    assert {verb for verb in DEV_VERBS if f'verb == "{verb}"' in text} == DEV_VERBS


def test_an_unknown_command_would_be_caught() -> None:
    assert dev_verbs("run `python3 dev.py frobnicate x`") == {"frobnicate"}
    assert not {"frobnicate"} & (DEV_VERBS | cli_verbs())


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


@pytest.mark.slow
def test_the_readme_example_runs() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert blocks
    for block in blocks:
        done = subprocess.run([sys.executable, "-c", block], cwd=ROOT, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        assert done.stdout.splitlines()[0] == "unstable"
