"""A design's controller as files for other tools."""

from __future__ import annotations

from maglev_ctrl.proofs.file import DesignFile


def export_design(design: DesignFile, target: str, *, period: float | None = None) -> dict[str, bytes]:
    """Files of one design by name."""
    return {}
