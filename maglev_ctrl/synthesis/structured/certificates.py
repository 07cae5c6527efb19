"""Claims about a finished closed loop of one law and several plants: decay, peak gain, H2 norm, damping sector."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

from maglev_ctrl.errors import ModelError
from maglev_ctrl.proofs.candidates import modal_matrix
from maglev_ctrl.proofs.claims import Claim, EnergyClaim, GainClaim, RegionClaim
from maglev_ctrl.proofs.makers import (
    RATES,
    bounded_real_claim,
    decay_claim,
    energy_claim,
    joint_claim,
    lyapunov_claim,
    tightest_claim,
)
from maglev_ctrl.proofs.prove import prove
from maglev_ctrl.synthesis.lmi.regions import damping
from maglev_ctrl.synthesis.structured.objective import Quantity
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant, closed_channel

C = TypeVar("C", GainClaim, EnergyClaim)
CLOSE = (0.999, 0.99, *RATES)
"""Shares of a decay rate that was made as large as possible."""
RATIOS = (0.9999, 0.999, 0.99, 0.9, 0.5)
"""Shares of a damping ratio that was made as large as possible."""


def stability_claim(plants: Sequence[Plant], controller: Controller) -> Claim:
    """Poles of every loop decay, at nearly the rate of the slowest where that can be proved.

    Raises
    ------
    ModelError : not even stability could be proved
    """
    return decay_claim(plants, [controller], shares=CLOSE)


def claims_of(
    quantity: Quantity, plants: Sequence[Plant], controller: Controller, found: float, level: float | None = None
) -> list[Claim]:
    """A limit kept at its `level`, or where there is none the quantity `found` with a little to spare.

    Raises
    ------
    ModelError : it could not be proved
    """
    if quantity == "decay_rate":
        return [] if level is None else [lyapunov_claim(plants, [controller], rate=level)]
    if quantity == "damping_ratio":
        return [_sector(plants, controller, i, found, level) for i in range(len(plants)) if plants[i].dt is None]
    if quantity == "h_infinity":
        return [_norm_claim(bounded_real_claim, plants, controller, found, level)]
    return [_norm_claim(energy_claim, plants, controller, found, level)]


def _norm_claim(
    make: Callable[[Plant, Controller, float], C],
    plants: Sequence[Plant],
    controller: Controller,
    found: float,
    level: float | None,
) -> C:
    if level is None:
        return tightest_claim(make, plants, [controller], found)
    return joint_claim(make, plants, [controller], level)


def _sector(plants: Sequence[Plant], controller: Controller, i: int, found: float, level: float | None) -> RegionClaim:
    """Poles of one loop in the sector of a damping ratio; a sampled loop's sector is no such region."""
    X = modal_matrix(closed_channel(plants[i], controller)[0])[None]
    for ratio in [share * found for share in RATIOS] if level is None else [level]:
        region = damping(ratio)
        claim = RegionClaim((i,), (0,), region.label, region.L, region.M, X)
        if prove(claim, plants, [controller]).holds:
            return claim
    raise ModelError(f"{plants[i].name}: no certificate of a damping ratio above {ratio:.6g} was found")
