"""The house rules, checked: floors, sizes, lazy imports, docstrings against signatures, public names."""

from __future__ import annotations

import ast
import graphlib
import importlib
import importlib.util
import inspect
import pkgutil
import re
import subprocess
import sys
from pathlib import Path

import grimp
import pytest

import maglev_ctrl

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "maglev_ctrl"
MODULES = sorted(
    name for _, name, _ in pkgutil.walk_packages([str(PACKAGE)], "maglev_ctrl.") if not name.endswith("__main__")
)
LINES_AT_MOST = 450


def test_floors_hold() -> None:
    done = subprocess.run(
        [sys.executable, "-c", "import sys; from importlinter.cli import lint_imports_command as c; sys.exit(c())"],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_files_stay_small(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) <= LINES_AT_MOST


HEAVY = ("control", "cvxpy", "osqp", "matplotlib", "pint", "plotly", "pydantic", "scipy", "numpy", "typst")


@pytest.mark.parametrize("statement", ["import maglev_ctrl", "import maglev_ctrl.cli"])
def test_nothing_heavy_is_loaded_early(statement: str) -> None:
    code = f"{statement}\nimport sys\nprint(','.join(sorted(set(sys.modules) & set({HEAVY!r}))))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip() == ""


def test_help_loads_nothing_heavy() -> None:
    code = (
        "import sys\nfrom maglev_ctrl.cli import main\n"
        "sys.argv=['maglev-ctrl','--help']\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        f"print('LOADED:' + ','.join(sorted(set(sys.modules) & set({HEAVY!r}))))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip().endswith("LOADED:")
    assert "report" in done.stdout


def test_public_names_resolve() -> None:
    for name in maglev_ctrl.__all__:
        assert getattr(maglev_ctrl, name) is not None


def test_an_unknown_public_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'lqrr'"):
        _ = maglev_ctrl.lqrr


def documented_parameters(docstring: str) -> list[str]:
    """Names listed in a numpy-style Parameters section."""
    match = re.search(r"Parameters\n\s*-+\n(.*?)(?:\n\s*\n\s*\w[\w ]*\n\s*-{3,}|\Z)", docstring, re.DOTALL)
    if not match:
        return []
    names: list[str] = []
    lines = match.group(1).splitlines()
    indent = min((len(x) - len(x.lstrip()) for x in lines if x.strip()), default=0)
    for line in lines:
        if line.strip() and len(line) - len(line.lstrip()) == indent and " :" in line:
            names += [name.strip().lstrip("*") for name in line.split(" :")[0].split(",")]
    return names


def public_functions() -> list[tuple[str, object]]:
    found = []
    for module_name in MODULES:
        module = importlib.import_module(module_name)
        for name, thing in vars(module).items():
            if name.startswith("_") or getattr(thing, "__module__", None) != module_name:
                continue
            if inspect.isfunction(thing):
                found.append((f"{module_name}.{name}", thing))
            elif inspect.isclass(thing):
                for member_name, member in vars(thing).items():
                    function = member.__func__ if isinstance(member, (classmethod, staticmethod)) else member
                    if inspect.isfunction(function) and not member_name.startswith("_"):
                        found.append((f"{module_name}.{name}.{member_name}", function))
    return found


@pytest.mark.parametrize(("name", "function"), public_functions(), ids=lambda v: v if isinstance(v, str) else "")
def test_documented_parameters_exist(name: str, function: object) -> None:
    docstring = inspect.getdoc(function)
    assert docstring, f"{name} has no docstring"
    signature = set(inspect.signature(function).parameters)  # type: ignore[arg-type]
    unknown = [p for p in documented_parameters(docstring) if p not in signature and re.fullmatch(r"\w+", p)]
    assert not unknown, f"{name} documents parameters it does not take: {unknown}"


def test_the_docstring_check_can_fail() -> None:
    assert documented_parameters("Do.\n\nParameters\n----------\nspeed, height : m\n") == ["speed", "height"]


NUMERICS = ("arrays", "systems", "kernels", "forces", "guideway", "vehicle", "analysis", "synthesis")


def test_numerics_neither_print_nor_open_files() -> None:
    offenders = []
    for path in PACKAGE.rglob("*.py"):
        if path.relative_to(PACKAGE).parts[0].removesuffix(".py") not in NUMERICS:
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("print", "open"):
                offenders.append(f"{path.name}:{node.lineno} {node.func.id}()")
    assert not offenders


def test_no_public_function_takes_a_bag_of_keywords() -> None:
    bags = [
        name
        for name, function in public_functions()
        if any(p.kind is p.VAR_KEYWORD for p in inspect.signature(function).parameters.values())  # type: ignore[arg-type]
    ]
    assert not bags


def test_no_module_imports_itself_in_a_circle() -> None:
    graph = grimp.build_graph("maglev_ctrl", exclude_type_checking_imports=True)
    order = graphlib.TopologicalSorter({m: graph.find_modules_directly_imported_by(m) for m in graph.modules})
    order.prepare()  # raises CycleError, which names the circle
