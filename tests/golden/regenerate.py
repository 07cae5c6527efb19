"""Write the golden summaries anew: `python tests/golden/regenerate.py`. Review the difference before you commit it."""

from __future__ import annotations

import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from summary import FOLDER, SCENARIOS, golden_file, summary

if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name in SCENARIOS:
        golden_file(name).write_text(json.dumps(summary(name), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        print(golden_file(name))
