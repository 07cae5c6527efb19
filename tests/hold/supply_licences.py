"""Licences of everything that is locked: read from the packages' metadata, listed, judged."""

from __future__ import annotations

import importlib.metadata
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

from packaging.utils import canonicalize_name

PERMISSIVE = frozenset({
    "0BSD", "Apache-2.0", "BSD-2-Clause", "BSD-3-Clause", "BSD", "BSL-1.0", "CC0-1.0", "HPND", "ISC", "MIT", "MIT-0",
    "MIT-CMU", "PSF-2.0", "Python-2.0", "Unlicense", "Zlib", "bzip2-1.0.6", "CNRI-Python", "LicenseRef-MATPLOTLIB",
    "LicenseRef-PUBLIC-DOMAIN", "NCSA", "Apache-2.0 WITH LLVM-exception",
})  # fmt: skip
WEAK = frozenset({"MPL-2.0", "LGPL-2.1-or-later", "LGPL-3.0-or-later", "LGPL-3.0-only"})
"""Weak copyleft: used unchanged and not passed on in our files."""
RUNTIME_EXCEPTIONS = frozenset({"GPL-3.0-or-later WITH GCC-exception-3.1", "LGPL-2.1-or-later"})
STRONG = re.compile(r"\bA?GPL-\d")

_CLASSIFIERS = {
    "MIT License": "MIT", "BSD License": "BSD", "Apache Software License": "Apache-2.0",
    "ISC License (ISCL)": "ISC", "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
    "Python Software Foundation License": "PSF-2.0", "Public Domain": "LicenseRef-PUBLIC-DOMAIN",
    "GNU General Public License (GPL)": "GPL-3.0-or-later",
    "GNU General Public License v3 (GPLv3)": "GPL-3.0-only",
}  # fmt: skip
_WORDS = {
    "apache 2.0": "Apache-2.0", "apache license": "Apache-2.0", "apache-2.0": "Apache-2.0", "bsd": "BSD",
    "bsd-2-clause": "BSD-2-Clause", "bsd 2-clause license": "BSD-2-Clause", "bsd-3-clause": "BSD-3-Clause",
    "bsd 3-clause license": "BSD-3-Clause", "isc license": "ISC", "mit": "MIT", "mit license": "MIT",
    "mpl-2.0": "MPL-2.0", "psfl": "PSF-2.0",
}  # fmt: skip
READ = {
    # What the metadata does not say, or says wrongly; read in the licence files of the packages.
    "atheris": "Apache-2.0", "cvxopt": "GPL-3.0-or-later", "docutils": "LicenseRef-PUBLIC-DOMAIN AND BSD-2-Clause",
    "graphemeu": "MIT", "matplotlib": "LicenseRef-MATPLOTLIB", "axe-playwright-python": "MIT",
}  # fmt: skip


def licence(metadata: importlib.metadata.PackageMetadata) -> str:
    """The licence of a package as an SPDX expression; "UNKNOWN" where its metadata say nothing that is understood."""
    name = canonicalize_name(metadata["Name"])
    if name in READ:
        return READ[name]
    told = metadata.get("License-Expression")
    if told:
        return str(told)
    lines = (metadata.get("License") or "").strip().splitlines()
    if len(lines) == 1 and lines[0].strip().lower() in _WORDS:
        return _WORDS[lines[0].strip().lower()]
    if len(lines) == 1 and re.fullmatch(r"[A-Za-z0-9.-]+(?: (?:AND|OR) [A-Za-z0-9.-]+)+", lines[0].strip()):
        return lines[0].strip()
    ends = [one.rpartition(" :: ")[2] for one in metadata.get_all("Classifier", []) if one.startswith("License ::")]
    known = sorted({_CLASSIFIERS[one] for one in ends if one in _CLASSIFIERS})
    return " OR ".join(known) if known and len(known) == len(set(ends)) else "UNKNOWN"


def judge(expression: str) -> str:
    """`permissive`, `weak copyleft`, `strong copyleft` or `unknown`; of an `OR` the mildest, of an `AND` the strictest.

    Compiled files carry the runtime libraries of the compiler, whose licence has an exception for just that.
    """
    order = ("permissive", "weak copyleft", "strong copyleft", "unknown")
    expression = expression.strip()
    if expression.startswith("(") and _closes(expression):
        expression = expression[1:-1]
    for word, pick in (("OR", min), ("AND", max)):
        parts = _split(expression, word)
        if len(parts) > 1:
            return order[pick(order.index(judge(part)) for part in parts)]
    if expression in PERMISSIVE:
        return "permissive"
    if expression in WEAK or expression in RUNTIME_EXCEPTIONS:
        return "weak copyleft"
    return "strong copyleft" if STRONG.search(expression) else "unknown"


def _closes(text: str) -> bool:
    depth = 0
    for at, sign in enumerate(text):
        depth += (sign == "(") - (sign == ")")
        if depth == 0:
            return at == len(text) - 1
    return False


def _split(text: str, word: str) -> list[str]:
    parts, depth, start = [], 0, 0
    for found in re.finditer(rf"[()]|\b{word}\b", text):
        if found[0] == word:
            if depth == 0:
                parts.append(text[start : found.start()])
                start = found.end()
        else:
            depth += 1 if found[0] == "(" else -1
    return [*parts, text[start:]]


def installed(places: Iterable[Path]) -> dict[str, str]:
    """Licence by name of all packages of some environments, and of wheels in folders."""
    found: dict[str, str] = {}
    for place in places:
        paths = [str(place), *(str(wheel) for wheel in sorted(place.glob("*.whl")))]
        for one in importlib.metadata.distributions(path=paths):
            found.setdefault(canonicalize_name(one.metadata["Name"]), licence(one.metadata))
    return found


def table(locked: Mapping[str, set[str]], known: Mapping[str, str], uses: Mapping[str, str]) -> str:
    """The list as Markdown."""
    lines = ["| Package | Locked | Licence | Kind | Needed for |", "|---|---|---|---|---|"]
    for name in sorted(locked):
        said = known.get(name, "UNKNOWN")
        versions = ", ".join(sorted(locked[name]))
        lines.append(f"| {name} | {versions} | {said} | {judge(said)} | {uses.get(name, '')} |")
    return "\n".join(lines)


def listed(page: str) -> dict[str, tuple[str, str, str]]:
    """Versions, licence and use by name, out of the page's list."""
    found = {}
    for line in page.splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if len(cells) == 5 and re.fullmatch(r"[a-z0-9-]+", cells[0]) and cells[3] == judge(cells[2]):
            found[cells[0]] = (cells[1], cells[2], cells[4])
    return found
