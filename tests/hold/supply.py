"""The supply chain: lock file, licences, bill of materials, known flaws, and wheel and sdist tried from nothing.

    python tests/hold/supply.py                all of it
    python tests/hold/supply.py --short        without building and trying
    python tests/hold/supply.py --check        the lock file, the licences and the imports (no network, a second)
    python tests/hold/supply.py --lock         make requirements.lock anew
    python tests/hold/supply.py --licences DIR list the licences anew; more places with metadata after the word
    python tests/hold/supply.py --sbom FILE    write and check the bill of materials
    python tests/hold/supply.py --audit        ask for known flaws; says SKIPPED where nobody can be asked
    python tests/hold/supply.py --smoke [3.12] build, look into it, and try it in bare environments

More than one may be given; --record FILE writes what was found, --commit NAME builds another commit than HEAD, --files
DIR tries what was built already, --content DIR only looks into it.
"""

from __future__ import annotations

import argparse
import json
import sys
import sysconfig
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

import supply_bom
import supply_imports
import supply_licences
import supply_lock
import supply_smoke

ROOT = supply_lock.ROOT
PAGE = ROOT / "docs" / "reference" / "dependencies.md"
LIST = ("<!-- list of licences: made by tests/hold/supply.py --licences -->\n\n", "\n\n<!-- end of the list -->")


@dataclass(frozen=True, slots=True)
class Figure:
    """One thing that was asked for, and what came of it; `met` is None where it was not tried, which is no pass."""

    what: str
    asked: str
    reached: str
    met: bool | None


def check() -> list[Figure]:
    """What needs nothing but the files."""
    project = supply_lock.project()
    lock = supply_lock.LOCK.read_text(encoding="utf-8")
    found = supply_lock.faults(lock, project)
    pins, _ = supply_lock.read(lock)
    figures = [
        Figure("lock file", "belongs to pyproject.toml on 3 systems and Python 3.11 to 3.14",
               "; ".join(found[:3]) or f"{len(pins)} pins, {sum(len(pin.hashes) for pin in pins)} hashes", not found),
    ]  # fmt: skip
    wrong = licence_faults(PAGE.read_text(encoding="utf-8"), supply_lock.names(), project)
    figures.append(Figure("licences", "each locked package listed, none of the base with strong copyleft",
                          "; ".join(wrong[:3]) or f"{len(supply_lock.names())} listed", not wrong))  # fmt: skip
    wrong = supply_imports.faults(project, supply_imports.imports(supply_imports.sources()))
    base = len(supply_imports.declared(project)[""])
    figures.append(Figure("minimal set", "each base package imported, each import declared",
                          "; ".join(wrong[:3]) or f"{base} base packages", not wrong))  # fmt: skip
    return figures


def licence_faults(page: str, locked: dict[str, set[str]], project: dict[str, object]) -> list[str]:
    """What the list lacks, and what must not be in it, in sentences."""
    known = supply_licences.listed(page)
    wrong = [f"{name} is not listed" for name in sorted(set(locked) - set(known))]
    wrong += [f"{name} is listed and not locked" for name in sorted(set(known) - set(locked))]
    for name, (versions, told, use) in known.items():
        kind = supply_licences.judge(told)
        if name in locked and versions != ", ".join(sorted(locked[name])):
            wrong.append(f"{name} is listed at {versions}, locked at {', '.join(sorted(locked[name]))}")
        if kind == "unknown":
            wrong.append(f"{name}: nobody knows its licence")
        if kind == "strong copyleft" and (use == "running it" or name not in ALLOWED):
            wrong.append(f"{name}: {told}")
    for name in sorted(supply_imports.declared(project)[""] - set(known)):
        wrong.append(f"{name} of the base is not listed")
    return list(dict.fromkeys(wrong))


_SAID = {True: "met    ", False: "NOT MET", None: "open   "}

ALLOWED = {"cvxopt"}
"""Strong copyleft that nobody gets with maglev_ctrl: a second solver, installed by those who ask for it."""


def uses() -> dict[str, str]:
    """For every locked package what it is needed for: running it, or the extras that bring it."""
    needs = supply_lock.needs(supply_lock.LOCK.read_text(encoding="utf-8"))
    groups = supply_imports.declared(supply_lock.project())
    found: dict[str, list[str]] = {}
    for extra in ("", *supply_lock.EXTRAS):
        waiting, seen = list(groups[extra]), set()
        while waiting:
            name = waiting.pop()
            if name not in seen:
                seen.add(name)
                found.setdefault(name, []).append(extra)
                waiting += needs.get(name, ())
    return {name: "running it" if "" in extras else ", ".join(extras) for name, extras in found.items()}


def list_licences(places: list[str]) -> list[Figure]:
    """Write the list into the page."""
    known = supply_licences.installed([Path(sysconfig.get_paths()["purelib"]), *(Path(one) for one in places)])
    locked = supply_lock.names()
    told = uses()
    text = PAGE.read_text(encoding="utf-8")
    before = text[: text.index(LIST[0]) + len(LIST[0])]
    after = text[text.index(LIST[1]) :]
    building = {name: told.get(name, "building it") for name in locked}
    PAGE.write_text(before + supply_licences.table(locked, known, building) + after, encoding="utf-8")
    missing = sorted(set(locked) - set(known))
    return [Figure("list of licences", "every locked package", f"not installed here: {', '.join(missing) or 'none'}",
                   not missing)]  # fmt: skip


def bill(file: Path) -> list[Figure]:
    """The bill of materials of this environment."""
    problem = supply_bom.make_bom(file)
    base = supply_imports.declared(supply_lock.project())[""]
    found = [problem] if problem else supply_bom.bom_faults(file.read_text(encoding="utf-8"), base)
    return [Figure("bill of materials", "CycloneDX 1.6, each base package in it, no place on this machine",
                   "; ".join(found[:3]) or f"{len(base)} base packages and all they need", not found)]  # fmt: skip


def flaws() -> list[Figure]:
    """Known flaws in what is locked; nobody to ask is no answer, and no fault."""
    found = supply_bom.audit(supply_lock.names())
    met = False if found.flawed else True if found.asked and not found.unasked else None
    return [Figure("known flaws", "none", found.words, met)]


def content(made: list[Path]) -> list[Figure]:
    """What is in a wheel and an sdist."""
    figures = []
    for file in made:
        names = supply_smoke.contents(file)
        found = supply_smoke.content_faults(names, wheel=file.suffix == ".whl")
        figures.append(Figure(f"content of {file.name}", "all that is needed, nothing else",
                              "; ".join(found[:3]) or f"{len(names)} files, {file.stat().st_size / 1e6:.1f} MB",
                              not found))  # fmt: skip
    return figures


def tried(commit: str, minors: list[str], files: Path | None) -> list[Figure]:
    """Wheel and sdist, built (or made already) and tried on every Python here."""
    figures: list[Figure] = []
    with tempfile.TemporaryDirectory(prefix="maglev-ctrl-smoke-") as name:
        folder = Path(name)
        source = supply_smoke.clean_source(folder, commit)
        if files is None:
            made, problem = supply_smoke.build(source, folder / "dist")
            told = problem or ", ".join(one.name for one in made)
            figures.append(Figure("build", "a wheel and an sdist", told, not problem))
        else:
            made = sorted(one.resolve() for one in files.iterdir())
        figures += content(made)
        for minor, python in supply_smoke.pythons().items():
            for file in made if not minors or minor in minors else ():
                figures.append(_tried_one(minor, python, file, folder, source))
                print(f"  {figures[-1].what}: {figures[-1].reached}", flush=True)
    return figures


def _tried_one(minor: str, python: str, file: Path, folder: Path, source: Path) -> Figure:
    what = f"Python {minor}, {'wheel' if file.suffix == '.whl' else 'sdist'}"
    asked = "installs and does the first things"
    if not python:
        return Figure(what, asked, "NOT EVALUATED: no such Python here", None)
    start = time.perf_counter()
    with supply_smoke.bare(python, folder, file) as (programs, problem):
        found = [problem] if problem else supply_smoke.smoke(programs, folder, source)
    return Figure(what, asked, "; ".join(found) or f"14 steps in {time.perf_counter() - start:.0f} s", not found)


def main(arguments: list[str]) -> int:
    """Do what was asked for; 0 where every figure is met."""
    parser = argparse.ArgumentParser(description="The supply chain of maglev_ctrl.")
    for flag in ("short", "check", "lock", "audit"):
        parser.add_argument(f"--{flag}", action="store_true")
    parser.add_argument("--licences", nargs="*", metavar="DIR")
    parser.add_argument("--sbom", type=Path, metavar="FILE")
    parser.add_argument("--smoke", nargs="*", metavar="PYTHON")
    parser.add_argument("--files", type=Path, metavar="DIR")
    parser.add_argument("--content", type=Path, metavar="DIR")
    parser.add_argument("--commit", default="HEAD")
    parser.add_argument("--record", type=Path, metavar="FILE")
    asked = parser.parse_args(arguments)
    chosen = asked.check or asked.lock or asked.audit or asked.sbom or asked.content or asked.licences is not None
    all_of_it = not chosen and asked.smoke is None
    start = time.perf_counter()
    figures: list[Figure] = []
    steps = [
        (asked.lock, lambda: [_renewed()]),
        (asked.licences is not None, lambda: list_licences(asked.licences)),
        (asked.check or all_of_it, check),
        (asked.sbom or all_of_it, lambda: bill(asked.sbom or ROOT / "out" / "sbom.json")),
        (asked.audit or all_of_it, flaws),
        (asked.content, lambda: content(sorted(asked.content.iterdir()))),
        (
            asked.smoke is not None or (all_of_it and not asked.short),
            lambda: tried(asked.commit, asked.smoke or [], asked.files),
        ),
    ]
    for wanted, step in steps:
        if wanted:
            for one in step():
                figures.append(one)
                print(f"{_SAID[one.met]} {one.what}: {one.reached}", flush=True)
    if asked.record is not None:
        told = {
            "part": "supply", "title": "Supply chain", "seconds": round(time.perf_counter() - start, 1),
            "figures": [asdict(one) for one in figures if one.met is not None],
            "notes": [f"{one.what}: {one.reached}." for one in figures if one.met is None],
        }  # fmt: skip
        asked.record.parent.mkdir(parents=True, exist_ok=True)
        asked.record.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
    return 1 if any(one.met is False for one in figures) else 0


def _renewed() -> Figure:
    problem = supply_lock.renew()
    return Figure(
        "lock file made anew", "by uv, for all systems", problem or str(len(supply_lock.names())), not problem
    )


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except KeyboardInterrupt:
        print("interrupted; what was made is removed", file=sys.stderr)
        sys.exit(130)
