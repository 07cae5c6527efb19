"""Orders to the process that does a page's slow work, so that it never stands in the way of the sliders."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Final

from maglev_ctrl.workbench.slow_process import SlowAnswer, SlowOrder

# Imported rather than run: pickles name a record by its module, which must not be "__main__".
_STARTED: Final = "from maglev_ctrl.workbench.slow_process import main; raise SystemExit(main())"
_COMMAND: Final = (sys.executable, "-c", _STARTED)


class SlowWork:
    """One process, begun with the first order and again after one that died; answers come on a thread of their own.

    Parameters
    ----------
    heard : called with every answer
    command : what to start; it speaks as `slow_process` does
    """

    def __init__(self, heard: Callable[[SlowAnswer], None], *, command: Sequence[str] = _COMMAND) -> None:
        self.heard = heard
        self._command = tuple(command)
        self._process: subprocess.Popen[bytes] | None = None
        self._serial = 0

    def order(self, order: SlowOrder) -> None:
        """Have something looked at in place of what was ordered before; nothing comes where no process can begin."""
        self._serial = order.serial
        if self._process is None or self._process.poll() is not None:
            with suppress(OSError):
                self._process = self._begun()
        self._send(order)

    def cancel(self, serial: int) -> None:
        """What was ordered before this number is not wanted any more."""
        if serial != self._serial:
            self._serial = serial
            self._send(SlowOrder(serial))

    def close(self) -> None:
        """End the process."""
        if self._process is not None and self._process.stdin is not None:
            with suppress(OSError):
                self._process.stdin.close()

    def _send(self, order: SlowOrder) -> None:
        if self._process is not None and self._process.stdin is not None:
            with suppress(OSError, ValueError):  # it ended: the next order begins another one
                pickle.dump(order, self._process.stdin)
                self._process.stdin.flush()

    def _begun(self) -> subprocess.Popen[bytes]:
        flags = getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)  # Windows only
        process = subprocess.Popen(
            self._command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, creationflags=flags,
            start_new_session=os.name != "nt",  # Ctrl-C is the server's to hear
        )  # fmt: skip
        threading.Thread(target=self._hear, args=(process,), name="slow work", daemon=True).start()
        return process

    def _hear(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdout is not None
        with process, suppress(EOFError, OSError, ValueError, pickle.UnpicklingError):
            while True:
                answer = pickle.load(process.stdout)
                self.heard(answer)  # whoever listens now, and not who did when the wait began
