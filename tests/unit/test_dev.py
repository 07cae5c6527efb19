"""The set-up script: standard library only, clear about what is missing, quick when there is nothing to do."""

from __future__ import annotations

import ast
import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def dev() -> ModuleType:
    spec = importlib.util.spec_from_file_location("dev", ROOT / "dev.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_standard_library_only() -> None:
    tree = ast.parse((ROOT / "dev.py").read_text(encoding="utf-8"))
    names = {
        alias.name.split(".")[0] for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names
    }
    names |= {str(node.module).split(".")[0] for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert names <= set(sys.stdlib_module_names)


def test_missing_ensurepip_names_the_one_command(dev: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ensurepip", None)
    problem = dev.make_environment()
    assert f"sudo apt-get install python{sys.version_info.major}.{sys.version_info.minor}-venv" in problem


def test_an_old_python_is_told_so(
    dev: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(dev.sys, "version_info", (3, 9, 2))
    assert dev.main(["report"]) == 2
    assert "Python 3.11 or newer is needed; this is 3.9.2" in capsys.readouterr().err


def test_a_set_up_environment_is_left_alone(dev: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    stamp = tmp_path / "stamp"
    monkeypatch.setattr(dev, "STAMP", stamp)
    stamp.write_text(dev.wanted(), encoding="utf-8")

    def fail(*_: object, **__: object) -> None:
        raise AssertionError("nothing needs to be run")

    monkeypatch.setattr(dev.subprocess, "run", fail)
    assert dev.set_up() == ""
    stamp.write_text("another Python", encoding="utf-8")
    with pytest.raises(AssertionError, match="nothing needs"):
        dev.set_up()


def test_a_failed_step_is_named(dev: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    class Failed:
        returncode = 1

    monkeypatch.setattr(dev, "STAMP", tmp_path / "stamp")
    monkeypatch.setattr(dev.shutil, "which", lambda name: "uv")
    monkeypatch.setattr(dev.subprocess, "run", lambda *_, **__: Failed())
    assert dev.set_up().startswith("set-up failed at: uv venv")
    assert not (tmp_path / "stamp").exists()
