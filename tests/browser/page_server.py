"""The workbench as people start it, in a process of its own, and a person's hands on its page."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any, Final

from browser_watch import Watch
from playwright.sync_api import Locator, Page

ROOT: Final = Path(__file__).resolve().parents[2]
SMALL: Final = ROOT / "scenarios" / "paper" / "heave_surge.toml"
TRAIN: Final = "compare/eds_135t"
PATIENCE: Final = 60_000  # ms; machines of a build are slow and shared
HOSTILE: Final = "<script>window.hacked=1</script><img src=x onerror=window.hacked=2>"


def free_port() -> int:
    """A port that nobody listens on."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


class Server:
    """`maglev-ctrl ui`, started in a folder of its own."""

    def __init__(self, folder: Path, scenario: Path | None = SMALL, *, port: int = 0) -> None:
        self.folder, self.port = folder, port or free_port()
        self.address = f"http://127.0.0.1:{self.port}/"
        self._given = [] if scenario is None else [str(scenario)]
        self.begun = 0.0
        self.start()

    def start(self) -> None:
        """Start it, and wait for the line with its address."""
        command = [sys.executable, "-m", "maglev_ctrl", "ui", *self._given, "--no-open", "--port", str(self.port)]
        self.process = subprocess.Popen(
            command, cwd=self.folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
        )  # fmt: skip
        assert self.process.stdout is not None
        self.said = self.process.stdout.readline()
        assert self.address in self.said, self.said + self.ended()
        self._errors: list[str] = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        self.begun = time.perf_counter()

    def _read(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            self._errors.append(line)

    def kill(self) -> None:
        """As if the power had gone."""
        self.process.kill()
        self._gone()

    def stop(self) -> int:
        """Ctrl-C, and its exit status."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        try:
            return self.process.wait(30)
        finally:
            self.process.kill()
            self._gone()

    def _gone(self) -> None:
        self.process.wait()
        self._reader.join(10)
        for stream in (self.process.stdout, self.process.stderr):
            if stream is not None:
                stream.close()

    def ended(self) -> str:
        """What it said on the error stream when it could not start."""
        self.process.kill()
        return self.process.communicate()[1]

    def complaints(self) -> list[str]:
        """What it wrote to the terminal beside its address and its farewell."""
        return [line for line in self._errors if line.strip() and "the workbench is closed" not in line]


class Bench:
    """The page in a browser, used as a person uses it."""

    def __init__(self, page: Page) -> None:
        self.page = page

    @classmethod
    def open(cls, watch: Watch, address: str, **how: Any) -> Bench:
        """A page of a new person, drawn."""
        bench = cls(watch.page(**how))
        bench.page.set_default_timeout(PATIENCE)
        bench.page.goto(address, wait_until="domcontentloaded", timeout=PATIENCE)
        bench.drawn()
        return bench

    def at(self, name: str) -> Locator:
        """An element by its id."""
        return self.page.locator(f"#{name}")

    @property
    def state(self) -> str:
        """What the page is doing: starting, busy, preview, settled, failed, lost."""
        return str(self.page.evaluate("document.documentElement.dataset.state"))

    @property
    def shown(self) -> int:
        """How many views were drawn so far."""
        return int(self.page.evaluate("document.documentElement.dataset.shown"))

    def settled(self, *states: str) -> None:
        """Wait until the page rests in one of the states (settled or failed), all of its words told."""
        wanted = states or ("settled", "failed")
        self.page.wait_for_function(
            "wanted => wanted.includes(document.documentElement.dataset.state)", arg=list(wanted), timeout=PATIENCE
        )

    def drawn(self) -> None:
        """Wait until what was asked for last is on the screen, checked or not yet."""
        self.settled("preview", "settled", "failed")

    def after(self, shown: int) -> None:
        """The same, and a view newer than the `shown`-th has come."""
        self.page.wait_for_function(
            "n => Number(document.documentElement.dataset.shown) > n "
            "&& ['preview', 'settled', 'failed'].includes(document.documentElement.dataset.state)",
            arg=shown, timeout=PATIENCE,
        )  # fmt: skip

    def modes(self) -> list[str]:
        """The modes listed for picking: name, frequency, growth."""
        return self.page.locator("#host-eigenvalues select option").all_inner_texts()

    def eigenvalues(self) -> list[tuple[float, float]]:
        """Growth rate and frequency of every marker as it is drawn."""
        found = self.page.evaluate(
            "() => { const live = Bokeh.documents.find(d => d.get_model_by_name('bridge'));"
            "const figure = live.get_model_by_name('eigenvalues');"
            "const data = figure.renderers.map(r => r.data_source.data).find(d => d.own_growth);"
            "return [Array.from(data.x), Array.from(data.y)] }"
        )
        return list(zip(*found, strict=True))

    def source(self, figure: str, column: str) -> list[Any]:
        """A column of the first source of a figure that has it."""
        found: list[Any] = self.page.evaluate(
            "([name, column]) => { const live = Bokeh.documents.find(d => d.get_model_by_name('bridge'));"
            "const figure = live.get_model_by_name(name);"
            "const data = figure.renderers.map(r => r.data_source.data).find(d => d[column]);"
            "return Array.from(data[column], v => Array.isArray(v) || ArrayBuffer.isView(v) ? Array.from(v) : v) }",
            [figure, column],
        )
        return found

    def slide(self, name: str, step: int) -> None:
        """Put a slider to one of its 1000 steps, as one movement of the hand."""
        self.at(f"slide-{name}").evaluate(
            "(slider, step) => { slider.value = step; slider.dispatchEvent(new Event('input', {bubbles: true})) }", step
        )

    def type(self, name: str, text: str) -> None:
        """Type a value into a slider's field."""
        field = self.at(f"field-{name}")
        field.fill(text)
        field.press("Enter")

    def write(self, text: str) -> None:
        """Put a text into the editor, opened for it."""
        if not self.at("scenario-text").is_visible():
            self.at("editor").locator("summary").click()
        self.at("scenario-text").fill(text)

    def text(self) -> str:
        """The text in the editor."""
        return str(self.at("scenario-text").input_value())

    def upload(self, name: str, content: bytes) -> None:
        """Upload a file of the person's own."""
        if len(content) < 2**20:
            self.at("upload").set_input_files({"name": name, "mimeType": "text/plain", "buffer": content})
            return
        with tempfile.TemporaryDirectory() as folder:  # too long for the wire to the browser
            path = Path(folder) / name
            path.write_bytes(content)
            self.at("upload").set_input_files(path)
            self.page.wait_for_function("document.getElementById('upload').value === ''")  # it was looked at

    def downloaded(self, view: str, kind: str) -> bytes:
        """Click a download, and what the file has."""
        link = self.page.locator(f"a[data-view='{view}'][data-kind='{kind}']") if kind else self.at(view)
        with self.page.expect_download(timeout=PATIENCE) as waiting:
            link.click()
        return Path(waiting.value.path()).read_bytes()

    def no_trace(self) -> None:
        """No word of Python's on the page."""
        words = self.page.locator("body").inner_text()
        assert not re.search(r"Traceback|File \".*\", line|Internal fault|\b[A-Z]\w+Error\b", words), words


def number_of(words: str) -> float:
    """The first number in words, with the minus sign that a page prints."""
    found = re.search(r"-?\d+(?:\.\d+)?(?:e-?\d+)?", words.replace("\N{MINUS SIGN}", "-"))
    assert found is not None, words
    return float(found.group())
