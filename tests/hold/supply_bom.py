"""The bill of materials of this environment, and the question whether known flaws are in what is locked."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from packaging.utils import canonicalize_name

CANARY = "jinja2==3.1.2"
"""It has had published flaws since 2024: a service that does not name them was not asked, whatever it answers."""
_PLACES = re.compile(r"file://|/(?:home|root|work|tmp|Users)/|[A-Za-z]:\\\\")
_ADDRESS = re.compile(r'(?:[a-zA-Z][a-zA-Z0-9+.-]*:)?[^\s<>"{}|\\^`]*')


def make_bom(file: Path) -> str:
    """Write the CycloneDX bill of this environment; a problem in words, or ''."""
    file.parent.mkdir(parents=True, exist_ok=True)
    root = Path(__file__).resolve().parents[2]
    command = [
        sys.executable, "-m", "cyclonedx_py", "environment", "--pyproject", str(root / "pyproject.toml"), "--of",
        "JSON",
        "--sv", "1.6", "--output-reproducible", "--no-validate", "-o", str(file), sys.executable,
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        return done.stderr.strip().splitlines()[-1] if done.stderr.strip() else f"exit status {done.returncode}"
    told = json.loads(file.read_text(encoding="utf-8"))
    file.write_text(json.dumps(without_places(told), indent=1, sort_keys=True) + "\n", encoding="utf-8")
    return ""


def without_places(told: Any) -> Any:
    """The bill without the folder of this checkout, which an editable installation writes into it."""
    if isinstance(told, dict):
        kept = {key: without_places(value) for key, value in told.items()}
        for key in ("externalReferences",):
            if key in kept:
                kept[key] = [one for one in kept[key] if not _PLACES.search(json.dumps(one))]
        return kept
    return [without_places(one) for one in told] if isinstance(told, list) else told


def bom_faults(text: str, needed: set[str]) -> list[str]:
    """What a bill lacks or tells too much of, in sentences."""
    try:
        told = json.loads(text)
        found = {canonicalize_name(one["name"]): one for one in told["components"]}
    except (ValueError, KeyError, TypeError) as error:
        return [f"no bill of materials: {error}"]
    wrong = schema_faults(text)
    if told.get("bomFormat") != "CycloneDX" or told.get("specVersion") != "1.6":
        wrong.append("not CycloneDX 1.6")
    if told.get("metadata", {}).get("component", {}).get("name") != "maglev-ctrl":
        wrong.append("it is of another thing than maglev-ctrl")
    for name in sorted(needed):
        if name not in found:
            wrong.append(f"{name} is missing")
        elif not found[name].get("version") or not str(found[name].get("purl", "")).startswith("pkg:pypi/"):
            wrong.append(f"{name} has no version or no address")
    wrong += [f"it names a place on this machine: {one}" for one in sorted({m[0] for m in _PLACES.finditer(text)})]
    return wrong


def schema_faults(text: str) -> list[str]:
    """Where a bill does not obey the schema of CycloneDX 1.6, without unknown keys.

    Addresses are compared with a pattern: the library's grammar for them takes a second for five.
    """
    from cyclonedx.schema import SchemaVersion
    from cyclonedx.validation.json import JsonStrictValidator
    from jsonschema import FormatChecker

    slow = JsonStrictValidator(SchemaVersion.V1_6)._validator
    checker = FormatChecker(formats=[one for one in slow.format_checker.checkers if not one.startswith(("iri", "idn"))])
    checker.checks("iri-reference")(lambda value: not isinstance(value, str) or bool(_ADDRESS.fullmatch(value)))
    quick = type(slow)(slow.schema, registry=slow._registry, format_checker=checker)
    return [f"{one.json_path}: {one.message[:120]}" for one in quick.iter_errors(json.loads(text))]


@dataclass(frozen=True, slots=True)
class Audit:
    """What was asked about, what is known to be flawed, and why the rest was not asked."""

    asked: int
    unasked: tuple[str, ...]
    flawed: tuple[str, ...]
    reason: str = ""

    @property
    def words(self) -> str:
        """One sentence, which speaks of no package that was not asked about."""
        if self.flawed:
            return f"FLAWED: {'; '.join(self.flawed)}"
        if not self.asked:
            return f"SKIPPED: {self.reason}; nothing is known about any package"
        if self.unasked:
            few = ", ".join(self.unasked[:5])
            return f"PARTLY: no known flaw in {self.asked} packages; {len(self.unasked)} were not asked about: {few}"
        return f"no known flaw in {self.asked} packages"


def read_answer(text: str) -> Audit:
    """What pip-audit said; a package it passed over was not asked about."""
    told = json.loads(text)["dependencies"]
    asked = [one for one in told if "vulns" in one]
    flawed = [
        f"{one['name']} {one['version']}: {', '.join(flaw['id'] for flaw in one['vulns'])}"
        for one in asked if one["vulns"]
    ]  # fmt: skip
    return Audit(len(asked), tuple(one["name"] for one in told if "vulns" not in one), tuple(flawed))


def ask(requirements: list[str], service: str, *, seconds: float) -> Audit:
    """Ask a service about some pins; nothing asked and a reason where it cannot be reached."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "pins.txt"
        file.write_text("\n".join(requirements) + "\n", encoding="utf-8")
        command = [
            sys.executable, "-m", "pip_audit", "-r", str(file), "--no-deps", "--disable-pip", "-s", service, "-f",
            "json", "--progress-spinner", "off", "--timeout", "5", "--desc", "off",
        ]  # fmt: skip
        try:
            done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=seconds)
        except subprocess.TimeoutExpired:
            return Audit(0, (), (), f"{service} gave no answer in {seconds:g} s")
        except OSError as error:
            return Audit(0, (), (), f"pip-audit does not start: {error}")
    try:
        return read_answer(done.stdout)
    except (ValueError, KeyError, TypeError):
        lines = [line for line in done.stderr.splitlines() if line.strip()]
        return Audit(0, (), (), f"{service}: {lines[-1][:160]}" if lines else f"{service} gave no answer")


def audit(locked: dict[str, set[str]], *, asking: Any = ask) -> Audit:
    """Ask about every locked version, at the first service that knows the canary."""
    reasons = []
    for service in ("pypi", "osv"):
        canary = asking([CANARY], service, seconds=30.0)
        if not canary.flawed:
            reasons.append(canary.reason or f"{service} does not know a flaw of {CANARY} that is published")
            continue
        rounds: list[Audit] = []
        left = {name: sorted(versions) for name, versions in locked.items()}
        while any(left.values()):  # a requirements file has room for one version of each
            pins = [f"{name}=={versions.pop()}" for name, versions in left.items() if versions]
            rounds.append(asking(pins, service, seconds=600.0))
            if rounds[-1].reason:
                return Audit(0, (), tuple(one for found in rounds for one in found.flawed), rounds[-1].reason)
        return Audit(
            sum(one.asked for one in rounds), tuple(name for one in rounds for name in one.unasked),
            tuple(one for found in rounds for one in found.flawed),
        )  # fmt: skip
    return Audit(0, (), (), "; ".join(reasons))
