"""Scenarios the page offers: those shipped, those of the folder it was started in, and texts people bring."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from maglev_ctrl.scenario import Scenario
from maglev_ctrl.scenario.limits import SIZE_LIMIT
from maglev_ctrl.scenario.problems import Problem, ScenarioProblems
from maglev_ctrl.scenario.reader import load_text

UPLOADED = ""
"""Key of a text that belongs to no file the page offers: it can name no data files."""
_HERE_LIMIT = 200
_SAFE = re.compile(r"[^\w.-]+")


@dataclass(frozen=True, slots=True)
class Source:
    """A scenario file the page offers: its `key` in the address, and the group it is listed in."""

    key: str
    group: str
    path: Path


@dataclass(frozen=True, slots=True)
class Sources:
    """Every scenario file the page offers, and the empty folder that stands for uploaded ones."""

    listed: tuple[Source, ...]
    empty_folder: Path
    words: str  # what a reader of the list has to know; "" mostly

    @property
    def first(self) -> Source | None:
        """What the page begins with."""
        return self.listed[0] if self.listed else None

    def find(self, key: str) -> Source | None:
        """The source of a key."""
        return next((one for one in self.listed if one.key == key), None)

    def text(self, key: str) -> str:
        """The text of a file as it is now.

        Raises
        ------
        ScenarioProblems : it cannot be read as text of at most 1 MiB
        """
        source = self.find(key)
        if source is None:
            raise ScenarioProblems(key, [Problem(0, 0, "", "the page offers no scenario of this name")])
        try:
            with source.path.open("rb") as stream:
                return stream.read(SIZE_LIMIT + 1).decode("utf-8-sig")
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or "expected UTF-8 text"
            raise ScenarioProblems(source.path.name, [Problem(0, 0, "", f"cannot be read: {reason}")]) from None

    def place(self, key: str, name: str) -> Path:
        """Where a text counts as a file: in its source's folder, or in the empty one, whose name shows nothing."""
        source = self.find(key)
        return (self.empty_folder if source is None else source.path.parent) / f"{file_stem(name)}.toml"

    def read(self, text: str, *, key: str, name: str) -> Scenario:
        """The scenario of a text.

        Raises
        ------
        ScenarioProblems : every fault with its line and column
        """
        return load_text(text, self.place(key, name))


def file_stem(name: str) -> str:
    """A name that is safe as a file's and in an address.

    Examples
    --------
    >>> file_stem("../../etc/pass wd.toml"), file_stem(".toml"), file_stem("paper/double_l")
    ('pass_wd', 'scenario', 'double_l')
    """
    last = re.split(r"[\\/]", name)[-1].removesuffix(".toml")
    return _SAFE.sub("_", last).strip("._")[:60] or "scenario"


def find_sources(given: Path | None, *, shipped: Path | None, here: Path, empty_folder: Path) -> Sources:
    """What the page offers: the file it was started with first.

    Parameters
    ----------
    shipped : folder of the shipped scenarios; None where the package is installed without them
    here : folder whose own scenario files are offered too
    """
    found: dict[Path, Source] = {}
    if given is not None:
        found[given.resolve()] = Source(f"file/{file_stem(given.name)}", "Started with", given)
    if shipped is not None:
        for path in sorted(shipped.rglob("*.toml")):
            group = path.parent.relative_to(shipped).as_posix()
            key = path.relative_to(shipped).with_suffix("").as_posix()
            found.setdefault(path.resolve(), Source(key, f"Shipped: {group}", path))
    for path in sorted(here.glob("*.toml"))[:_HERE_LIMIT]:
        if path.name != "pyproject.toml" and _is_scenario(path):
            found.setdefault(path.resolve(), Source(f"here/{path.stem}", "In this folder", path))
    words = "" if shipped is not None else "The example scenarios are not installed with the package; upload a file."
    return Sources(_preferred(found.values()), empty_folder, words)


def _preferred(found: Iterable[Source]) -> tuple[Source, ...]:
    """A file given comes first; else the shipped one that shows most at once."""
    order = {"Started with": 0, "Shipped: periodic": 1, "In this folder": 3}
    return tuple(sorted(found, key=lambda one: order.get(one.group, 2)))


def _is_scenario(path: Path) -> bool:
    """Whether a TOML file says it is a scenario; other tools keep theirs in the same folder."""
    try:
        with path.open("rb") as stream:
            return re.search(rb"^format\s*=", stream.read(SIZE_LIMIT), re.MULTILINE) is not None
    except OSError:
        return False


def shipped_folder() -> Path | None:
    """The repository's scenarios beside the package; None where only the package is installed."""
    folder = Path(__file__).resolve().parents[2] / "scenarios"
    return folder if (folder / "paper").is_dir() else None
