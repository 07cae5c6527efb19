"""Wheel and sdist built from what is committed, looked into, and tried where nothing else is installed."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MINORS = ("3.11", "3.12", "3.13", "3.14")
NEEDED = (
    "maglev_ctrl/py.typed", "maglev_ctrl/cli.py", "maglev_ctrl/report/templates/report.html.j2",
    "maglev_ctrl/report/templates/report.typ", "maglev_ctrl/report/templates/report.css",
    "maglev_ctrl/report/templates/report.js",
)  # fmt: skip
MINI = "scenarios/paper/heave_surge.toml"


def run(command: list[str], *, cwd: Path, seconds: float = 900.0) -> subprocess.CompletedProcess[str]:
    """Run a command with nothing of this environment in it."""
    kept = {
        name: value for name, value in os.environ.items()
        if not name.startswith(("PYTHON", "VIRTUAL_ENV", "MAGLEV", "UV_"))
    }  # fmt: skip
    return subprocess.run(
        command, cwd=cwd, env={**kept, "OPENBLAS_NUM_THREADS": "1"}, capture_output=True, text=True, check=False,
        timeout=seconds,
    )  # fmt: skip


def clean_source(folder: Path, commit: str = "HEAD") -> Path:
    """The committed files, and nothing else that lies about here."""
    source = folder / "source"
    source.mkdir()
    archive = folder / "source.tar"
    subprocess.run(["git", "archive", "-o", str(archive), commit], cwd=ROOT, check=True)
    with tarfile.open(archive) as packed:
        packed.extractall(source, filter="data")
    return source


def build(source: Path, out: Path) -> tuple[list[Path], str]:
    """Wheel and sdist; a problem in words, or ''."""
    done = run([sys.executable, "-m", "build", "--outdir", str(out), str(source)], cwd=source)
    if done.returncode != 0:
        return [], (done.stderr or done.stdout).strip().splitlines()[-1]
    made = sorted(out.iterdir())
    kinds = sorted(path.name.partition(".tar")[1] or path.suffix for path in made)
    return made, "" if kinds == [".tar", ".whl"] else f"expected a wheel and an sdist, got {[p.name for p in made]}"


def contents(file: Path) -> list[str]:
    """Names in a wheel, or in an sdist without its first folder."""
    if file.suffix == ".whl":
        with zipfile.ZipFile(file) as packed:
            return packed.namelist()
    with tarfile.open(file) as packed:
        return [one.name.partition("/")[2] for one in packed.getmembers() if one.isfile()]


def content_faults(names: list[str], *, wheel: bool) -> list[str]:
    """What is missing or does not belong there, in sentences."""
    wrong = [f"{name} is missing" for name in NEEDED if name not in names]
    if not any(name.endswith("LICENSE") for name in names):
        wrong.append("LICENSE is missing")
    for name in names:
        parts = name.split("/")
        if wheel and parts[0] != "maglev_ctrl" and not parts[0].endswith(".dist-info"):
            wrong.append(f"{name} does not belong into a wheel")
        if "__pycache__" in parts or name.endswith((".pyc", ".so", ".pyd")) or parts[0] in ("out", ".venv", "shared"):
            wrong.append(f"{name} was made here and belongs to nobody else")
    if not wheel:
        wrong += [f"{name} is missing" for name in ("pyproject.toml", "README.md") if name not in names]
    return wrong


def pythons() -> dict[str, str]:
    """Where each Python is, by its minor version; '' where there is none."""
    found = dict.fromkeys(MINORS, "")
    here = f"{sys.version_info.major}.{sys.version_info.minor}"
    places = [f"python{minor}" for minor in MINORS]
    homes = [str(path) for path in sorted(Path.home().glob(".pyenv/versions/*/bin/python3"))]
    for place in [*homes, *(shutil.which(one) or "" for one in places), sys.executable if here in found else ""]:
        if not place:
            continue
        told = subprocess.run([place, "-c", "import sys; print('%d.%d' % sys.version_info[:2])"],
                              capture_output=True, text=True, check=False)  # fmt: skip
        if told.returncode == 0 and told.stdout.strip() in found:
            found[told.stdout.strip()] = place
    return found


@contextmanager
def bare(python: str, folder: Path, file: Path) -> Iterator[tuple[Path, str]]:
    """An environment with one file of ours and what it asks for; its folder of programs, and a problem or ''."""
    place = folder / "bare"
    programs = place / ("Scripts" if os.name == "nt" else "bin")
    problem = ""
    uv = shutil.which("uv")
    done = run([python, "-m", "venv", *(["--without-pip"] if uv else []), str(place)], cwd=folder)
    if done.returncode == 0:
        target = programs / ("python.exe" if os.name == "nt" else "python")
        with_uv = [uv or "", "pip", "install", "--quiet", "--python", str(target), str(file)]
        done = run(with_uv if uv else [str(target), "-m", "pip", "install", "--quiet", str(file)], cwd=folder)
    if done.returncode != 0:
        problem = (done.stderr or done.stdout).strip()[-400:] or f"exit status {done.returncode}"
    try:
        yield programs, problem
    finally:
        shutil.rmtree(place, ignore_errors=True)


def smoke(programs: Path, folder: Path, source: Path) -> list[str]:
    """The first things that anybody does, in a folder far from the source; what went wrong, in sentences."""
    command = str(programs / ("maglev-ctrl.exe" if os.name == "nt" else "maglev-ctrl"))
    work = folder / "work"
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir()
    (work / "wrong.toml").write_text("format = 1\nmass = 3\n", encoding="utf-8")
    shutil.copytree(source / "scenarios", work / "scenarios")
    steps: list[tuple[list[str], set[int], str]] = [
        (["--help"], {0}, ""), (["--version"], {0}, ""), (["new", "first"], {0}, "first.toml"),
        (["new", "first"], {2}, ""), (["check", "first.toml"], {0}, ""), (["check", "wrong.toml"], {2}, ""),
        (["schema", "--out", "."], {0}, "scenario.schema.json"), (["report", "missing.toml"], {2}, ""),
        (["report", MINI, "--format", "json", "--out", "report"], {0, 1}, "report/report.json"),
        (["report", MINI, "--out", "whole"], {0, 1}, "whole/report.pdf"),
        (["design", "scenarios/design/hinf_secondary.toml", "--out", "design"], {0, 1}, "design/design.json"),
        (["verify", "design/design.json"], {0}, ""),
        (["export", "design/design.json", "--to", "python", "--option", "h2", "--out", "export"], {0}, "export"),
        (["diff", "report", "whole"], {0}, ""),
    ]  # fmt: skip
    wrong = []
    for words, statuses, made in steps:
        said = " ".join(words)
        done = run([command, *words], cwd=work)
        if done.returncode not in statuses:
            wrong.append(f"{said}: exit status {done.returncode}: {(done.stderr or done.stdout).strip()[-300:]}")
        elif "Traceback" in done.stderr:
            wrong.append(f"{said}: a traceback")
        elif made and not (work / made).exists():
            wrong.append(f"{said}: {made} was not written")
    for name in ("report/report.json", "design/design.json"):
        if (work / name).exists():
            json.loads((work / name).read_text(encoding="utf-8"))
    typed = run([str(programs / "python"), "-c", "import maglev_ctrl; print(maglev_ctrl.__file__)"], cwd=work)
    if str(programs.parent) not in typed.stdout:
        wrong.append(f"another maglev_ctrl was tried: {typed.stdout.strip() or typed.stderr.strip()[-200:]}")
    return wrong
