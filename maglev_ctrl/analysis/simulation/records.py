"""Records of a time simulation: limits, events, and the trajectory with its signals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field
from typing import ClassVar, Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.display import Shown

EventKind = Literal["contact", "data", "diverged"]


class Track(Protocol):
    """The guideway's irregularity as functions of the place along it, such as `guideway.TrackProfile`."""

    def under(self, x: ArrayLike, y: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Vertical and lateral displacement (...) m of the guideway at places x along it and y to the left of it."""
        ...

    def slopes(self, x: ArrayLike, y: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Their derivatives by x (...)."""
        ...


@runtime_checkable
class RespondingTrack(Protocol):
    """A guideway that gives way under the vehicle (attribute `responds` True): each run has its own.

    After every step it is told where the vehicle stands and with what it loads the guideway; `under` and `slopes`
    answer with the state of that time until it is told again.
    """

    responds: bool

    def under(self, x: ArrayLike, y: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """As a track's."""
        ...

    def slopes(self, x: ArrayLike, y: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """As a track's."""
        ...

    def advance(self, time: float, places: FloatArray, loads: FloatArray, step: float) -> None:
        """Move on by a step (s) from `time` (s) under vertical loads (k,) N, downwards positive, at places (k,) m."""
        ...


@dataclass(frozen=True, eq=False, slots=True)
class Limits:
    """What ends a run, and what an input can give.

    Parameters
    ----------
    height, gap : m; a magnet nearer than this to its guideway or wall touches it
    strokes : stroke of a connection or actuator, by its name, from its equilibrium, m (rad); either way
    commands : largest magnitude of an input's command by its name, such as a winding's voltage; actuators have theirs
        (`force_limit`) already
    travel, turn : m, rad; a coordinate that moves further counts as diverged. Surge is free

    Raises
    ------
    ValueError : a limit that is negative or not a number

    Examples
    --------
    >>> Limits(strokes={"spring": 0.05}).height
    0.0
    """

    height: float = 0.0
    gap: float = 0.0
    _: KW_ONLY
    strokes: Mapping[str, float] = field(default_factory=dict)
    commands: Mapping[str, float] = field(default_factory=dict)
    travel: float = 10.0
    turn: float = 0.5

    def __post_init__(self) -> None:
        named = {"height": self.height, "gap": self.gap, "travel": self.travel, "turn": self.turn}
        named |= {f"strokes[{key}]": value for key, value in self.strokes.items()}
        named |= {f"commands[{key}]": value for key, value in self.commands.items()}
        for name, value in named.items():
            if not value >= 0.0:
                raise ValueError(f"{name}: expected a limit that is not negative, got {value}")


@dataclass(frozen=True, eq=False, slots=True)
class Event:
    """The end of one run before its time.

    `kind`: "contact" (a magnet, or a stroke at its limit), "data" (a magnet left its force model's data), "diverged".
    `time` s, found by interpolation within a step; `element` what it befell; `speed` m/s (rad/s) towards the limit at
    that time, NaN where there is no such thing; `reason` in words.
    """

    run: int
    kind: EventKind
    time: float
    element: str
    speed: float
    reason: str


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Trajectory(Shown):
    """The motion of r runs, s samples each.

    Signals are increments from the equilibrium, but "<magnet>.height", "<magnet>.clearance" (m, to the wall) and
    "<magnet>.lift" (N) are whole. After a run's event its samples are NaN.

    Attributes
    ----------
    time : (s,) s
    signals : by name (r, s): coordinates, "<coordinate>.velocity", "<coordinate>.acceleration", internal states,
        outputs of the linear model, "<input>.command", "<actuator>.applied" (N), and the magnets' as above
    events : at most one per run
    ends : (r,) s, when each run ended
    saturation : share of its time that each command was at its limit, by input, (r,)
    kinetic, work : (r, s) J; kinetic energy, and work of all forces since the start. Their difference is constant:
        `energy_error` is its largest change relative to the largest kinetic energy or work
    step : s, of the integration; the largest, where steps are fitted to a sampled law
    step_error : largest difference of a coordinate to a run with half the step, relative to its largest displacement,
        over the first `checked` seconds
    """

    _told: ClassVar = ("time", "signals", "events", "step", "step_error")

    time: FloatArray
    signals: Mapping[str, FloatArray]
    events: tuple[Event, ...]
    ends: FloatArray
    saturation: Mapping[str, FloatArray]
    kinetic: FloatArray
    work: FloatArray
    energy_error: float
    step: float
    step_error: float
    checked: float

    @property
    def runs(self) -> int:
        """How many."""
        return len(self.ends)

    @property
    def interval(self) -> float:
        """Time between samples, s."""
        return float(self.time[1] - self.time[0]) if len(self.time) > 1 else float("nan")

    def of(self, name: str) -> FloatArray:
        """One signal, (r, s).

        Raises
        ------
        ValueError : there is no such signal
        """
        if name not in self.signals:
            raise ValueError(f"signal: there is no {name!r}; there are {', '.join(self.signals)}")
        return self.signals[name]

    def event_of(self, run: int) -> Event | None:
        """What ended a run, if anything did."""
        return next((event for event in self.events if event.run == run), None)

    def extremes(self, name: str) -> tuple[FloatArray, FloatArray]:
        """Smallest and largest value of a signal in each run, (r,)."""
        values = self.of(name)
        return np.nanmin(values, axis=1), np.nanmax(values, axis=1)
