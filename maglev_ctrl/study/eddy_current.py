"""Eddy-current forces of a scenario: solved once, kept on disk, put into the scenario for every study of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import pi
from typing import TYPE_CHECKING, Final

from maglev_ctrl.errors import ModelError
from maglev_ctrl.fields.spread import Progress
from maglev_ctrl.scenario import Scenario, with_solved_force
from maglev_ctrl.scenario.eddy_current import coils_of, domain_of, section_of
from maglev_ctrl.scenario.guideway_schema import EddyCurrentForces
from maglev_ctrl.scenario.layout import layout
from maglev_ctrl.study.spread import spread_over

if TYPE_CHECKING:  # finite elements take time to load, and most studies do without
    from maglev_ctrl.forces.eddy_current import Accuracy, EddyCurrentForce
    from maglev_ctrl.forces.force_map import ForceMap

FREQUENCY: Final = 10.0 * 2.0 * pi
"""Highest frequency of the magnets' own motion that guideways are solved for, rad/s."""
MAP_TOLERANCE: Final[dict[str, float]] = {"draft": 1e-2, "standard": 5e-3, "reference": 2e-3}
_SOLVING: Final = 0.7
"""Share of the time that solving takes; mapping takes the rest."""

Tell = Callable[[str, float], None]


@dataclass(frozen=True, eq=False, slots=True)
class SolvedMagnet:
    """Forces of one magnet with the currents of the file: exact, and as a map of them."""

    exact: EddyCurrentForce
    map: ForceMap
    key: str

    def error(self) -> float:
        """Estimated error of the exact forces, relative, found by solving some wavenumbers again, finer."""
        from maglev_ctrl.study.force_cache import keep_error, kept_error

        error = kept_error(self.key)
        if error is None:
            error = self.exact.refinement()
            keep_error(self.key, error)
        return error


def solve_forces(scenario: Scenario, *, jobs: int = 1, progress: Tell | None = None) -> Scenario:
    """The scenario with its eddy-current forces in it; scenarios of other force models come back as they are.

    Forces found before are taken from the cache on disk (see `force_cache.cache_folder`).

    Parameters
    ----------
    jobs : processes; with more than one, call from under `if __name__ == "__main__":` as for any process pool
    progress : told what is done and the fraction of it, 0 to 1

    Raises
    ------
    ModelError : the guideway cannot be solved, or the processes cannot start

    Examples
    --------
    >>> from maglev_ctrl.scenario import build_vehicle, load
    >>> scenario = solve_forces(load("scenarios/paper/double_l.toml"))        # doctest: +SKIP
    >>> build_vehicle(scenario).magnets[0].force.forces(0.015, 0.0127, 36.1)  # doctest: +SKIP
    """
    if not isinstance(scenario.forces, EddyCurrentForces) or scenario.solved_force is not None:
        return scenario
    from maglev_ctrl.study.force_cache import kept_map

    key, accuracy = _key(scenario, scenario.forces.accuracy), scenario.forces.accuracy
    found = kept_map(key)
    if found is None:
        found = solved_magnet(scenario, accuracy=accuracy, jobs=jobs, progress=progress).map
    return with_solved_force(scenario, found)


def solved_magnet(
    scenario: Scenario, *, accuracy: Accuracy | None = None, jobs: int = 1, progress: Tell | None = None
) -> SolvedMagnet:
    """The magnet of an eddy-current scenario with what takes its exact forces; from the cache where it is there.

    Parameters
    ----------
    accuracy : None = the scenario's

    Raises
    ------
    ModelError : the guideway cannot be solved, or the processes cannot start
    """
    from maglev_ctrl.forces.eddy_current import FINENESS, EddyCurrentForce
    from maglev_ctrl.study.force_cache import keep_map, keep_response, kept_map, kept_response

    forces = scenario.forces
    assert isinstance(forces, EddyCurrentForces)
    accuracy, tell = accuracy or forces.accuracy, progress or (lambda what, fraction: None)
    key = _key(scenario, accuracy)
    section, coils = section_of(forces.guideway), coils_of(forces)
    domain, spread = domain_of(scenario, layout(scenario.vehicle)), spread_over(jobs)
    response = kept_response(key)
    if response is not None:
        exact = EddyCurrentForce(section, coils, response, FINENESS[accuracy], domain=domain)
    else:
        try:
            exact = EddyCurrentForce.solve(
                section, coils, height=domain.height, gap=domain.gap, speed=domain.speed, frequency=FREQUENCY,
                accuracy=accuracy, spread=spread, progress=_part(tell, "currents in the guideway", 0.0, _SOLVING),
            )  # fmt: skip
        except ValueError as error:
            raise ModelError(f"the guideway cannot be solved: {error}") from None
        keep_response(key, exact.response)
    found = kept_map(key)
    if found is None:
        tolerance = MAP_TOLERANCE[accuracy]
        found = exact.map(tolerance=tolerance, spread=spread, progress=_part(tell, "map of the forces", _SOLVING, 1.0))
        keep_map(key, found)
    return SolvedMagnet(exact, found, key)


def _key(scenario: Scenario, accuracy: Accuracy) -> str:
    from maglev_ctrl.study.force_cache import cache_key

    forces = scenario.forces
    assert isinstance(forces, EddyCurrentForces)
    return cache_key(
        section_of(forces.guideway), coils_of(forces), domain_of(scenario, layout(scenario.vehicle)),
        accuracy=accuracy, frequency=FREQUENCY, tolerance=MAP_TOLERANCE[accuracy],
    )  # fmt: skip


def _part(tell: Tell, what: str, start: float, stop: float) -> Progress:
    """Progress of a part of the work; never backwards, a map may take several attempts."""
    reached = start

    def told(fraction: float) -> None:
        nonlocal reached
        reached = max(reached, start + (stop - start) * fraction)
        tell(what, reached)

    return told
