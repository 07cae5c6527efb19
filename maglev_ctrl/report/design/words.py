"""Claims, names and notes in the few words a page or a terminal has room for; the exact ones are in design.json."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Final

from maglev_ctrl.proofs.claims import Proof, SegmentClaim
from maglev_ctrl.report.style import number
from maglev_ctrl.study.design.document import units_of
from maglev_ctrl.study.design.records import LawStudy
from maglev_ctrl.synthesis.result import Synthesis

DIGITS: Final = 4
_NUMBER: Final = re.compile(
    r"(?P<before>decays at |moves at |above |below |< )?(?<![\w.])(?P<value>\d+\.\d+(?:e[+-]?\d+)?|\d{6,})"
)
_BOUND: Final = re.compile(r"(?P<before>decays at |below )(?P<value>[\d.]+(?:e[+-]?\d+)?)")
_SEGMENTS: Final = "segments"
_PARAMETER: Final = "the parameter"
_SPEED: Final = re.compile(r"(moves at \S+)( per second)")
_COMMAND: Final = re.compile(r"\|(?P<name>[^|]+)\| < [\d.]*\d(?:e[+-]?\d+)?")
_WIDTH: Final = re.compile(r", [\d.e+-]+ wide,")
_NUMBERED: Final = re.compile(r"([A-Za-z_][\w.]*?)(\d+)([A-Za-z_.]*)")
_LIST: Final = re.compile(r"[A-Za-z_][\w.]*(?:, [A-Za-z_][\w.]*)+")


def claim_units(option: LawStudy) -> dict[str, str]:
    """SI units for the numbers in an option's claims: of its signals by name, and of the parameter of its schedule."""
    units = units_of(option.document["extra"]) if option.document is not None else {}
    schedule = option.schedule.schedule if option.schedule is not None else None
    return units if schedule is None else {**units, _PARAMETER: schedule.unit}


def claim_words(synthesis: Synthesis, place: int, units: Mapping[str, str] | None = None) -> str:
    """One claim in a sentence: rounded to the side that claims less, matrices left out, operating points named.

    Parameters
    ----------
    units : as of `claim_units`
    """
    claim = synthesis.claims[place]
    words, names = _short(synthesis.proofs[place]), [synthesis.plants[i].name for i in claim.plants]
    words = _with_units(words, units or {})
    if isinstance(claim, SegmentClaim):
        words = _WIDTH.sub("", words).replace("between the 2 closed loops", f"from {names[0]} to {names[1]}")
    elif len(names) == 1 and len(synthesis.plants) > 1:
        words += f" ({names[0]})"
    return words


def claims_in_short(synthesis: Synthesis, units: Mapping[str, str] | None = None) -> tuple[str, ...]:
    """The claims for a terminal: what is said of several operating points is told once, with the weakest bound.

    Parameters
    ----------
    units : as of `claim_units`
    """
    told: dict[str, list[int]] = {}
    for place, (claim, proof) in enumerate(zip(synthesis.claims, synthesis.proofs, strict=True)):
        if not proof.holds:
            key = f"NOT PROVED: {_short(proof)} ({proof.reason})"
        elif isinstance(claim, SegmentClaim):
            key = _SEGMENTS
        else:
            key = _BOUND.sub(lambda found: found["before"], proof.statement) if len(claim.plants) == 1 else str(place)
        told.setdefault(key, []).append(place)
    return tuple(
        _with_units(key if key.startswith("NOT") else _told(synthesis, places), units or {})
        for key, places in told.items()
    )


def _told(synthesis: Synthesis, places: Sequence[int]) -> str:
    claims = [synthesis.claims[place] for place in places]
    segments = [claim for claim in claims if isinstance(claim, SegmentClaim)]
    if segments:
        slowest = round_down(min(claim.speed_limit for claim in segments))
        count = len({i for one in segments for i in one.plants})
        return (
            f"the loop is stable everywhere between {count} nodes while the parameter moves at "
            f"{number(slowest, digits=DIGITS)} per second or slower"
        )
    found = [(_BOUND.search(synthesis.proofs[place].statement), place) for place in places]
    bounds = [(float(one["value"]), place) for one, place in found if one is not None]
    place = places[0]
    if bounds:
        above = any(one is not None and one["before"] == "below " for one, _ in found)
        place = (max if above else min)(bounds)[1]
    words = _short(synthesis.proofs[place])
    return words if len(places) == 1 else f"{words} (at each of {len(places)} operating points)"


def _short(proof: Proof) -> str:
    return rounded_claim(proof.statement.partition(" (L + ")[0])


def _with_units(words: str, units: Mapping[str, str]) -> str:
    """Units behind the limits of commands and the speed of the parameter, where they are known."""

    def limited(found: re.Match[str]) -> str:
        return f"{found[0]} {units[found['name']]}" if found["name"] in units else found[0]

    if _PARAMETER in units:
        words = _SPEED.sub(rf"\1 {units[_PARAMETER]}\2", words)
    return _COMMAND.sub(limited, words)


def rounded_claim(statement: str) -> str:
    """The statement with numbers of four digits: bounds from above rounded up, rates rounded down, so it stays true.

    Examples
    --------
    >>> rounded_claim("every pole of the closed loop decays at 1.807784194 1/s or faster")
    'every pole of the closed loop decays at 1.807 1/s or faster'
    >>> rounded_claim("the peak gain of the closed loop from w to z is below 1.81524423")
    'the peak gain of the closed loop from w to z is below 1.816'
    """

    def short(found: re.Match[str]) -> str:
        before, value = found["before"] or "", float(found["value"])
        if before in ("decays at ", "moves at ", "above "):
            value = _toward(value, down=True)
        elif before:
            value = _toward(value, down=False)
        return before + (f"{value:.{DIGITS}g}" if value < 1e4 else number(value, digits=DIGITS))

    return _NUMBER.sub(short, statement)


def round_down(value: float) -> float:
    """A positive number to four digits, never more than it is.

    Examples
    --------
    >>> round_down(22538.846)
    22530.0
    """
    return _toward(value, down=True)


def round_up(value: float) -> float:
    """A positive number to four digits, never less than it is."""
    return _toward(value, down=False)


def short_names(names: Sequence[str]) -> tuple[str, ...]:
    """Names without what all of them end or start with, as long as they stay different.

    Examples
    --------
    >>> short_names(("secondary_damper_bogie", "primary_damper_bogie"))
    ('secondary', 'primary')
    >>> short_names(("coil_front", "coil_rear")), short_names(("leg",))
    (('front', 'rear'), ('leg',))
    """
    parts = [name.split("_") for name in names]
    if len(parts) < 2:
        return tuple(names)
    while all(len(part) > 1 for part in parts) and len({part[-1] for part in parts}) == 1:
        parts = [part[:-1] for part in parts]
    while all(len(part) > 1 for part in parts) and len({part[0] for part in parts}) == 1:
        parts = [part[1:] for part in parts]
    found = tuple("_".join(part) for part in parts)
    return found if len(set(found)) == len(found) else tuple(names)


def gathered(text: str) -> str:
    """Text in which lists of numbered names are told by their ends.

    Examples
    --------
    >>> gathered("soft limits (stroke, magnet_1.gap, magnet_2.gap, magnet_3.gap) are kept")
    'soft limits (stroke, magnet_1.gap to magnet_3.gap) are kept'
    """
    return _LIST.sub(lambda found: ", ".join(_runs(found[0].split(", "))), text)


def _runs(names: Sequence[str]) -> list[str]:
    groups: list[list[str]] = []
    for name in names:
        last = _NUMBERED.fullmatch(groups[-1][-1]) if groups else None
        here = _NUMBERED.fullmatch(name)
        follows = last and here and (here[1], here[3]) == (last[1], last[3]) and int(here[2]) == int(last[2]) + 1
        if follows:
            groups[-1].append(name)
        else:
            groups.append([name])
    return [", ".join(one) if len(one) < 3 else f"{one[0]} to {one[-1]}" for one in groups]


def _toward(value: float, *, down: bool) -> float:
    if not math.isfinite(value) or value <= 0.0:
        return value
    unit = 10.0 ** (math.floor(math.log10(value)) - DIGITS + 1)
    nearest = float(f"{value:.{DIGITS}g}")
    if (nearest <= value) if down else (nearest >= value):
        return nearest
    return float(f"{nearest - unit if down else nearest + unit:.{DIGITS}g}")
