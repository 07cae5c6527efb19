"""Elements of the ledger told together: forty magnets are one line, not forty."""

from __future__ import annotations

import numpy as np

from maglev_ctrl.analysis.ledger import Ledger
from maglev_ctrl.systems import SecondOrderSystem

_WORDS = {"magnet": "magnets", "body": "bodies", "geometry": "geometry", "aerodynamics": "aerodynamics"}


def ledger_groups(system: SecondOrderSystem | None, ledger: Ledger) -> dict[str, list[int]]:
    """All magnets, all bodies, spring-dampers and actuators of one family ("winding_front", ...), the rest alone.

    Without the system the kinds are not known: what is numbered ("front_magnet_1", ...) is told together.
    """
    kinds = {} if system is None else {share.name: share.kind for share in system.contributions}
    groups: dict[str, list[int]] = {}
    for place, element in enumerate(ledger.elements):
        kind = kinds.get(element, "other")
        head, _, last = element.rpartition("_")
        together = bool(head) and (kind in ("spring_damper", "actuator") or (system is None and last.isdigit()))
        family = head if together else element
        groups.setdefault(_WORDS.get(kind, family), []).append(place)
    return groups


def largest_feeder(system: SecondOrderSystem | None, ledger: Ledger, *, mode: int) -> tuple[str, float] | None:
    """The group that adds most to a mode's growth rate and how much (1/s); None when nothing feeds it."""
    total = ledger.damping[:, mode] + ledger.circulatory[:, mode]
    if np.isnan(total).any():
        return None
    shares = {name: float(np.sum(total[members])) for name, members in ledger_groups(system, ledger).items()}
    name = max(shares, key=lambda group: shares[group])
    rounding = 1e-9 * sum(abs(share) for share in shares.values())
    return (name, shares[name]) if shares[name] > rounding else None
