"""Re-check claims about closed loops with arithmetic whose rounding is bounded, or exactly."""

from __future__ import annotations

from collections.abc import Sequence

from maglev_ctrl.proofs.claims import Claim, Proof
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant


def prove(claim: Claim, plants: Sequence[Plant], controllers: Sequence[Controller]) -> Proof:
    """Re-check one claim; no solver is trusted."""
    raise NotImplementedError
