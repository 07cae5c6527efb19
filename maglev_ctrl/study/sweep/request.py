"""What is asked of a sweep: which quantities, at which points, for which options, and what is computed there."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Literal, get_args

import numpy as np

from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.scenario import Scenario
from maglev_ctrl.scenario.problems import near_match
from maglev_ctrl.scenario.quantity_paths import (
    DEPTH,
    GAIN,
    SPEED,
    WAVELENGTH,
    ScenarioQuantity,
    display_unit,
    find_quantity,
    require_different,
)
from maglev_ctrl.study.map.request import chosen_options, read_range, require_valid

Method = Literal["grid", "random", "latin"]
Part = Literal["modes", "floquet", "margins", "requirements"]

PARTS: Final = get_args(Part)
MOST_QUANTITIES: Final = 12
MOST_POINTS: Final = 10**9
MOST_LATIN: Final = 10**7
"""A Latin hypercube is shuffled as a whole, and stays in memory."""
RANGE: Final = "QUANTITY=FROM:TO, for example payload=0t:20t, or QUANTITY=MEAN~DEVIATION for a normal one"
_GENERATOR = 4  # numbers of 64 bits that the random generator makes at once


@dataclass(frozen=True, slots=True)
class SweepRange:
    """One quantity of a sweep and its values (SI).

    On a grid `count` even steps from `first` to `last`; otherwise drawn evenly between the two, or with `normal` from a
    normal distribution of mean `first` and standard deviation `last`. `bare`: written without a unit, read as SI.
    """

    quantity: ScenarioQuantity
    first: float
    last: float
    count: int = 0
    normal: bool = False
    bare: bool = False

    def steps(self) -> FloatArray:
        """The values (count,) of a grid."""
        return np.linspace(self.first, self.last, self.count)

    def drawn(self, share: FloatArray) -> FloatArray:
        """The values at shares (n,) of the distribution, 0 to 1."""
        if not self.normal:
            return np.asarray(self.first + (self.last - self.first) * share)
        from scipy.special import ndtri

        # A share of 0 would lie at minus infinity; half a step of the generator is the least that can be meant.
        return np.asarray(self.first + self.last * ndtri(np.clip(share, 2.0**-54, 1.0 - 2.0**-54)))

    @property
    def ends(self) -> tuple[float, float]:
        """The values it runs between; of a normal distribution three standard deviations to either side."""
        return (self.first - 3.0 * self.last, self.first + 3.0 * self.last) if self.normal else (self.first, self.last)

    def shown(self) -> tuple[str, float]:
        """The unit people read it in, and the factor from SI."""
        return display_unit(self.quantity, max(abs(end) for end in self.ends))


@dataclass(frozen=True)
class SweepRequest:
    """The points of a sweep, numbered 0 to `points` - 1, and what is computed at each for each of the options.

    Any range of points can be had without the others, and does not depend on how the sweep is cut into blocks.
    """

    ranges: tuple[SweepRange, ...]
    options: tuple[str, ...]
    parts: tuple[Part, ...]
    method: Method = "grid"
    drawn: int = 0  # points of a sample; a grid has the product of its counts
    seed: int = 0

    @property
    def points(self) -> int:
        """How many points there are."""
        if self.method != "grid":
            return self.drawn
        return int(np.prod([one.count for one in self.ranges], dtype=object))

    @property
    def shape(self) -> tuple[int, ...]:
        """Points along each quantity of a grid, the last one fastest; of a sample (points,)."""
        return tuple(one.count for one in self.ranges) if self.method == "grid" else (self.drawn,)

    def values(self, first: int, last: int) -> FloatArray:
        """Values (last - first, quantities) SI of the points from `first` up to, not including, `last`.

        Examples
        --------
        >>> from maglev_ctrl.scenario import load
        >>> scenario = load("scenarios/periodic/girder_passing.toml")
        >>> request = sweep_request(scenario, grid=["speed=50m/s:100m/s:3", "payload=0t:2t:2"])
        >>> request.points, request.values(2, 4).tolist()
        (6, [[75.0, 0.0], [75.0, 2000.0]])
        """
        if self.method == "grid":
            places = np.unravel_index(np.arange(first, last), self.shape)
            columns = [one.steps()[k] for one, k in zip(self.ranges, places, strict=True)]
        else:
            shares = self._random(first, last) if self.method == "random" else self._hypercube[first:last]
            columns = [one.drawn(shares[:, k]) for k, one in enumerate(self.ranges)]
        return read_only_any(np.stack(columns, axis=1))

    def _random(self, first: int, last: int) -> FloatArray:
        """Shares (n, quantities): point k takes the k-th part of one stream of numbers, whoever asks for it."""
        steps = -(-len(self.ranges) // _GENERATOR)
        stream = np.random.Philox(key=self.seed)
        stream.advance(first * steps)
        found = np.random.Generator(stream).random((last - first, steps * _GENERATOR))
        return np.asarray(found[:, : len(self.ranges)])

    @cached_property
    def _hypercube(self) -> FloatArray:
        from scipy.stats.qmc import LatinHypercube

        return np.asarray(LatinHypercube(d=len(self.ranges), rng=np.random.default_rng(self.seed)).random(self.drawn))

    def __getstate__(self) -> dict[str, object]:
        """Without the hypercube, which every process makes for itself."""
        return {name: value for name, value in self.__dict__.items() if name != "_hypercube"}


def sweep_request(
    scenario: Scenario, *, grid: Sequence[str] = (), vary: Sequence[str] = (), points: int | None = None,
    method: Literal["random", "latin"] | None = None, seed: int | None = None, options: Sequence[str] = (),
    parts: Sequence[str] = (),
) -> SweepRequest:  # fmt: skip
    """A request from what people write, checked as far as it can be without computing.

    Parameters
    ----------
    grid : "QUANTITY=FROM:TO:COUNT" each
    vary : instead of a grid: "QUANTITY=FROM:TO" or "QUANTITY=MEAN~DEVIATION" each
    points, method, seed : of a sample; a Latin hypercube and 0 unless given
    options : names; none: all
    parts : what is computed, of `PARTS`; none: modes, and floquet where the scenario has periodic forces

    Raises
    ------
    ValueError : what is wrong, in one sentence

    Examples
    --------
    >>> from maglev_ctrl.scenario import load
    >>> scenario = load("scenarios/periodic/girder_passing.toml")
    >>> sweep_request(scenario, vary=["payload=0t:2t"], points=100).parts
    ('modes', 'floquet')
    """
    if bool(grid) == bool(vary):
        told = "both were given" if grid else "none was given"
        raise ValueError(f"expected either --grid {'Q=FROM:TO:COUNT'} or --vary {'Q=FROM:TO'} with --points; {told}")
    given = {"--points": points, "--method": method, "--seed": seed}
    idle = next((name for name, value in given.items() if value is not None), "")
    if grid and idle:
        raise ValueError(f"{idle} belongs to --vary; a grid has its points in its ranges")
    if vary and points is None:
        raise ValueError("--vary: expected --points, the number of points that are drawn")
    flag, texts = ("--grid", grid) if grid else ("--vary", vary)
    ranges = tuple(_told(flag, scenario, text) for text in texts)
    if len(ranges) > MOST_QUANTITIES:
        raise ValueError(f"{flag}: expected at most {MOST_QUANTITIES} quantities, got {len(ranges)}")
    try:
        require_different([one.quantity for one in ranges])
    except ValueError as error:
        raise ValueError(f"{flag}: {error}") from None
    request = SweepRequest(
        ranges, _options(scenario, options), _parts(scenario, parts), "grid" if grid else method or "latin",
        points or 0, seed or 0,
    )  # fmt: skip
    _check_count(request)
    for one in ranges:
        _check_range(scenario, request, one)
    return request


def _check_count(request: SweepRequest) -> None:
    points, most = request.points, MOST_LATIN if request.method == "latin" else MOST_POINTS
    if not 1 <= points <= most:
        hint = "; --method random has no such limit" if request.method == "latin" and points > most else ""
        raise ValueError(f"expected 1 to {most:,} points, got {points:,}{hint}".replace(",", " "))
    if not 0 <= request.seed < 2**63:
        raise ValueError(f"--seed: expected a whole number from 0 to 2^63 - 1, got {request.seed}")


def _told(flag: str, scenario: Scenario, text: str) -> SweepRange:
    try:
        if flag == "--grid":
            found = read_range(scenario, text)
            return SweepRange(found.quantity, found.first, found.last, found.count, bare=found.bare)
        return _drawn_range(scenario, text)
    except ValueError as error:
        raise ValueError(f"{flag}: {error}") from None


def _drawn_range(scenario: Scenario, text: str) -> SweepRange:
    name, _, rest = (part.strip() for part in text.partition("="))
    normal = "~" in rest
    parts = [part.strip() for part in re.split("[:~]", rest)]
    if len(parts) != 2 or not name or not all(parts):
        raise ValueError(f'expected {RANGE}, got "{text}"')
    if not normal:  # the rules of a grid, with the least number of points
        found = read_range(scenario, f"{name}={parts[0]}:{parts[1]}:2")
        if found.quantity.whole:
            raise ValueError(f"{name}: takes whole numbers only; put it on a --grid")
        return SweepRange(found.quantity, found.first, found.last, bare=found.bare)
    quantity = find_quantity(scenario, name)
    if quantity.whole:
        raise ValueError(f"{name}: takes whole numbers only; put it on a --grid")
    mean, bare = quantity.read(parts[0])
    if parts[1].endswith("%"):
        share, _ = replace(quantity, kind=None, unit="", least=0.0).read(parts[1])
        deviation = share * abs(mean)
    else:
        deviation, _ = quantity.read(parts[1])
    if not deviation > 0.0:
        raise ValueError(f"{name}: expected a standard deviation above zero, got {parts[1]}")
    return SweepRange(quantity, mean, deviation, normal=True, bare=bare)


def _options(scenario: Scenario, names: Sequence[str]) -> tuple[str, ...]:
    try:
        return chosen_options(scenario, names)
    except ValueError as error:
        raise ValueError(f"--option: {error}") from None


def _parts(scenario: Scenario, names: Sequence[str]) -> tuple[Part, ...]:
    for name in names:
        if name not in PARTS:
            raise ValueError(f'--compute: unknown part "{name}"{near_match(name, PARTS)}')
    if scenario.periodic is None and "floquet" in names:
        raise ValueError("--compute: floquet: the scenario describes no periodic forces; add a [periodic] table")
    chosen = set(names) or ({"modes"} if scenario.periodic is None else {"modes", "floquet"})
    if "requirements" in chosen and scenario.periodic is not None:
        chosen.add("floquet")  # no requirement is met where the vehicle grows under the periodic forces
    return tuple(part for part in PARTS if part in chosen | {"modes"})


def _check_range(scenario: Scenario, request: SweepRequest, one: SweepRange) -> None:
    """A range has to change something, and both its ends have to give a valid scenario."""
    quantity = one.quantity
    names = [option.name for option in scenario.options]
    if quantity.option is not None and names[quantity.option] not in request.options:
        raise ValueError(f"{quantity.name}: it changes nothing in the options asked for")
    if quantity.name == GAIN and not any(
        option.control is not None for option in scenario.options if option.name in request.options
    ):
        raise ValueError("gain: none of the options has a control law")
    if quantity.name in (DEPTH, WAVELENGTH) and "floquet" not in request.parts:
        raise ValueError(f"{quantity.name}: it changes nothing without floquet; add --compute floquet")
    if quantity.whole and not np.array_equal(one.steps(), np.round(one.steps())):
        raise ValueError(f"{quantity.name}: expected whole numbers; choose COUNT so that every step is a whole number")
    if quantity.name == SPEED and one.ends[0] <= 0.0 and not one.normal:
        raise ValueError(f"speed: expected values above zero, got {one.ends[0]:g} m/s")
    if quantity.path and not one.normal:
        require_valid(scenario, quantity, one.ends)
