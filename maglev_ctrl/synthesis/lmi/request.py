"""What a multi-objective synthesis is asked for: one objective, and bounds that must hold at every vertex."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import ModelError
from maglev_ctrl.synthesis.lmi.regions import Region
from maglev_ctrl.synthesis.neutral import hidden_modes
from maglev_ctrl.systems.plant import Plant

Objective = Literal["h2", "h_infinity", "decay", "gain", "feasible"]
OBJECTIVES: tuple[Objective, ...] = ("h2", "h_infinity", "decay", "gain", "feasible")


@dataclass(frozen=True, slots=True)
class Channel:
    """Which disturbances and which performance outputs a norm is taken between; empty means all."""

    disturbances: tuple[str, ...] = ()
    performance: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, slots=True)
class CommandLimits:
    """From any of the initial states, command j stays below `limits[j]` for ever (no disturbance).

    Either `initial_states` (k, n), corner states whose whole hull (with its mirror image) is meant, or `allowed` (n,),
    a bound on each state (zero: the state starts at rest).
    """

    limits: tuple[float, ...]
    initial_states: FloatArray | None = None
    allowed: FloatArray | None = None


@dataclass(frozen=True, eq=False, slots=True)
class MultiObjective:
    """One objective to make best, and bounds to respect, for one state feedback at all vertices.

    `h2_below` and `h_infinity_below` bounds on the norms of their channels; `decay_rate` (1/s) the least; `region` of
    all poles; `gain_below` bound on the spectral norm of K; `commands` limits from given initial states.
    """

    objective: Objective = "feasible"
    h2_below: float | None = None
    h_infinity_below: float | None = None
    decay_rate: float | None = None
    region: Region | None = None
    gain_below: float | None = None
    commands: CommandLimits | None = None
    h2_channel: Channel = field(default=Channel())
    h_infinity_channel: Channel = field(default=Channel())

    @property
    def has_h2(self) -> bool:
        """The H2 norm is wanted small."""
        return self.objective == "h2" or self.h2_below is not None

    @property
    def has_h_infinity(self) -> bool:
        """The H-infinity norm is wanted small."""
        return self.objective == "h_infinity" or self.h_infinity_below is not None


def requirements(request: MultiObjective) -> tuple[tuple[str, str], ...]:
    """The bounds of a request: name of the field and the bound in words.

    Examples
    --------
    >>> requirements(MultiObjective(decay_rate=5.0, gain_below=100.0))
    (('decay_rate', 'a decay rate of 5 1/s'), ('gain_below', 'a gain below 100'))
    """
    found: list[tuple[str, str]] = []
    if request.decay_rate is not None:
        found.append(("decay_rate", f"a decay rate of {request.decay_rate:g} 1/s"))
    if request.region is not None:
        found.append(("region", f"poles with {request.region.label}"))
    if request.h2_below is not None:
        found.append(("h2_below", f"an H2 norm below {request.h2_below:g}"))
    if request.h_infinity_below is not None:
        found.append(("h_infinity_below", f"an H-infinity norm below {request.h_infinity_below:g}"))
    if request.gain_below is not None:
        found.append(("gain_below", f"a gain below {request.gain_below:g}"))
    if request.commands is not None:
        found.append(("commands", f"commands below {', '.join(f'{one:g}' for one in request.commands.limits)}"))
    return tuple(found)


def only(request: MultiObjective, names: Sequence[str]) -> MultiObjective:
    """The request with the named bounds and no other, without an objective.

    Examples
    --------
    >>> only(MultiObjective("h2", decay_rate=1.0, gain_below=9.0), ["gain_below"]).decay_rate is None
    True
    """
    dropped = {name: None for name, _ in requirements(request) if name not in names}
    return replace(request, objective="feasible", **dropped)  # type: ignore[arg-type]


def check_request(plants: Sequence[Plant], request: MultiObjective) -> None:
    """Stop before any solve at what cannot be meant.

    Raises
    ------
    ValueError : no vertex, names that differ between vertices, a bound not positive, unknown names, wrong shapes
    ModelError : states that are not measured, a sampled plant, or a mode that grows and no command moves

    Examples
    --------
    >>> check_request([], MultiObjective())
    Traceback (most recent call last):
    ValueError: plants: expected at least one vertex, got none
    """
    if not plants:
        raise ValueError("plants: expected at least one vertex, got none")
    first = plants[0]
    for plant in plants[1:]:
        for key in ("states", "disturbances", "commands", "performance", "measured"):
            if getattr(plant, key) != getattr(first, key):
                raise ValueError(f"plants: expected the same {key} at every vertex; {plant.name!r} has other names")
    if request.objective not in OBJECTIVES:
        raise ValueError(f"objective: expected one of {', '.join(OBJECTIVES)}, got {request.objective!r}")
    for key in ("h2_below", "h_infinity_below", "decay_rate", "gain_below"):
        value = getattr(request, key)
        if value is not None and not (np.isfinite(value) and value > 0.0):
            raise ValueError(f"{key}: expected a positive number, got {value!r}")
    for key in ("h2", "h_infinity"):
        channel_indices(first, getattr(request, f"{key}_channel"), key)
    if request.commands is not None:
        _check_commands(first, request.commands)
    for plant in plants:
        _check_plant(plant, request)


def channel_indices(plant: Plant, channel: Channel, norm: str) -> tuple[list[int], list[int]]:
    """Columns of B1 and rows of C1 of a channel.

    Raises
    ------
    ValueError : a name is unknown or doubled

    Examples
    --------
    >>> plant = Plant.from_matrices([[1.0]], [[1.0, 2.0]], [[1.0]], [[1.0]])
    >>> channel_indices(plant, Channel(("w2",)), "h2")
    ([1], [0])
    """
    found: list[list[int]] = []
    for key in ("disturbances", "performance"):
        known: tuple[str, ...] = getattr(plant, key)
        wanted: tuple[str, ...] = getattr(channel, key) or known
        unknown = [name for name in wanted if name not in known]
        if unknown:
            raise ValueError(f"{norm}_channel: {unknown[0]!r} is not among the {key} {', '.join(known)}")
        if len(set(wanted)) != len(wanted):
            raise ValueError(f"{norm}_channel: expected different {key}, got {', '.join(wanted)}")
        found.append([known.index(name) for name in wanted])
    return found[0], found[1]


def _check_commands(plant: Plant, commands: CommandLimits) -> None:
    if len(commands.limits) != len(plant.commands) or not all(one > 0.0 for one in commands.limits):
        raise ValueError(f"limits: expected {len(plant.commands)} positive numbers, got {commands.limits}")
    if (commands.initial_states is None) == (commands.allowed is None):
        raise ValueError("commands: expected either initial_states or allowed")
    n = len(plant.states)
    if commands.initial_states is not None and np.shape(commands.initial_states)[1:] != (n,):
        raise ValueError(f"initial_states: expected shape (k, {n}), got {np.shape(commands.initial_states)}")
    if commands.allowed is not None:
        allowed = np.asarray(commands.allowed)
        if allowed.shape != (n,) or np.any(allowed < 0.0) or not np.any(allowed > 0.0):
            raise ValueError(f"allowed: expected {n} bounds, none negative and not all zero, got {commands.allowed}")


def _check_plant(plant: Plant, request: MultiObjective) -> None:
    if not plant.measures_states:
        raise ModelError(f"{plant.name}: state feedback needs every state measured (C2 = I, D21 = 0, D22 = 0)")
    if plant.dt is not None:
        raise ModelError(f"{plant.name}: this synthesis is for continuous plants; got one sampled every {plant.dt:g} s")
    shift = np.zeros_like(plant.A) if request.decay_rate is None else request.decay_rate * np.eye(len(plant.states))
    for mode in hidden_modes((plant.A + shift).T, plant.B2.T, plant.states):
        pole = mode.label if request.decay_rate is None else f"a mode of {', '.join(mode.states)}"
        slow = "" if request.decay_rate is None else f", which decays more slowly than {request.decay_rate:g} 1/s"
        raise ModelError(f"{plant.name}: the commands {', '.join(plant.commands)} cannot move {pole}{slow}")
    if request.has_h2:
        columns, rows = channel_indices(plant, request.h2_channel, "h2")
        if np.any(plant.D11[np.ix_(rows, columns)]):
            raise ModelError(f"{plant.name}: the H2 norm is infinite, D11 of its channel is not zero")
