"""What the browser is told of a fault nobody expected: a sentence; the terminal gets the rest."""

from __future__ import annotations

import sys
import traceback

INTERNAL = "Internal fault: see the terminal the page was started from. The page can still be used."


def tell_terminal(where: str) -> None:
    """Write the exception being handled to the error stream."""
    sys.stderr.write(f"workbench: internal fault ({where})\n{traceback.format_exc()}")
    sys.stderr.flush()
