"""The process behind "make report": the whole study of one scenario, told line by line on its output.

It reads one line of JSON (text, path, name, folder, jobs) from its input and ends when the input is closed: a server
that is gone leaves no study behind.
"""

from __future__ import annotations

import _thread
import json
import os
import sys
import threading
import traceback
from dataclasses import replace
from pathlib import Path


def main() -> int:
    """Study and write; exit status 0 done, 2 the scenario is wrong, 3 an internal fault, 130 ended."""
    order = json.loads(sys.stdin.readline())
    threading.Thread(target=_end_with_input, daemon=True).start()
    try:
        return _report(order)
    except KeyboardInterrupt:
        return 130


def _report(order: dict[str, object]) -> int:
    from maglev_ctrl.errors import MaglevError
    from maglev_ctrl.report import write
    from maglev_ctrl.scenario.reader import load_text
    from maglev_ctrl.study import run

    def tell(what: str, fraction: float) -> None:
        _say(what=what, fraction=fraction)

    try:
        scenario = load_text(str(order["text"]), str(order["path"]))
        comparison = run(scenario, jobs=int(str(order["jobs"])), progress=tell)
        _say(what="writing the report", fraction=1.0)
        shown = f"{order['name']}.toml"  # the folder it counts as lying in says nothing to a reader
        paths = write(replace(comparison, scenario_path=shown), Path(str(order["folder"])))
    except MaglevError as fault:
        _say(fault=str(fault))
        return 2
    except OSError as fault:
        _say(fault=f"the report cannot be written: {fault.strerror or fault}")
        return 2
    except Exception:  # the page shows a sentence, the terminal everything
        traceback.print_exc()
        _say(fault="internal fault, see the terminal the page was started from")
        return 3
    _say(done=[path.name for path in paths], verdict=comparison.verdict.value)
    return 0


def _say(**told: object) -> None:
    sys.stdout.write(json.dumps(told) + "\n")
    sys.stdout.flush()


def _end_with_input() -> None:
    """Interrupt the study when whoever ordered it closes the input; workers end with it."""
    while os.read(0, 4096):
        pass
    _thread.interrupt_main()
    timer = threading.Timer(5.0, os._exit, args=(130,))
    timer.daemon = True
    timer.start()


if __name__ == "__main__":
    sys.exit(main())
