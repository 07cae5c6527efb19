"""Structured output feedback: best of many starts, then proved."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from maglev_ctrl.analysis.hamiltonian import h_infinity_norm
from maglev_ctrl.errors import ModelError, NotStable, Status
from maglev_ctrl.proofs.claims import Claim
from maglev_ctrl.synthesis.result import Performance, Synthesis, proven, refused
from maglev_ctrl.synthesis.structured.certificates import claims_of, stability_claim
from maglev_ctrl.synthesis.structured.energy import energy_norm
from maglev_ctrl.synthesis.structured.feedthrough import no_feedthrough
from maglev_ctrl.synthesis.structured.fixed_modes import fixed_modes, why_fixed
from maglev_ctrl.synthesis.structured.objective import Limit, Objective, Quantity
from maglev_ctrl.synthesis.structured.search import LocalOptimum, StartTable, search
from maglev_ctrl.synthesis.structured.spectral import growth_rates
from maglev_ctrl.synthesis.structured.structure import Structure, check_fit
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant, closed_channel

LAW = "structured output feedback"
_WORDS: dict[Quantity, tuple[str, str]] = {
    "decay_rate": ("decay rate", "1/s"),
    "damping_ratio": ("least damping ratio", ""),
    "h2": ("H2 norm", ""),
    "h_infinity": ("H-infinity norm", ""),
}
_TRIED = 6


def structured_design(
    plants: Sequence[Plant],
    structure: Structure,
    *,
    objective: Quantity,
    limits: Sequence[Limit] = (),
    starts: int = 16,
    seed: int = 0,
    time_limit: float = 60.0,
) -> Synthesis:
    """The best law of a structure that many starts find, proved; one law for all plants (the worst plant counts).

    Parameters
    ----------
    plants : vertices or situations with the same measurements and commands
    objective : what is made as good as possible: "decay_rate" (1/s), "damping_ratio" (least), "h2" or "h_infinity"
    limits : bounds on other quantities that the law has to keep
    starts, seed, time_limit : see `local_optima`

    Raises
    ------
    ValueError : plants and structure do not fit

    Examples
    --------
    >>> plant = Plant.from_matrices([[0.0, 1.0], [-4.0, 0.0]], [[0], [1]], [[0], [1]], [[1, 0]], [[0, 1]])
    >>> design = structured_design([plant], Structure.full(plant), objective="decay_rate", starts=4)
    >>> np.round(design.controller.D, 3)
    array([[-4.]])
    """
    try:
        table = local_optima(
            plants, structure, objective=objective, limits=limits, starts=starts, seed=seed, time_limit=time_limit
        )
    except ModelError as fault:
        return refused(LAW, plants, Status.INFEASIBLE, str(fault))
    return design_from(plants, structure, table, limits=limits)


def local_optima(
    plants: Sequence[Plant],
    structure: Structure,
    *,
    objective: Quantity,
    limits: Sequence[Limit] = (),
    starts: int = 16,
    seed: int = 0,
    time_limit: float = 60.0,
) -> StartTable:
    """Local optima of the objective over a structure, from many starts, best first; nothing is proved yet.

    Parameters
    ----------
    starts : how many at most; fewer where several agree
    seed : of the random starts; the same seed gives the same table where time does not run out
    time_limit : s

    Raises
    ------
    ValueError : plants and structure do not fit, a limit or a number is out of range
    ModelError : a mode that is not stable cannot be moved by any law of the structure; the H2 norm is infinite
    """
    chosen = tuple(plants)
    check_fit(structure, chosen)
    if objective not in _WORDS:
        raise ValueError(f"objective: expected one of {', '.join(_WORDS)}, got {objective!r}")
    for limit in limits:
        if limit.quantity not in _WORDS or not (np.isfinite(limit.level) and limit.level > 0.0):
            raise ValueError(f"limits: expected a known quantity and a positive level, got {limit}")
    if not starts > 0 or not time_limit > 0.0:
        raise ValueError(f"starts, time_limit: expected positive numbers, got {starts} and {time_limit}")
    if objective == "h2" or any(limit.quantity == "h2" for limit in limits):
        structure = no_feedthrough(structure, chosen)
    for plant in chosen:
        for mode in fixed_modes(plant, structure, seed=seed):
            raise ModelError(why_fixed(plant, mode))
    with _quiet():
        return search(
            Objective.of(chosen, structure, objective, tuple(limits)), starts=starts, seed=seed, time_limit=time_limit
        )


def design_from(
    plants: Sequence[Plant], structure: Structure, table: StartTable, *, limits: Sequence[Limit] = ()
) -> Synthesis:
    """Prove the best law of a table; the next best where a proof fails.

    A law of very large gains may be the best and yet not provable in the precision of its own numbers.
    """
    chosen = tuple(plants)
    if not table.usable:
        return refused(LAW, chosen, _why(table), _resistance(chosen, structure, table))
    first: Synthesis | None = None
    for optimum in table.usable[:_TRIED]:
        with _quiet():
            design = _certified(chosen, structure, table, optimum, limits)
        if design.controllers:
            return design
        first = first or design
    assert first is not None
    return first


@contextmanager
def _quiet() -> Iterator[None]:
    """No warnings of overflow or conditioning: the search meets singular loops, and checks what it keeps."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore", RuntimeWarning)
        yield


def _certified(
    plants: tuple[Plant, ...],
    structure: Structure,
    table: StartTable,
    optimum: LocalOptimum,
    limits: Sequence[Limit],
) -> Synthesis:
    controller = structure.controller(optimum.gain, plants[0])
    found = {
        key: _recomputed(key, plants, controller) for key in {table.quantity, *(limit.quantity for limit in limits)}
    }
    rate = _recomputed("decay_rate", plants, controller)
    if not (rate > 0.0 and all(np.isfinite(value) for value in found.values())):
        return refused(
            LAW, plants, Status.NOT_VERIFIED, f"the loop of the start {optimum.start!r} is not found stable again"
        )
    name, unit = _WORDS[table.quantity]
    performance = [Performance(name, optimum.value, found[table.quantity], unit)]
    performance += [
        Performance(_WORDS[one.quantity][0], float("nan"), found[one.quantity], _WORDS[one.quantity][1])
        for one in limits
    ]
    notes = list(table.notes)
    if optimum is not table.usable[0]:
        notes.append(
            f"the best value found, {table.usable[0].value:.6g}, could not be proved; this is the best that could: the "
            f"start {optimum.start!r}, {optimum.value:.6g}"
        )
    try:
        claims: list[Claim] = [stability_claim(plants, controller)]
        claims += claims_of(table.quantity, plants, controller, found[table.quantity])
        for limit in limits:
            claims += claims_of(limit.quantity, plants, controller, found[limit.quantity], limit.level)
    except (ModelError, ValueError) as fault:
        return refused(LAW, plants, Status.NOT_VERIFIED, f"the law is kept back: {fault}")
    if plants[0].dt is not None and "damping_ratio" in found:
        notes.append("the damping ratio of a sampled loop is recomputed, not proved")
    return proven(LAW, plants, [controller], claims=claims, performance=performance, notes=notes)


def _recomputed(quantity: Quantity, plants: tuple[Plant, ...], controller: Controller) -> float:
    """The quantity of the worst plant by code that the search does not use."""
    values = []
    for plant in plants:
        channel = closed_channel(plant, controller)
        poles = np.linalg.eigvals(channel[0]).astype(complex)
        rates = growth_rates(poles, plant.dt)
        if quantity == "decay_rate":
            values.append(float(np.max(rates)))
        elif quantity == "damping_ratio":
            s = poles if plant.dt is None else np.log(np.where(poles == 0.0, 1e-300, poles)) / plant.dt
            values.append(float(np.max(s.real / np.maximum(np.abs(s), 1e-300))))
        elif np.max(rates) >= 0.0:
            values.append(np.inf)
        elif quantity == "h2":
            values.append(energy_norm(channel, plant.dt))
        else:
            try:
                values.append(h_infinity_norm(*channel, dt=plant.dt).lower)
            except NotStable:
                values.append(np.inf)
    return -max(values) if quantity in ("decay_rate", "damping_ratio") else max(values)


def _why(table: StartTable) -> Status:
    return Status.TIME_LIMIT if table.out_of_time else Status.ITERATION_LIMIT


def _resistance(plants: tuple[Plant, ...], structure: Structure, table: StartTable) -> str:
    """What stood in the way: the mode that stays unstable in the best loop, or the limits."""
    count = len(table.optima)
    stable = [one for one in table.optima if one.growth < 0.0]
    if stable:
        least = min(stable, key=lambda one: one.excess)
        return (
            f"none of {count} starts keeps the limits (seed {table.seed}); the closest misses one by "
            f"{least.excess:.3g} (relative for norms and damping); this does not prove that none exists"
        )
    best = min(table.optima, key=lambda one: one.growth)
    controller = structure.controller(best.gain, plants[0])
    worst, told = -np.inf, ""
    for plant in plants:
        A = closed_channel(plant, controller)[0]
        poles, right = np.linalg.eig(A)
        rates = growth_rates(poles.astype(complex), plant.dt)
        k = int(np.argmax(rates))
        if rates[k] > worst:
            names = (*plant.states, *controller.states)
            share = np.abs(right[:, k])
            strongest = [names[i] for i in np.argsort(-share)[:2] if share[i] > 0.3 * np.max(share)]
            pole = complex(poles[k])
            number = f"{pole.real:.3g}" if pole.imag == 0.0 else f"{pole.real:.3g} +- {abs(pole.imag):.3g}j"
            worst, told = float(rates[k]), f"the mode at {number} ({', '.join(strongest)}) of {plant.name}"
    return (
        f"no stabilising gain in {count} starts (seed {table.seed}); the best leaves {told} growing at "
        f"{best.growth:.3g} 1/s; this does not prove that none exists: "
        "try more starts, a law with states of its own, or another sensor"
    )
