"""Sets of requirements from practice, asked for by name: margins, damping, Floquet, ride, gap, power."""

from __future__ import annotations

from functools import cache
from typing import Final, Literal

from pydantic import TypeAdapter

from maglev_ctrl.scenario.requirement_schema import RequirementRecord

Pack = Literal[
    "classical_margins", "disk_margins", "iso_14839_zone_a", "iso_14839_zone_b", "damping_passive",
    "damping_controlled", "floquet", "ride_iso_2631", "gap", "power", "robust",
]  # fmt: skip

SOURCES: Final[dict[Pack, str]] = {
    "classical_margins": "6 dB and 30 deg: ECSS-E-HB-60-10A (gain margin better than 6 dB) and aerospace practice",
    "disk_margins": "disk margin 0.4: Seiler, Packard & Gahinet (2020); about 3.5 dB and 22 deg together in every loop",
    "iso_14839_zone_a": "ISO 14839-3, zone A: sensitivity peak below 3 (9.5 dB), newly commissioned machines",
    "iso_14839_zone_b": "ISO 14839-3, zone B: sensitivity peak below 4 (12 dB), unrestricted long-term operation",
    "damping_passive": "stable at every speed; damping ratio 0.02: what passive EDS vehicles reach (ours)",
    "damping_controlled": "stable at every speed; damping ratio 0.1: what controlled suspensions should reach (ours)",
    "floquet": "modulation survives twice the expected depth; 15 % of speed to the next tongue (ours)",
    "ride_iso_2631": "ISO 2631-1, annex C: below 0.315 m/s^2 not uncomfortable",
    "gap": "3 sigma and girder sag within half the clearance; contact less than once in a million hours (ours)",
    "power": "3 sigma of every actuator force within its limit (ours)",
    "robust": "stable for all uncertain parameters within their spread: guaranteed factor at least 1",
}
"""Where each pack's limits come from; "ours" are argued in the documentation, not taken from a standard."""


_STABLE: Final = ("growth_rate", "at_most", "0 1/s")
_LIMITS: Final[dict[Pack, tuple[tuple[str, str, float | str], ...]]] = {
    "classical_margins": (("gain_margin", "at_least", "6 dB"), ("phase_margin", "at_least", "30 deg")),
    "disk_margins": (("disk_margin", "at_least", 0.4), ("delay_margin", "at_least", "5 ms")),
    "iso_14839_zone_a": (("sensitivity_peak", "at_most", 3.0),),
    "iso_14839_zone_b": (("sensitivity_peak", "at_most", 4.0),),
    "damping_passive": (_STABLE, ("damping_ratio", "at_least", 0.02)),
    "damping_controlled": (_STABLE, ("damping_ratio", "at_least", 0.1)),
    "floquet": (("modulation_ratio", "at_least", 2.0), ("floquet_speed_margin", "at_least", 0.15)),
    "ride_iso_2631": (("weighted_acceleration", "at_most", "0.315 m/s^2"),),
    "gap": (("gap_used", "at_most", 0.5), ("contact_probability", "at_most", 1e-6)),
    "power": (("force_used", "at_most", 1.0),),
    "robust": (("robust_factor", "at_least", 1.0),),
}
"""Quantity, sense and limit as they would stand in a file."""


@cache
def pack_requirements(pack: Pack, *, swept: bool) -> tuple[RequirementRecord, ...]:
    """The requirements of a pack, named after their quantities.

    Parameters
    ----------
    swept : whether the scenario has a speed sweep: then they hold over it, else at the design point

    Examples
    --------
    >>> [one.quantity for one in pack_requirements("classical_margins", swept=True)]
    ['gain_margin', 'phase_margin']
    """
    reader: TypeAdapter[RequirementRecord] = TypeAdapter(RequirementRecord)
    return tuple(
        reader.validate_python(
            {
                "name": quantity,
                "quantity": quantity,
                sense: limit,
                "over": "speed" if swept else "nominal",
            }
        )
        for quantity, sense, limit in _LIMITS[pack]
    )
