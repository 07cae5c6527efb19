"""The guideway: its period, and its roughness.

`periodic` is about what repeats: passing frequency, modulation, resonance speeds. The roughness that does not repeat
stands in `spectra` (densities), `shaping` (the filter that colours white noise alike), `realisation` (one seeded sample
of it), `recovery` (whether a sample has its density), `features` and `profile` (functions of the place along the track)
and `correlation` (what the elements of one vehicle have in common).
"""

from maglev_ctrl.guideway.periodic import (
    CommonPeriod,
    Modulation,
    ResonanceKind,
    ResonanceSpeed,
    common_period,
    passing_frequency,
    resonance_speeds,
)

__all__ = [
    "CommonPeriod",
    "Modulation",
    "ResonanceKind",
    "ResonanceSpeed",
    "common_period",
    "passing_frequency",
    "resonance_speeds",
]
