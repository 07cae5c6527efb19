"""Faults of single values whose dimension or size another field decides."""

from __future__ import annotations

from collections.abc import Iterator

from maglev_ctrl.scenario.problems import Fault, KeyPath
from maglev_ctrl.scenario.units import Dimensions, Quantity, describe


def unit_faults(
    name: str, value: Quantity, dimensions: Dimensions, *, path: KeyPath, plain: bool = False
) -> Iterator[Fault]:
    """A value that has not the dimensions of what it belongs to.

    Parameters
    ----------
    name : what the value belongs to
    plain : whether a number without dimensions need not be written as an angle
    """
    if value.dimensions == dimensions and (dimensions or plain or value.written == "angle"):
        return
    example = describe(dimensions) if dimensions else "an angle"
    got = f'{describe(value.dimensions)}: "{value.text}"'
    yield Fault(path, f"expected {example} with its unit for {name}, got {got}")


def product(first: Dimensions, second: Dimensions) -> Dimensions:
    """Dimensions of a product.

    Examples
    --------
    >>> product((("[length]", 1.0),), (("[length]", -1.0), ("[time]", 1.0)))
    (('[time]', 1.0),)
    """
    powers = dict(first)
    for name, power in second:
        powers[name] = powers.get(name, 0.0) + power
    return tuple(sorted((name, power) for name, power in powers.items() if power))


def time_faults(record: object, *keys: str, path: KeyPath) -> Iterator[Fault]:
    """Times of a record that have to be above zero where they are given."""
    for key in keys:
        value = getattr(record, key, None)
        if value is not None and value <= 0.0:
            yield Fault((*path, key), "expected a time above zero")
