"""The operating points a law has to hold at, and the linear models there."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.scenario.control_schema import Corners
from maglev_ctrl.study.situation import OptionModel, Situation
from maglev_ctrl.systems import SecondOrderSystem

_UNITS = {"speed": ("km/h", 3.6), "payload": ("t", 1e-3), "height": ("mm", 1e3), "gap": ("mm", 1e3)}


@dataclass(frozen=True, eq=False, slots=True)
class Corner:
    """One operating point, what the magnets' stiffness is multiplied by there, and its name."""

    situation: Situation
    stiffness: float
    name: str


def corners_of(model: OptionModel, corners: Corners | None) -> tuple[Corner, ...]:
    """The design point first, then every combination of the values a law's corners give."""
    design = Situation.of_design(model.scenario)
    first = Corner(design, 1.0, "design point")
    if corners is None:
        return (first,)
    axes = {key: getattr(corners, key) for key in _UNITS if getattr(corners, key)}
    factors = corners.magnetic_stiffness or (1.0,)
    found = [first]
    for *values, factor in product(*axes.values(), factors):
        given = dict(zip(axes, values, strict=True))
        words = [corner_words(key, value) for key, value in given.items()]
        words += [f"magnetic stiffness x {factor:g}"] if corners.magnetic_stiffness else []
        found.append(Corner(replace(design, **given), factor, ", ".join(words)))
    return tuple(found)


def corner_words(quantity: str, value: float) -> str:
    """An operating parameter and its value (SI) as people write it.

    Examples
    --------
    >>> corner_words("speed", 125.0)
    'speed 450 km/h'
    """
    unit, scale = _UNITS[quantity]
    return f"{quantity} {value * scale:.6g} {unit}"


def systems_at(
    model: OptionModel, corners: tuple[Corner, ...], *, pade_order: int = 0
) -> Iterator[tuple[Corner, SecondOrderSystem]]:
    """The linear model with open loops at every corner.

    Raises
    ------
    ModelError : there is no equilibrium at a corner
    OutOfDomain : the forces are not known there
    """
    for corner in corners:
        system = model.plant(corner.situation, pade_order=pade_order)
        yield corner, stiffened(system, corner.stiffness)


def stiffened(system: SecondOrderSystem, factor: float) -> SecondOrderSystem:
    """The system with the stiffness of its magnets times `factor`.

    Examples
    --------
    >>> plant = SecondOrderSystem.from_matrices([[1.0]], [[0.0]], [[4.0]])
    >>> stiffened(plant, 1.2).K  # no magnets
    array([[4.]])
    """
    if factor == 1.0:
        return system
    shares = tuple(
        replace(share, K=read_only(factor * share.K, name="K")) if share.kind == "magnet" else share
        for share in system.contributions
    )
    added: FloatArray = sum(
        ((factor - 1.0) * share.K for share in system.contributions if share.kind == "magnet"), 0.0 * system.K
    )
    return replace(system, K=read_only(system.K + added, name="K"), contributions=shares)
