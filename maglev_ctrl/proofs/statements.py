"""Claims as sentences a person reads."""

from __future__ import annotations

import math
from collections.abc import Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal

from maglev_ctrl.proofs.claims import (
    Claim,
    DecayClaim,
    EllipsoidClaim,
    EnergyClaim,
    GainClaim,
    ParameterClaim,
    RegionClaim,
    SegmentClaim,
)
from maglev_ctrl.systems.plant import Plant


def between(claim: Claim) -> str:
    """Words for the loops between the given ones that one common matrix covers.

    Examples
    --------
    >>> import numpy as np
    >>> between(DecayClaim((0, 1), (0, 0), 0.0, np.ones((1, 1, 1))))
    'every loop between them however fast it varies'
    """
    if isinstance(claim, RegionClaim | EnergyClaim):
        return "every constant loop between them"
    return "every loop between them however fast it varies"


def statement(claim: Claim, plants: Sequence[Plant], covered: str) -> str:
    """A claim in a sentence; `covered` names the loops between that it speaks of too.

    Examples
    --------
    >>> import numpy as np
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]])
    >>> statement(DecayClaim((0, 0), (0, 1), 0.5, np.ones((1, 1, 1))), [plant, plant], "")
    'every pole of each of the 2 closed loops decays at 0.5 1/s or faster'

    A loop that varies has no poles to speak of; what decays, or is stable, is the loop itself.

    >>> claim = DecayClaim((0, 0), (0, 1), 0.5, np.ones((1, 1, 1)))
    >>> statement(claim, [plant, plant], between(claim)).partition(", and ")[2]
    'every loop between them however fast it varies, decays at 0.5 1/s or faster'
    """
    count = len(claim.plants)
    loops = "the closed loop" if count == 1 else f"each of the {count} closed loops"
    subject = f"{loops}, and of {covered}," if covered else loops
    match claim:
        case DecayClaim(rate=rate):
            return f"{loops}, and {covered}, {_decay(rate)}" if covered else _poles(loops, rate)
        case RegionClaim(region=region, L=L, M=matrix):
            s = "s" if plants[0].dt is None else "z"
            where = f"L + {s} M + conj({s}) M' < 0, L = {L.tolist()}, M = {matrix.tolist()}"
            return f"every pole of {subject} lies in the region called {region} ({where})"
        case GainClaim(gamma=gamma):
            return f"the peak gain of {subject} from {_channel(claim, plants)} is below {_at_least(gamma)}"
        case EnergyClaim(level=level):
            return f"the H2 norm of {subject} from {_channel(claim, plants)} is below {_at_least(level)}"
        case EllipsoidClaim(limits=limits):
            named = ", ".join(
                f"|{name}| < {_at_least(limit)}" for name, limit in zip(plants[0].commands, limits, strict=False)
            )
            return f"the ellipsoid x'P x <= 1 of {subject} is never left without disturbance, and in it {named}"
        case ParameterClaim(rate=rate):
            return f"{loops}, and every constant loop between them, {_decay(rate)}"
        case SegmentClaim(width=width, speed_limit=speed):
            return (
                "the loop is stable everywhere between the 2 closed loops while the parameter, "
                f"{_at_least(width)} wide, moves at {_at_most(speed)} per second or slower"
            )


def _poles(loops: str, rate: float) -> str:
    return f"{loops} is stable" if rate == 0.0 else f"every pole of {loops} {_decay(rate)}"


def _decay(rate: float) -> str:
    return "is stable" if rate == 0.0 else f"decays at {_at_most(rate)} 1/s or faster"


def _at_least(value: float) -> str:
    """Ten digits, rounded up where they do not tell the number: a bound from above stays one."""
    return _told(value, ROUND_CEILING)


def _at_most(value: float) -> str:
    return _told(value, ROUND_FLOOR)


def _told(value: float, rounding: str) -> str:
    nearest = f"{value:.10g}"
    if not math.isfinite(value) or float(nearest) == value:
        return nearest
    return f"{float(Context(prec=10, rounding=rounding).create_decimal(Decimal(value))):.10g}"


def _channel(claim: GainClaim | EnergyClaim, plants: Sequence[Plant]) -> str:
    start, end = claim.disturbances or plants[0].disturbances, claim.performance or plants[0].performance
    return f"{_names(start, 'disturbances')} to {_names(end, 'outputs')}"


def _names(names: Sequence[str], word: str) -> str:
    return ", ".join(names) if 0 < len(names) <= 4 else f"{len(names)} {word}"
