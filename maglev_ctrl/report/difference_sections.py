"""Numbers compared within rounding, and whole parts of a report compared without knowing what they mean."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.report.difference_records import NumberChange, SectionChange
from maglev_ctrl.report.reading import number_of

_DEEPEST: Final = 40  # records within records; nothing a report holds comes near
_OF_THE_COMPUTATION: Final = (
    "seconds", "residual", "residuals", "error", "errors", "error_bound", "iterations", "difference", "perturbation",
    "confidence", "unbalanced",
)  # fmt: skip


def number_change(
    name: str, before: float, *, after: float, unit: str, tolerance: float, unit_before: str | None = None,
    floor: float = 0.0,
) -> NumberChange:  # fmt: skip
    """A number before and after.

    Parameters
    ----------
    before, after : NaN where there is none
    unit_before : None for the same unit; in different units nothing is subtracted
    tolerance : relative change up to which they count as equal
    floor : absolute change up to which they count as equal

    Examples
    --------
    >>> found = number_change("value", 2.0, after=3.0, unit="dB", tolerance=1e-6)
    >>> found.changed, found.absolute, found.relative
    (True, 1.0, 0.5)
    """
    old_unit = unit if unit_before is None else unit_before
    if old_unit != unit:
        return NumberChange(name, before, after, unit, old_unit, math.nan, math.nan, True)
    absolute = 0.0 if before == after else after - before  # two infinities of one sign are equal
    if absolute == 0.0:
        relative = 0.0
    elif before == 0.0:
        relative = math.copysign(math.inf, absolute) if absolute == absolute else math.nan
    else:
        relative = absolute / abs(before) if math.isfinite(before) else math.nan
    changed = differs(before, after, scale=max(abs(before), abs(after)), tolerance=tolerance, floor=floor)
    return NumberChange(name, before, after, unit, old_unit, absolute, relative, changed)


def differs(before: float, after: float, *, scale: float, tolerance: float, floor: float = 0.0) -> bool:
    """Whether two numbers differ by more than rounding; NaN equals NaN, infinity the infinity of its sign.

    Examples
    --------
    >>> differs(1.0, 1.0 + 1e-9, scale=1.0, tolerance=1e-6), differs(math.nan, 1.0, scale=1.0, tolerance=1e-6)
    (False, True)
    """
    if before == after or (math.isnan(before) and math.isnan(after)):
        return False
    if not (math.isfinite(before) and math.isfinite(after)):
        return True
    return abs(after - before) > max(tolerance * scale, floor)


def section_change(name: str, before: Any, after: Any, *, tolerance: float) -> SectionChange:
    """How much differs between two parts of two reports, as JSON has them.

    Fields whose names end in residual, error, seconds and the like tell of the computation, not of the vehicle, and
    are left out. Complex numbers that only stand in another order, or are exchanged for their conjugates, are equal:
    eigenvalues have no order of their own.

    Examples
    --------
    >>> found = section_change("ride", {"index": {"value": 2.0, "unit": ""}}, {"index": {"value": 2.5, "unit": ""}},
    ...     tolerance=1e-6)
    >>> found.numbers, found.changed, found.largest.name
    (1, 1, 'ride.index')
    """
    tally = _Tally(tolerance)
    _walk(before, after, name, "", tally, 0)
    return SectionChange(name, tally.numbers, tally.changed, tally.other, tally.other_at, tally.largest)


@dataclass(slots=True)
class _Tally:
    """Counts kept while two parts are gone through."""

    tolerance: float
    numbers: int = 0
    changed: int = 0
    other: int = 0
    other_at: str = ""
    largest: NumberChange | None = field(default=None)

    def words(self, path: str) -> None:
        """Something other than a number differs."""
        self.other += 1
        self.other_at = self.other_at or path

    def number(self, before: float, after: float, path: str, unit: str) -> None:
        """Two single numbers."""
        self.numbers += 1
        change = number_change(path, before, after=after, unit=unit, tolerance=self.tolerance)
        if change.changed:
            self.changed += 1
            self._keep(change)

    def numbers_of(self, before: FloatArray, after: FloatArray, path: str, unit: str, scale: float) -> None:
        """Two arrays of one shape: what is small beside the largest entry is rounding."""
        self.numbers += before.size
        same = (before == after) | (np.isnan(before) & np.isnan(after))
        finite = np.isfinite(before) & np.isfinite(after)
        apart = np.abs(np.where(finite, after, 0.0) - np.where(finite, before, 0.0))
        changed = ~same & (~finite | (apart > self.tolerance * scale))
        if not np.any(changed):
            return
        self.changed += int(np.count_nonzero(changed))
        worst = np.unravel_index(int(np.argmax(np.where(changed, np.where(finite, apart, 0.0), -1.0))), before.shape)
        place = "".join(f"[{index}]" for index in worst)
        self._keep(
            number_change(
                f"{path}{place}", float(before[worst]), after=float(after[worst]), unit=unit, tolerance=self.tolerance
            )
        )

    def _keep(self, change: NumberChange) -> None:
        if self.largest is None or _size(change) > _size(self.largest):
            self.largest = change


def _size(change: NumberChange) -> float:
    """Finite relative changes by their size; those from zero, and to or from no number, say less and come last."""
    return abs(change.relative) if math.isfinite(change.relative) else -1.0


def _walk(before: Any, after: Any, path: str, unit: str, tally: _Tally, depth: int) -> None:
    if isinstance(before, Mapping) and isinstance(after, Mapping) and depth < _DEEPEST:
        _walk_records(before, after, path, unit, tally, depth)
    elif isinstance(before, list) and isinstance(after, list) and depth < _DEEPEST:
        old, new = _array(before), _array(after)
        if old is not None and new is not None and old.shape == new.shape:
            tally.numbers_of(old, new, path, unit, max(_largest(old), _largest(new)))
            return
        if len(before) != len(after):
            tally.words(path)
        for k, (one, other) in enumerate(zip(before, after, strict=False)):
            _walk(one, other, f"{path}[{k}]", unit, tally, depth + 1)
    else:
        a, b = number_of(before), number_of(after)
        if a is not None and b is not None:
            tally.number(a, b, path, unit)
        elif before != after:
            tally.words(path)


def _walk_records(
    before: Mapping[str, Any], after: Mapping[str, Any], path: str, unit: str, tally: _Tally, depth: int
) -> None:
    if before.keys() == after.keys() == {"value", "unit"}:
        if before["unit"] != after["unit"]:
            tally.words(f"{path}.unit")
        else:
            _walk(before["value"], after["value"], path, str(after["unit"]), tally, depth + 1)
        return
    if before.keys() == after.keys() == {"re", "im"}:
        parts = [_array(one[part]) for one in (before, after) for part in ("re", "im")]
        known = [one for one in parts if one is not None]
        if len(known) == 4 and len({one.shape for one in known}) == 1:
            _compare_complex(known, path, unit, tally)
            return
    for key in before.keys() ^ after.keys():
        tally.words(f"{path}.{key}")
    for key in before:
        if key in after and not key.endswith(_OF_THE_COMPUTATION):
            _walk(before[key], after[key], f"{path}.{key}", unit, tally, depth + 1)


def _compare_complex(parts: list[FloatArray], path: str, unit: str, tally: _Tally) -> None:
    """Real and imaginary parts before and after, both measured by the largest of all four."""
    scale = max(_largest(one) for one in parts)
    real, imaginary, new_real, new_imaginary = parts
    if real.ndim and _alike(real, new_real, tally.tolerance * scale) and _alike(
        np.abs(imaginary), np.abs(new_imaginary), tally.tolerance * scale
    ):  # fmt: skip
        tally.numbers += 2 * real.size
        return
    tally.numbers_of(real, new_real, f"{path}.re", unit, scale)
    tally.numbers_of(imaginary, new_imaginary, f"{path}.im", unit, scale)


def _alike(before: FloatArray, after: FloatArray, distance: float) -> bool:
    """The same numbers along the last axis, in whatever order; sorted numbers move no farther than the numbers do."""
    old, new = np.sort(before, axis=-1), np.sort(after, axis=-1)  # NaN comes last
    return bool(np.all((old == new) | (np.isnan(old) & np.isnan(new)) | (np.abs(old - new) <= distance)))


def _array(data: Any) -> FloatArray | None:
    """Nested lists of numbers, or one number; None for anything else, empty lists too."""
    if not isinstance(data, (list, int, float)) or isinstance(data, bool) or data == []:
        return None
    try:
        found = np.asarray(data, dtype=np.float64)  # reads the words for NaN and the infinities too
    except (ValueError, TypeError, OverflowError):
        return None
    return found if found.size else None


def _largest(array: FloatArray) -> float:
    return float(np.max(np.abs(array), where=np.isfinite(array), initial=0.0))
