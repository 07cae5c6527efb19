"""Which packages the modules import, against those that pyproject.toml names."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = "maglev_ctrl"
DISTRIBUTIONS = {
    "skfem": "scikit-fem", "tree_sitter": "tree-sitter", "tree_sitter_toml": "tree-sitter-toml",
    "pydantic_core": "pydantic-core",
}  # fmt: skip
"""Where a module has another name than its package."""
CARRIED = {
    "contourpy": "matplotlib", "markupsafe": "jinja2", "pydantic-core": "pydantic", "tornado": "bokeh",
    "pandas": "xarray",
}  # fmt: skip
"""Packages that are no choice of ours: the ones they come with need them, at versions of their own choosing."""
EXTRAS = {
    "ui": ("maglev_ctrl/workbench/", "maglev_ctrl/cli_ui.py"),
    "dist": ("maglev_ctrl/study/sweep/", "maglev_ctrl/cli_sweep.py"),
    "fast": ("maglev_ctrl/kernels/", "maglev_ctrl/analysis/"),
    "gpu": ("maglev_ctrl/kernels/", "maglev_ctrl/analysis/"),
}  # fmt: skip
"""Where the packages of an extra may be imported."""


_COMMON = {"numpy", "scipy"}
_LINE = re.compile(r"(?:^|;|:)[ \t]*(?:import|from)[ \t]+(\w+)", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Import:
    """A module of another package, where it is imported."""

    package: str
    file: str
    line: int


def imports(files: Iterable[tuple[str, str]]) -> list[Import]:
    """Every import of a package that is neither ours nor Python's, in files given as (path, text)."""
    found = []
    for path, text in files:
        quick = _plain_imports(path, text)
        if quick is not None:
            found += quick
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Import):
                named = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
                named = [node.module]
            elif _loads(node):
                named = [node.args[0].value]  # type: ignore[attr-defined]
            else:
                continue
            for name in named:
                top = name.partition(".")[0]
                if top != PACKAGE and top not in sys.stdlib_module_names:
                    found.append(Import(canonicalize_name(DISTRIBUTIONS.get(top, top)), path, node.lineno))
    return found


def _plain_imports(path: str, text: str) -> list[Import] | None:
    """The imports of a file that names no module but Python's, ours and the two that every file has; else None.

    Most files are of this kind, and need not be parsed.
    """
    named = {found[1] for found in _LINE.finditer(text)} - sys.stdlib_module_names - {PACKAGE}
    if not named <= _COMMON or "import_module(" in text or " files(" in text or "(files(" in text:
        return None
    return [Import(name, path, 0) for name in sorted(named)]


def _loads(node: ast.AST) -> bool:
    """import_module("name") or files("name"), with the name as a word."""
    return (
        isinstance(node, ast.Call)
        and getattr(node.func, "attr", getattr(node.func, "id", "")) in ("import_module", "files")
        and bool(node.args)
        and isinstance(node.args[0], ast.Constant)
        and isinstance(node.args[0].value, str)
    )


def sources() -> list[tuple[str, str]]:
    """Every module of the package, with its text."""
    return [
        (path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8"))
        for path in sorted((ROOT / PACKAGE).rglob("*.py"))
    ]


def declared(project: dict[str, Any]) -> dict[str, set[str]]:
    """Package names by extra; the base under ""."""
    told = project["project"]
    groups = {"": told["dependencies"], **told["optional-dependencies"]}
    return {extra: {canonicalize_name(Requirement(line).name) for line in lines} for extra, lines in groups.items()}


def users(package: str, found: list[Import]) -> list[str]:
    """Files that import a package, without doubles."""
    return sorted({one.file for one in found if one.package == package})


def faults(project: dict[str, Any], found: list[Import]) -> list[str]:
    """What is declared and not used, or used and not declared, in sentences."""
    groups = declared(project)
    wrong = []
    for one in found:
        carrier = CARRIED.get(one.package, one.package)
        if carrier in groups[""]:
            continue
        homes = [place for extra, places in EXTRAS.items() if carrier in groups[extra] for place in places]
        if not homes:
            wrong.append(f"{one.file}:{one.line}: {one.package} is imported and not declared")
        elif not one.file.startswith(tuple(homes)):
            wrong.append(f"{one.file}:{one.line}: {one.package} is of an extra that is not this file's")
    used = {CARRIED.get(one.package, one.package) for one in found}
    wrong += [f"{package}: declared and never imported" for package in sorted(groups[""] - used)]
    return wrong
