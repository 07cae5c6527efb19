"""The lock file: read, checked against pyproject.toml, and made anew."""

from __future__ import annotations

import re
import subprocess
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from packaging.markers import Marker, default_environment
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

ROOT = Path(__file__).resolve().parents[2]
LOCK = ROOT / "requirements.lock"
EXTRAS = ("test", "docs", "ui", "dist", "supply", "fast", "crosscheck")
"""What is locked beside the base; `gpu` and `hold` are for one kind of machine each and stay outside."""
BUILD = ("editables>=0.5",)
"""What an editable installation needs beside the build system that pyproject.toml names."""
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
HEAD = """\
# Every package of maglev_ctrl and of the work on it, for Linux, macOS and Windows and for Python 3.11 to 3.14: exact
# versions, and the SHA-256 of every file that may be installed. Not in it: the extras gpu and hold.
#
# Install exactly this:  python3 dev.py setup --locked
# Make it anew:          python tests/hold/supply.py --lock     (needs uv and the package index; then read the change)
# Check it:              python tests/hold/supply.py --check
"""
_PIN = re.compile(
    r"(?P<name>[a-z0-9]+(?:-[a-z0-9]+)*)==(?P<version>[^\s;\\]+)(?: ; (?P<marker>[^\\\n]+?))?"
    r"(?P<hashes>(?: \\\n    --hash=sha256:[0-9a-f]{64})+)\n"
    r"(?:    # via [^\n]*\n|    # via\n(?:    #   [^\n]*\n)+)?"
)


@dataclass(frozen=True, slots=True)
class Pin:
    """One package at one version, where its marker holds."""

    name: str
    version: str
    marker: str
    hashes: tuple[str, ...]

    def holds(self, python: str, platform: str) -> bool:
        """Whether it is installed on a Python such as "3.12" and a platform such as "linux"."""
        return not self.marker or Marker(self.marker).evaluate(environment(python, platform))


def environment(python: str, platform: str) -> dict[str, str]:
    """What markers ask, for a machine that is not this one."""
    system = {"linux": ("posix", "Linux"), "darwin": ("posix", "Darwin"), "win32": ("nt", "Windows")}[platform]
    return {
        **{name: str(value) for name, value in default_environment().items()}, "python_version": python,
        "python_full_version": f"{python}.9", "sys_platform": platform, "os_name": system[0],
        "platform_system": system[1], "implementation_name": "cpython", "platform_python_implementation": "CPython",
        "extra": "",
    }  # fmt: skip


def read(text: str) -> tuple[list[Pin], list[str]]:
    """The pins of a lock file, and the lines that are none."""
    pins, strange, at = [], [], 0
    while at < len(text):
        found = _PIN.match(text, at)
        if found is not None:
            hashes = tuple(re.findall(r"sha256:([0-9a-f]{64})", found["hashes"]))
            pins.append(Pin(found["name"], found["version"], found["marker"] or "", hashes))
            at = found.end()
            continue
        end = text.find("\n", at) + 1 or len(text)
        line = text[at:end]
        if not line.startswith("#"):
            strange.append(f"line {text.count(chr(10), 0, at) + 1}: {line.strip()!r}")
        at = end
    return pins, strange


def wanted(project: dict[str, Any]) -> list[Requirement]:
    """Every direct requirement that the lock has to meet."""
    told = project["project"]
    lines = [*told["dependencies"], *project["build-system"]["requires"], *BUILD]
    for extra in EXTRAS:
        lines += told["optional-dependencies"][extra]
    return [Requirement(line) for line in lines]


def faults(text: str, project: dict[str, Any]) -> list[str]:
    """Why a lock file does not belong to a project, in sentences; none where it does."""
    pins, strange = read(text)
    found = [f"{line} is no pinned package with hashes" for line in strange]
    for line in text.splitlines():
        for word in ("file://", "http://", "https://", "--index-url", "--find-links", "--extra-index-url", " @ "):
            if word in line:
                found.append(f"{line.strip()!r} names a place")
    for pin in pins:
        if len(set(pin.hashes)) != len(pin.hashes):
            found.append(f"{pin.name}: a hash twice")
    for python in PYTHONS:
        for platform in ("linux", "darwin", "win32"):
            found += _faults_on(pins, project, python, platform)
    return list(dict.fromkeys(found))


def _faults_on(pins: list[Pin], project: dict[str, Any], python: str, platform: str) -> list[str]:
    here = f"Python {python} on {platform}"
    installed: dict[str, str] = {}
    found = []
    for pin in pins:
        if not pin.holds(python, platform):
            continue
        if pin.name in installed:
            found.append(f"{pin.name}: two versions on {here}")
        installed[pin.name] = pin.version
    for one in wanted(project):
        if one.marker is not None and not one.marker.evaluate(environment(python, platform)):
            continue
        version = installed.get(canonicalize_name(one.name))
        if version is None:
            found.append(f"{one.name}: not locked on {here}")
        elif not one.specifier.contains(Version(version), prereleases=True):
            found.append(f"{one.name}: locked at {version}, asked for {one.specifier}")
    return found


def project() -> dict[str, Any]:
    """pyproject.toml."""
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def names() -> dict[str, set[str]]:
    """Every locked name with its versions."""
    found: dict[str, set[str]] = {}
    for pin in read(LOCK.read_text(encoding="utf-8"))[0]:
        found.setdefault(pin.name, set()).add(pin.version)
    return found


def needs(text: str) -> dict[str, set[str]]:
    """The packages that each package brings, as the lock file tells it."""
    found: dict[str, set[str]] = {}
    child = ""
    for line in text.splitlines():
        named = re.match(r"([a-z0-9-]+)==", line)
        if named:
            child = named[1]
        via = re.fullmatch(r"    #(?: via)? +([a-z0-9-]+)(?: .*)?", line)
        if via and child and via[1] != "via":
            found.setdefault(via[1], set()).add(child)
    return found


def renew() -> str:
    """Make the lock anew; a problem in words, or ''."""
    told = project()
    command = [
        "uv", "pip", "compile", "--universal", "--generate-hashes", "--python-version", PYTHONS[0], "--no-header",
        "--no-emit-index-url", "--no-emit-find-links", "--upgrade", "--quiet",
        *(word for extra in EXTRAS for word in ("--extra", extra)), "pyproject.toml", "-",
    ]  # fmt: skip
    extra = "\n".join([*told["build-system"]["requires"], *BUILD]) + "\n"
    try:
        done = subprocess.run(command, cwd=ROOT, input=extra, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return "uv is not on PATH"
    if done.returncode != 0:
        return done.stderr.strip()
    found = faults(HEAD + done.stdout, told)
    if found:
        return "; ".join(found[:5])
    LOCK.write_text(HEAD + done.stdout, encoding="utf-8", newline="\n")
    return ""
