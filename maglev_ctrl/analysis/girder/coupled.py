"""A vehicle on girders that bend under it: one periodic linear system, from span to span.

Equal girders stand one behind another. The vehicle's state x and the modes g of the girders under it obey

    x' = A x + E_w w + E_v w',      w_i = r(s_i) - sum_n q_n sin(n pi s_i/L),      w_i' = d/dt w_i along v
    q_n'' + 2 zeta w_n q_n' + w_n^2 q_n = 2/(m L) sum over i of (P_i + dF_i) sin(n pi s_i / L)

with dF_i the change of the element's own lift (`contacts`). A girder is at rest when the front reaches it and is
forgotten when the rear has left it, so the map from one entry to the next acts on x and the girders still under the
vehicle; its eigenvalues are the Floquet multipliers, its fixed point the steady passage.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import linalg

from maglev_ctrl.analysis.girder.beam import Girder
from maglev_ctrl.analysis.girder.contacts import VehicleOnGuideway
from maglev_ctrl.analysis.girder.moving import MovingSystem, moving_system
from maglev_ctrl.analysis.girder.passage import PassageMap, by_collocation, by_runge_kutta
from maglev_ctrl.analysis.girder.shapes import PieceShape
from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only, read_only_any
from maglev_ctrl.errors import Agreement, NotStable

SAME: Final = 1e-7
"""Two integrations agree where their maps differ by less than this share."""


@dataclass(frozen=True, eq=False, slots=True)
class CoupledPassage:
    """A vehicle on bending girders at one speed (m/s), in the steady state that repeats itself with every span.

    `period` s from one entry to the next; `times` (k,) s and `values` (outputs, k) of `names` over it; `peaks`
    (outputs,) the largest moduli among them (twelve values per step). `life` (l,) s since the front entered a girder
    and `midspan` (l,) m its deflection downwards until the rear leaves, `deflection` the largest, `impact` that over
    the largest static one of the same loads. `multipliers` of the map from entry to entry, largest first;
    `growth_rate` 1/s; `stable` is None within the error. All but the multipliers are NaN or empty where the system is
    not stable. `difference` of the two integrations.
    """

    speed: float
    period: float
    names: tuple[str, ...]
    times: FloatArray
    values: FloatArray
    peaks: FloatArray
    life: FloatArray
    midspan: FloatArray
    deflection: float
    impact: float
    multipliers: ComplexArray
    growth_rate: float
    stable: bool | None
    difference: float
    agreement: Agreement
    reason: str


def coupled_passage(
    vehicle: VehicleOnGuideway,
    girder: Girder,
    *,
    speed: float,
    outputs: Sequence[str],
    shape: PieceShape | None = None,
    check: bool = True,
) -> CoupledPassage:
    """Stability and steady passage of a vehicle over girders that bend under it.

    Parameters
    ----------
    vehicle : see `contacts.vehicle_on_guideway`
    speed : m/s, that of the vehicle's operating point
    outputs : names of outputs or states
    shape : of the unloaded surface; see `moving_system`
    check : whether the map is integrated a second time by another method; without it nothing is called agreed

    Raises
    ------
    ValueError : see `moving_system`, or an unknown output

    Examples
    --------
    >>> from maglev_ctrl.analysis.girder.contacts import vehicle_on_guideway
    >>> from maglev_ctrl.vehicle import Body, OperatingPoint, SpringDamper, Vehicle
    >>> leg = SpringDamper("leg", "car", stiffness=1e6, damping=5e4)
    >>> cart = Vehicle("cart", bodies=(Body("car", 10e3),), connections=(leg,), reference_height=0.1)
    >>> bridge = Girder(20.0, bending_stiffness=4e9, mass_per_length=2e3, damping_ratio=0.02, modes=2)
    >>> found = coupled_passage(vehicle_on_guideway(cart, OperatingPoint(30.0, 0.1)), bridge, speed=30.0,
    ...                         outputs=["car.heave"])
    >>> found.stable, found.agreement.value, round(1e3 * found.deflection, 2)
    (True, 'AGREED', 4.52)
    """
    system = moving_system(vehicle, girder, speed=speed, shape=shape)
    names = tuple(outputs)
    C, _, D = vehicle.closed.output_rows(names)
    passage = by_collocation(system)
    kept = system.kept
    Psi, added = _advanced(passage.end, system)
    multipliers = linalg.eigvals(Psi) if kept else np.zeros(0)
    multipliers = multipliers[np.argsort(-np.abs(multipliers))]
    difference, reason = np.nan, "one integration only"
    if check:
        second = by_runge_kutta(system)
        if second is None:
            reason = "a second integration would take too long"
        else:
            difference = _difference(Psi, added, *_advanced(second, system))
            reason = "" if difference <= SAME else f"two integrations differ by {difference:.2g}"
    agreed = bool(difference <= SAME)
    radius = float(np.abs(multipliers[0])) if multipliers.size else 0.0
    uncertain = _uncertainty(Psi, difference if np.isfinite(difference) else SAME)
    stable = None if abs(radius - 1.0) <= uncertain or (check and not agreed) else radius < 1.0
    period = girder.span / speed
    growth = float(np.log(radius) / period) if radius > 0.0 else -np.inf
    shown = _steady(system, passage, Psi, added, C=C, D=D) if stable else None
    verdict = Agreement.AGREED if agreed else Agreement.UNRESOLVED
    if shown is None:
        blank, none = read_only_any(np.zeros(0)), read_only_any(np.zeros((len(names), 0)))
        nan = read_only_any(np.full(len(names), np.nan))
        word = "the system is not stable" if stable is False else "stability is within the error"
        return CoupledPassage(
            speed, period, names, blank, none, nan, blank, blank, np.nan, np.nan, read_only_any(multipliers), growth,
            stable, difference, verdict, reason or f"no steady passage: {word}",
        )  # fmt: skip
    times, values, life, midspan = shown
    largest = float(np.max(np.abs(midspan), initial=0.0))
    return CoupledPassage(
        speed, period, names, read_only(times, name="times"), read_only(values, name="values"),
        read_only(np.max(np.abs(values), axis=1, initial=0.0), name="peaks"), read_only(life, name="life"),
        read_only(midspan, name="midspan"), largest, largest / static_midspan(vehicle, girder),
        read_only_any(multipliers), growth, stable, difference, verdict, reason,
    )  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class EntryPassage:
    """A vehicle at rest on rigid track that drives onto bending girders: `peaks` (outputs, spans) and, by girder, the
    largest mid-span `deflection` (spans,) m while the front is on it.
    """

    names: tuple[str, ...]
    peaks: FloatArray
    deflection: FloatArray


def entry_passage(
    vehicle: VehicleOnGuideway, girder: Girder, *, speed: float, outputs: Sequence[str], spans: int
) -> EntryPassage:
    """The first spans of a bending guideway after rigid track, span by span.

    Parameters
    ----------
    spans : how many girders the front passes

    Raises
    ------
    ValueError : see `moving_system`, an unknown output, or no span
    """
    if spans < 1:
        raise ValueError(f"spans: expected at least one, got {spans}")
    names = tuple(outputs)
    C, _, D = vehicle.closed.output_rows(names)
    whole = moving_system(vehicle, girder, speed=speed)
    n, N = len(vehicle.closed.states), girder.modes
    state = np.zeros(whole.size)
    peaks, deflection = np.zeros((len(names), spans)), np.zeros(spans)
    passage: PassageMap | None = None
    for number in range(spans):
        stiff = max(whole.spans - 1 - number, 0)
        system = moving_system(vehicle, girder, speed=speed, rigid=stiff)
        if passage is None or stiff or number == whole.spans - 1:
            passage = by_collocation(system)
        _, values, girders, end = passage.run(system, state, C=C, D=D)
        peaks[:, number] = np.max(np.abs(values), axis=1, initial=0.0)
        middle = girder.shape(0.5 * girder.span)
        deflection[number] = float(np.max(np.abs(middle @ girders[:N])))
        state = np.concatenate([end[:n], np.zeros(2 * N), end[n : n + 2 * N * (whole.spans - 1)]])
    return EntryPassage(names, read_only(peaks, name="peaks"), read_only(deflection, name="deflection"))


def static_midspan(vehicle: VehicleOnGuideway, girder: Girder) -> float:
    """Largest mid-span deflection (m) of a girder under the vehicle's static loads, creeping over it; same modes."""
    ahead = vehicle.places - float(np.max(vehicle.places))
    length = -float(np.min(ahead))
    fronts = np.linspace(0.0, girder.span + length, 2001)
    push = np.einsum("i,kin->kn", vehicle.weight, girder.shape(fronts[:, None] + ahead))
    middle = girder.shape(0.5 * girder.span)
    return float(np.max(np.abs((girder.mobility * push / girder.frequencies**2) @ middle)))


def require_stable(found: CoupledPassage) -> CoupledPassage:
    """The passage, where it is stable.

    Raises
    ------
    NotStable : it is not, or that is not known
    """
    if not found.stable:
        raise NotStable(f"no steady passage at {found.speed:g} m/s: growth rate {found.growth_rate:.4g} 1/s")
    return found


def _advanced(end: FloatArray, system: MovingSystem) -> tuple[FloatArray, FloatArray]:
    """The map from one entry to the next over the states kept, and what the loads add."""
    n, fresh = len(system.vehicle.closed.states), 2 * system.girder.modes
    # At entry the newest girder is at rest: its columns play no part. At the end every girder is one older.
    columns = np.concatenate([np.arange(n), np.arange(n + fresh, system.size)])
    rows = np.concatenate([np.arange(n), np.arange(n, system.size - fresh)])
    return end[np.ix_(rows, columns)], end[rows, -1]


def _steady(
    system: MovingSystem, passage: PassageMap, Psi: FloatArray, added: FloatArray, *, C: FloatArray, D: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    n, N = len(system.vehicle.closed.states), system.girder.modes
    start = np.linalg.solve(np.eye(len(Psi)) - Psi, added)
    state = np.concatenate([start[:n], np.zeros(2 * N), start[n:]])
    times, values, girders, _ = passage.run(system, state, C=C, D=D)
    middle = system.girder.shape(0.5 * system.girder.span)
    period = system.girder.span / system.speed
    life = np.concatenate([times + j * period for j in range(system.spans)])
    midspan = np.concatenate([middle @ girders[2 * N * j : 2 * N * j + N] for j in range(system.spans)])
    # The oldest girder's life ends with the last contact that leaves it.
    last = (system.front - float(np.min(system.vehicle.places))) / system.speed + period
    under = life <= last * (1.0 + 1e-12)
    return times, values, life[under], midspan[under]


def _difference(Psi: FloatArray, added: FloatArray, other: FloatArray, other_added: FloatArray) -> float:
    """Largest difference of two maps, every row and column in units of its own size."""
    both = np.column_stack([Psi, added])
    again = np.column_stack([other, other_added])
    row = np.maximum(np.max(np.abs(both), axis=1, keepdims=True), 1e-300)
    return float(np.max(np.abs(both - again) / row, initial=0.0))


def _uncertainty(Psi: FloatArray, difference: float) -> float:
    """How far the largest multiplier may be off: difference of the maps times its condition."""
    if not len(Psi):
        return 0.0
    scale = np.maximum(np.max(np.abs(Psi), axis=1), 1e-300)
    balanced = Psi * scale / scale[:, None]
    s, left, right = linalg.eig(balanced, left=True, right=True)[:3]
    i = int(np.argmax(np.abs(s)))
    condition = 1.0 / max(float(abs(left[:, i].conj() @ right[:, i])), 1e-16)
    return float(10.0 * max(difference, 1e-13) * condition * np.linalg.norm(balanced, 2))
