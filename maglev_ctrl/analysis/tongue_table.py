"""Every tongue of a loop over speed with its first-order and its computed centre and width, its cause and its cure."""

from __future__ import annotations

from dataclasses import dataclass

from maglev_ctrl.analysis.resonance import Resonance
from maglev_ctrl.analysis.tongue_removal import TongueRemoval


@dataclass(frozen=True, eq=False, slots=True)
class TongueRow:
    """One tongue at one depth of modulation, over speed.

    `first_order`: centre and half-width by perturbation theory (m/s; half-width 0 below the threshold, NaN where the
    order has no first-order term). `computed`: centre and half-width of the unstable interval found by bisection on
    the multipliers, both edges verified by both engines; NaN with `reason` where there is none or they do not agree.
    `onset`: smallest unstable depth (inf: none up to the largest searched). `peak_growth` at the computed centre, 1/s.
    `removal`: the damping that removes it, None where it is not there. `feeding`: share of each element's modulation.
    `needs`: sign condition on the couplings of a combination tongue in words; "" for parametric ones.
    """

    resonance: Resonance
    depth: float
    first_order_centre: float
    first_order_half_width: float
    computed_centre: float
    computed_half_width: float
    onset: float
    peak_growth: float
    removal: TongueRemoval | None
    feeding: tuple[tuple[str, float], ...]
    needs: str
    reason: str
