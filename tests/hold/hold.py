"""Try to break it, and record what happened: python3 dev.py hold [PART ...] [--short] [--list]

The parts: sweeps under faults, hostile input, a stress set of systems whose answer is known, outputs killed while they
are written, the supply chain. A whole run takes about two hours; its record is docs/_data/reliability.json, which
docs/reliability.md shows. A part run alone renews its own record. With --short nothing is recorded.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
import tempfile
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
RECORD = ROOT / "docs" / "_data" / "reliability.json"
PARTS = ("sweeps", "fuzz", "stress", "atomic", "supply")


def main(arguments: list[str]) -> int:
    """The worst exit status of the parts."""
    short, names = "--short" in arguments, [one for one in arguments if not one.startswith("--")]
    wrong = [one for one in arguments if one.startswith("--") and one not in ("--short", "--list", "--help")]
    unknown = [one for one in names if one not in PARTS]
    if wrong or unknown:
        print(f"hold: expected parts of {', '.join(PARTS)}, or --short; got {(wrong or unknown)[0]}", file=sys.stderr)
        return 2
    if "--list" in arguments or "--help" in arguments:
        print(__doc__)
        return 0
    worst = 0
    for name in names or PARTS:
        print(f"\n== {name}", flush=True)
        with tempfile.TemporaryDirectory(prefix="maglev-hold-") as place:
            record = Path(place) / "record.json"
            command = [sys.executable, str(HERE / f"{name}.py"), "--record", str(record), *["--short"] * short]
            worst = max(worst, run(command))
            if record.exists() and not short:
                keep(RECORD, name, json.loads(record.read_text(encoding="utf-8")))
    print(f"\nhold: {'everything is met' if worst == 0 else 'something is missed or failed'}", flush=True)
    return worst


def run(command: list[str]) -> int:
    """The exit status of a part; Ctrl-C ends it and this."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    try:
        return subprocess.run(command, env=environment, cwd=ROOT, check=False).returncode
    except KeyboardInterrupt:
        raise SystemExit(130) from None


def keep(file: Path, name: str, told: dict[str, Any]) -> None:
    """Put the record of a part into the file, beside those of the other parts, in one step."""
    known: dict[str, Any] = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    known[name] = {
        **told, "day": datetime.now(UTC).strftime("%Y-%m-%d"), "commit": commit(),
        "machine": f"{os.cpu_count()} processors, {platform.system()}, Python {platform.python_version()}",
    }  # fmt: skip
    ordered = {part: known[part] for part in PARTS if part in known}
    file.parent.mkdir(parents=True, exist_ok=True)
    partial = file.with_name(f".{file.name}.new")
    partial.write_text(json.dumps(ordered, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    partial.replace(file)


def commit() -> str:
    """The commit that was tried, with a plus where files are changed; "unknown" outside a clone."""
    try:
        head = subprocess.run(["git", "rev-parse", "--short=7", "HEAD"], cwd=ROOT, capture_output=True, text=True,
                              check=True).stdout.strip()  # fmt: skip
        changed = subprocess.run(["git", "status", "--porcelain", "--untracked-files=no", "maglev_ctrl"], cwd=ROOT,
                                 capture_output=True, text=True, check=True).stdout.strip()  # fmt: skip
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return head + ("+" if changed else "")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
