"""The reader of each kind of file as the command line uses it; all but a result or the project's own error is told."""

from __future__ import annotations

import io
import re
import traceback
import zlib
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

from fuzz_seeds import TABLE_SCENARIO, report_document

from maglev_ctrl import cli_diff
from maglev_ctrl.cli import main
from maglev_ctrl.errors import MaglevError, ScenarioError
from maglev_ctrl.report.design.exports import TARGETS, export_design
from maglev_ctrl.report.difference import difference, difference_plain
from maglev_ctrl.report.identification_values import Result, frequency_rows, to_json
from maglev_ctrl.report.reading import read_report, report_of
from maglev_ctrl.scenario import load
from maglev_ctrl.scenario.force_table import read_force_table
from maglev_ctrl.scenario.oscillation import read_oscillations
from maglev_ctrl.scenario.oscillation_table import read_oscillation_table
from maglev_ctrl.scenario.reader import load_text
from maglev_ctrl.scenario.tunes import tuned_quantities
from maglev_ctrl.study.design.document import changed_since, load_designs, pick, prove_again

LONGEST = 20_000
"""Letters of the longest message."""
WHOLE = 128
"""One input in so many goes through the whole command line."""
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")
_NAMES = {
    "scenario": "case.toml",
    "csv": "table.csv",
    "certificate": "design.json",
    "design": "design.json",
    "report": "report.json",
}
_VERBS = {
    "scenario": ("check", "{}"), "csv": ("identify", "{}"), "certificate": ("verify", "{}"), "design": ("verify", "{}"),
    "report": ("diff", "{}", "before.json"),
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Finding:
    """What must not happen: in words, and where in the project."""

    what: str
    place: str
    details: str


class Held(type(Path())):  # type: ignore[misc]
    """A path whose file is held in memory: opening one on the disk takes longer than reading it."""

    content = b""

    def open(self, *how: object, **more: object) -> io.BytesIO:  # type: ignore[override]
        return io.BytesIO(self.content)

    def is_file(self) -> bool:
        return True

    def is_dir(self) -> bool:
        return False


class Target:
    """One kind's reader in a folder of its own; `outcomes` counts results and refusals."""

    def __init__(self, kind: str, folder: Path) -> None:
        self.kind, self.folder = kind, folder
        self.file = folder / _NAMES[kind]
        self.outcomes = {"read": 0, "refused": 0}
        self._reader: Callable[[], None] = getattr(self, f"_{kind}")
        self._content = b""
        (folder / "table.toml").write_text(TABLE_SCENARIO)
        import json

        (folder / "before.json").write_text(json.dumps(report_document()))
        self._before = report_of(report_document())

    def __call__(self, content: bytes) -> Finding | None:
        """What is wrong with how one input is read; None: nothing."""
        self._content = content
        whole = zlib.crc32(content) % WHOLE == 0
        try:
            if self.kind == "certificate":
                content = b'{"format": "maglev_ctrl designs 1", "designs": [' + content + b"]}"
            if whole or zlib.crc32(content) % 16 == 3 or self.kind == "csv":
                self.file = Path(self.file)
                if self.kind != "csv":
                    self.file.write_bytes(content)
            else:
                self.file = Held(self.file)
                self.file.content = content
            if whole and self.kind == "csv":
                self.file.write_bytes(content)
            return self._command() if whole else self._read()
        except Exception as error:
            return Finding(f"{type(error).__name__}: {str(error)[:200]}", _place(error), traceback.format_exc()[-3000:])

    def _read(self) -> Finding | None:
        try:
            self._reader()
        except (MaglevError, OSError) as error:  # what the command line answers with a sentence
            self.outcomes["refused"] += 1
            return _told(str(error), error)
        self.outcomes["read"] += 1
        return None

    def _scenario(self) -> None:
        scenario = load(self.file)
        if zlib.crc32(self._content) % 4 == 0:
            scenario = load_text(scenario.text, self.file)
        for option in scenario.options:
            tuned_quantities(scenario, option)

    def _csv(self) -> None:
        fault: Exception | None = None
        try:
            read_force_table(self._content, shown=str(self.file))
            self.file.write_bytes(self._content)
            load(self.folder / "table.toml")
        except ScenarioError as error:
            fault = error
            found = _told(str(error), error)
            if found is not None:
                raise AssertionError(found.what) from error
        try:
            read_oscillation_table(self._content, shown=str(self.file))
            self.file.write_bytes(self._content)
            series = read_oscillations([self.file])
        except ScenarioError:
            if fault is None:
                return  # a force table
            raise
        results = []
        for one in series:
            try:
                results.append(Result(one, one.identify()))
            except ValueError as error:
                raise ScenarioError(f"{self.file}: {one.force} by {one.motion}: {error}") from None
        to_json(results, files={})
        for result in results:
            result.words()
            frequency_rows(result)

    def _certificate(self) -> None:
        for found in load_designs(self.file):
            again = prove_again(found)
            for proof in again.proofs:
                _require_shown(proof.statement + proof.reason)
            if again.proved and zlib.crc32(self._content) % 8 == 1:
                for target in TARGETS:
                    try:
                        export_design(found, target)
                    except ValueError as error:
                        raise MaglevError(str(error)) from None

    def _design(self) -> None:
        self._certificate()
        if zlib.crc32(self._content) % 4 == 1:
            changed_since(self.file)
            pick(load_designs(self.file), None, file=self.file)

    def _report(self) -> None:
        found = difference(self._before, read_report(self.file))
        if zlib.crc32(self._content) % 4 == 1:
            difference_plain(found)
            difference_plain(difference(read_report(self.file), self._before))
        if zlib.crc32(self._content) % 8 == 1:
            with redirect_stdout(io.StringIO()) as out:
                cli_diff._print(found)
            _require_shown(out.getvalue())

    def _command(self) -> Finding | None:
        """The same through the whole command line: status 0, 1 or 2, and nothing that steers a terminal."""
        words = [word.format(self.file) if word == "{}" else word for word in _VERBS[self.kind]]
        words = [str(self.folder / word) if word == "before.json" else word for word in words]
        with redirect_stdout(io.StringIO()) as out, redirect_stderr(io.StringIO()) as err:
            status = main(words)
        self.outcomes["refused" if status == 2 else "read"] += 1
        said = out.getvalue() + err.getvalue()
        if status not in (0, 1, 2):
            return Finding(f"exit status {status}", words[0], said[:2000])
        if "Traceback (most recent call last)" in said:
            return Finding("a traceback is printed", words[0], said[-2000:])
        said = err.getvalue() if status == 2 else out.getvalue()
        return _told(said, words[0], longest=None if status != 2 else LONGEST)


def _told(message: str, place: str | BaseException, *, longest: int | None = LONGEST) -> Finding | None:
    """What is wrong with a message."""
    if message.strip() and len(message) <= LONGEST and not _CONTROL.search(message):
        return None
    place = _place(place) if isinstance(place, BaseException) else place
    if not message.strip():
        return Finding("an empty message", place, "")
    if longest is not None and len(message) > longest:
        return Finding("a message of more than 20 kB", place, message[:1000])
    sign = _CONTROL.search(message)
    if sign is not None:
        return Finding("a control sign in a message", place, f"U+{ord(sign[0]):04X} in {message[:2000]!r}")
    return None


def _require_shown(text: str) -> None:
    sign = _CONTROL.search(text)
    if sign is not None:
        raise AssertionError(f"a control sign U+{ord(sign[0]):04X} is shown: {text[:200]!r}")


def _place(error: BaseException) -> str:
    """The innermost line of the project."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if "maglev_ctrl" in frame.filename and "/tests/" not in frame.filename]
    if not own:
        return frames[-1].name if frames else "?"
    return f"{own[-1].filename.rpartition('maglev_ctrl/')[2]}:{own[-1].lineno} {own[-1].name}"
