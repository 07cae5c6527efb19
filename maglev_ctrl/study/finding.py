"""A quantity that was found, and how sure it is: what requirements are judged on."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class Finding:
    """A quantity's value (SI, dB for gains) and where it was found; or why there is none.

    `bound` is "lower" where the true value is at least this, "upper" where it is at most this: such a value decides
    only where the true one has to lie on the same side of the limit.
    """

    value: float
    where: str = ""
    method: str = ""
    reason: str = ""
    bound: Literal["exact", "lower", "upper"] = "exact"


def missing(reason: str) -> Finding:
    """No value, with the reason."""
    return Finding(math.nan, reason=reason)
