"""What figures and tables are of: a name and a label, whether an option's study or a single result has them."""

from __future__ import annotations

from typing import Protocol


class Labelled(Protocol):
    """A short name for keys and a label for readers."""

    @property
    def name(self) -> str:
        """Unique on a page."""

    @property
    def label(self) -> str:
        """As readers know it."""
