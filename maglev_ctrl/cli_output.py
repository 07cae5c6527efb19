"""In what manner a command answers: tables or one JSON document, quietly or with all it does."""

from __future__ import annotations

import json
import math
import re
import sys
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import typer

FORMAT: Final = 1
_TEXTS: Final = {"title", "name", "label", "description", "message", "option", "scenario", "file"}
"""Keys of texts that people write: one of them may really be called NaN."""
_PLACE: Final = re.compile(
    r"(?P<file>[^\n]+?):(?P<line>\d+):(?P<column>\d+): (?:(?P<key>[\w.\[\]-]+): )?(?P<message>.*)"
)


@dataclass(frozen=True, slots=True)
class Manner:
    """How a command was asked to answer; `--quiet` and `--verbose` exclude each other."""

    as_json: bool = False
    quiet: bool = False
    verbose: bool = False

    def __or__(self, other: Manner) -> Manner:
        """What was asked before the verb and after it, together."""
        return Manner(self.as_json or other.as_json, self.quiet or other.quiet, self.verbose or other.verbose)


@dataclass(eq=False, slots=True)
class _Talk:
    """What one command line has said so far; the one record here that grows."""

    manner: Manner
    verb: str = ""
    body: dict[str, Any] = field(default_factory=dict)
    whole: bool = False
    written: list[str] = field(default_factory=list)
    error: dict[str, Any] | None = None


_TALK: ContextVar[_Talk | None] = ContextVar("maglev_ctrl_talk", default=None)


def manner() -> Manner:
    """How the running command was asked to answer.

    Examples
    --------
    >>> manner()
    Manner(as_json=False, quiet=False, verbose=False)
    """
    talk = _TALK.get()
    return Manner() if talk is None else talk.manner


@contextmanager
def conversation(asked: Manner) -> Iterator[None]:
    """One command line from its words to its exit status; what is answered inside belongs to it.

    Examples
    --------
    >>> with conversation(Manner(as_json=True)):
    ...     answer({"gap": float("nan")})
    ...     finish(0)
    {"format": 1, "kind": "maglev-ctrl", "verb": "", "status": 0, "gap": null}
    """
    token = _TALK.set(_Talk(asked))
    try:
        yield
    finally:
        _TALK.reset(token)


def adopt(asked: Manner) -> None:
    """What was asked before the verb.

    Raises
    ------
    typer.BadParameter : quiet and verbose at once
    """
    talk = _TALK.get()
    if talk is None:
        return
    talk.manner |= asked
    if talk.manner.quiet and talk.manner.verbose:
        raise typer.BadParameter("--quiet and --verbose exclude each other")


@contextmanager
def answering(verb: str, asked: Manner) -> Iterator[None]:
    """One verb at work: with --json whatever its libraries print goes to the error stream, with --verbose it is timed.

    Raises
    ------
    typer.BadParameter : quiet and verbose at once
    """
    talk = _TALK.get()
    if talk is None:  # a verb called as a function
        with conversation(asked), answering(verb, asked):
            yield
        return
    talk.verb = verb
    adopt(asked)
    start = time.perf_counter()
    with _messages_of_libraries(talk.manner.verbose):
        if talk.manner.verbose:
            _tell_versions()
        try:
            if talk.manner.as_json:
                with redirect_stdout(sys.stderr):
                    yield
            else:
                yield
        finally:
            if talk.manner.verbose:
                typer.echo(f"{verb} took {time.perf_counter() - start:.2f} s", err=True)
                _tell_cache(always=verb == "version")


def say(text: str) -> None:
    """A line of the result; with --json the document says it."""
    if not manner().as_json:
        typer.echo(text)


def say_quietly(text: str) -> None:
    """A line that stands for tables which --quiet leaves out."""
    if manner().quiet:
        say(text)


def say_written(paths: Iterable[Path]) -> None:
    """Files that were written, as lines or in the document."""
    talk = _TALK.get()
    for path in paths:
        if talk is not None:
            talk.written.append(str(path))
        say(f"written: {path}")


def answer(body: Mapping[str, Any], *, whole: bool = False) -> None:
    """What --json answers; later calls add keys.

    Parameters
    ----------
    whole : the document is `body` itself, such as a JSON Schema, with nothing added
    """
    talk = _TALK.get()
    if talk is not None:
        talk.body.update(body)
        talk.whole = whole


def complain(error: BaseException | str) -> None:
    """A fault: its sentence on the error stream, and the error of the document."""
    text = str(error)
    talk = _TALK.get()
    if talk is not None:
        found = faults(error)
        first = found[0]
        talk.error = {**first, "message": text if len(found) > 1 else first["message"], "faults": found}
    if text:
        typer.echo(text, err=True)


def faults(error: BaseException | str) -> list[dict[str, Any]]:
    """Each fault with file, line, column (from 1), key and message; what is not known is None.

    Examples
    --------
    >>> faults("eds.toml:3:8: vehicle.car.mass: expected a mass")[0]["key"]
    'vehicle.car.mass'
    """
    problems = getattr(error, "problems", ())
    if problems:
        file = getattr(error, "file", None)
        return [
            _fault(one.message, one.file or file, one.line or None, one.column or None, one.key) for one in problems
        ]
    found = []
    for line in str(error).splitlines() or [""]:
        place = _PLACE.fullmatch(line)
        if place is None:
            found.append(_fault(line, None, None, None, None))
        else:
            found.append(
                _fault(place["message"], place["file"], int(place["line"]), int(place["column"]), place["key"])
            )  # fmt: skip
    if len(found) > 1 and any(one["file"] is None for one in found):
        return [_fault(str(error), None, None, None, None)]  # one message of several lines
    return found


def _fault(message: str, file: str | None, line: int | None, column: int | None, key: str | None) -> dict[str, Any]:
    return {"message": message, "file": file or None, "line": line, "column": column, "key": key or None}


def finish(status: int) -> None:
    """The end of a command line: with --json its one document."""
    talk = _TALK.get()
    if talk is None or not talk.manner.as_json:
        return
    head = {"format": FORMAT, "kind": f"maglev-ctrl {talk.verb}".rstrip(), "verb": talk.verb, "status": status}
    if talk.error is not None:
        typer.echo(json_text({**head, "kind": "maglev-ctrl error", "error": talk.error, **talk.body}))
    elif talk.whole:
        typer.echo(json_text(talk.body))
    else:
        written = {"written": talk.written} if talk.written else {}
        typer.echo(json_text({**head, **talk.body, **written}))


def json_text(value: Any) -> str:
    """Strict JSON: not-a-number is null; infinities are the strings "Infinity" and "-Infinity", as in every report.

    Examples
    --------
    >>> json_text({"value": float("nan"), "limit": float("inf"), "margin": {"value": "NaN", "unit": "dB"}})
    '{"value": null, "limit": "Infinity", "margin": {"value": null, "unit": "dB"}}'
    """
    return json.dumps(_strict(value, ""), ensure_ascii=False, allow_nan=False)


def _strict(value: Any, key: str) -> Any:
    if isinstance(value, Mapping):
        return {str(name): _strict(entry, str(name)) for name, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_strict(entry, key) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else ("Infinity" if value > 0.0 else "-Infinity")
    return None if value == "NaN" and key not in _TEXTS else value


def _tell_versions() -> None:
    """Versions of what computes."""
    import platform
    from importlib import metadata

    from maglev_ctrl import __version__

    libraries = ", ".join(f"{name} {metadata.version(name)}" for name in ("numpy", "scipy", "cvxpy", "clarabel"))
    system = f"{platform.system()} {platform.machine()}"
    typer.echo(f"maglev-ctrl {__version__}, Python {platform.python_version()}, {system}, {libraries}", err=True)


def _tell_cache(*, always: bool) -> None:
    """Where solved forces are kept; loading what knows takes seconds, so only after verbs that loaded it."""
    if always or "maglev_ctrl.study.force_cache" in sys.modules:
        from maglev_ctrl.study.force_cache import cache_folder

        typer.echo(f"solved forces are kept in {cache_folder()}", err=True)


@contextmanager
def _messages_of_libraries(shown: bool) -> Iterator[None]:
    """Every warning and note of the libraries on the error stream while a verb runs, where they are asked for."""
    if not shown:
        yield
        return
    import logging
    import warnings

    listener = logging.StreamHandler(sys.stderr)
    listener.setFormatter(logging.Formatter("%(name)s: %(message)s"))
    root = logging.getLogger()
    level = root.level
    root.addHandler(listener)
    root.setLevel(logging.INFO)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("always")
            yield
    finally:
        root.removeHandler(listener)
        root.setLevel(level)
