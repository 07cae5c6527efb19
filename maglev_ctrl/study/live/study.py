"""The engine of the workbench page: one option at the values of its sliders, fast first, verified after."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from maglev_ctrl.analysis.modes import modes
from maglev_ctrl.analysis.tracking import ModeTracks
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import Verdict
from maglev_ctrl.scenario import Scenario
from maglev_ctrl.scenario.quantity_paths import DEPTH, SPEED, ScenarioQuantity
from maglev_ctrl.study.live.designed import FAULTS, Designed, designed
from maglev_ctrl.study.live.fast_map import fast_map
from maglev_ctrl.study.live.growth import Sizes
from maglev_ctrl.study.live.quantities import is_situation, sliders
from maglev_ctrl.study.live.records import LiveMap, LiveQuantity, LiveView
from maglev_ctrl.study.live.settle import settled
from maglev_ctrl.study.live.speeds import OverSpeed
from maglev_ctrl.study.live.text import scenario_text
from maglev_ctrl.study.live.tracks import live_tracks
from maglev_ctrl.study.situation import Situation

_PIXELS = 100  # speeds and depths of the map
_TRACKED = 61  # speeds of the tracks
_FEW = 31  # of them where each has to be assembled
_KEPT = 8  # designs, and places over speed, that are kept


class LiveStudy:
    """One option of a scenario, looked at live; keeps what it computed, for one thread at a time.

    Raises
    ------
    ModelError : no option of that name, forces that are not solved, no equilibrium at the design point, or no law
    OutOfDomain : the forces are not known at the design point

    Examples
    --------
    >>> from maglev_ctrl.scenario import load
    >>> study = LiveStudy(load("scenarios/periodic/girder_passing.toml"), "windings")
    >>> view = study.preview({"speed": 100.0})
    >>> view.speed, view.modes is not None, view.verdict.value
    (100.0, True, 'NOT EVALUATED')
    """

    def __init__(self, scenario: Scenario, option_name: str) -> None:
        self.scenario, self.option_name = scenario, option_name
        self._swept: dict[tuple[tuple[str, float], ...], _Swept] = {}
        self._sizes = Sizes()
        self._designs: dict[tuple[tuple[str, float], ...], Designed] = {}
        own = designed(scenario, option_name)
        self._designs[()] = own
        option = own.model.option
        assert option is not None
        depth = None if own.modulation is None else own.modulation.depth
        self._sliders = sliders(scenario, option, depth=depth)
        self._label = option.label or option.name

    def twin(self) -> LiveStudy:
        """Another study that knows all this one knows, for another thread."""
        other = copy(self)
        other._swept, other._sizes = dict(self._swept), Sizes(dict(self._sizes.known))
        other._designs = {key: made.twin() for key, made in self._designs.items()}
        return other

    def quantities(self) -> tuple[LiveQuantity, ...]:
        """The sliders with the scenario's own values."""
        return tuple(one.shown for one in self._sliders)

    def preview(self, values: Mapping[str, float]) -> LiveView:
        """The fast view at values (SI) by name, the scenario's own where one is missing; bad points say so in words.

        Raises
        ------
        ValueError : a name without a slider
        """
        return self._view(values, whole=True)

    def point(self, values: Mapping[str, float]) -> LiveView:
        """As `preview`, at the operating point alone: tracks and map only where they are known already."""
        return self._view(values, whole=False)

    def knows_sweep(self, values: Mapping[str, float]) -> bool:
        """Whether tracks and map at values (SI) by name are known already, so that `preview` is as fast as `point`.

        Raises
        ------
        ValueError : a name without a slider
        """
        return _still(self._chosen(values)) in self._swept

    @np.errstate(over="ignore", invalid="ignore", divide="ignore")  # growth beyond all numbers is told, not warned of
    def _view(self, values: Mapping[str, float], *, whole: bool) -> LiveView:
        started = time.perf_counter()
        chosen = self._chosen(values)
        situation, depth = self._situation(chosen)
        blank = self._blank(chosen, situation, depth)
        try:
            made = self._designed(chosen)
        except FAULTS as fault:
            return replace(blank, failure=f"{fault}", seconds=time.perf_counter() - started)
        blank = replace(blank, map_reason=made.map_reason, notes=made.notes)
        try:
            vehicle = made.vehicle(situation.payload)
            blank = replace(blank, vehicle=vehicle)
            system, balanced = made.closed(situation)
            found = modes(system)
        except FAULTS as fault:
            return replace(blank, failure=f"{fault}", seconds=time.perf_counter() - started)
        known = self._swept.get(_still(chosen), _Swept(None, None, "not asked for"))
        swept = self._sweep(made, chosen, situation) if whole else known
        return replace(
            blank, system=system, modes=found, tracks=swept.tracks, map=swept.map, map_reason=swept.reason,
            height=float(np.mean(balanced.magnet_heights)) if len(balanced.magnet_heights) else situation.height,
            verdict_words="Not settled yet.", seconds=time.perf_counter() - started,
        )  # fmt: skip

    def settle(self, view: LiveView, cancelled: Callable[[], bool] = lambda: False) -> LiveView:
        """The view with everything slow: the map checked and named, Floquet, margins, requirements, the verdict.

        Parameters
        ----------
        cancelled : asked between steps; the view comes back unchanged when it says yes
        """
        if view.settled or view.system is None:
            return view
        chosen = {one.name: one.value for one in view.values}
        situation, depth = self._situation(chosen)
        return settled(view, self._designed(chosen), situation, depth, cancelled)

    def scenario_text(self, values: Mapping[str, float]) -> str:
        """The scenario's text with values (SI) by name written into it, comments kept.

        Raises
        ------
        ValueError : a name without a slider
        ModelError : the new text would not be a valid scenario
        """
        chosen = self._chosen(values)
        return scenario_text(self.scenario, {
            one.quantity: chosen[one.shown.name] for one in self._sliders
            if chosen[one.shown.name] != one.shown.value
        })  # fmt: skip

    def _chosen(self, values: Mapping[str, float]) -> dict[str, float]:
        known = {one.shown.name for one in self._sliders}
        for name in values:
            if name not in known:
                raise ValueError(f'no slider "{name}"; there are {", ".join(sorted(known))}')
        return {one.shown.name: float(values.get(one.shown.name, one.shown.value)) for one in self._sliders}

    def _situation(self, chosen: Mapping[str, float]) -> tuple[Situation, float]:
        own = {one.shown.name: one.shown.value for one in self._sliders}
        moved = {name: value for name, value in chosen.items()
                 if is_situation(name) and name != DEPTH and (name != "payload" or value != own[name])}  # fmt: skip
        return replace(Situation.of_design(self.scenario), **moved), chosen.get(DEPTH, 0.0)

    def _changes(self, chosen: Mapping[str, float]) -> tuple[tuple[ScenarioQuantity, float], ...]:
        return tuple(
            (one.quantity, chosen[one.shown.name]) for one in self._sliders
            if not is_situation(one.shown.name) and chosen[one.shown.name] != one.shown.value
        )  # fmt: skip

    def _designed(self, chosen: Mapping[str, float]) -> Designed:
        """The option with its law at these values of the file, kept for a while."""
        changes = self._changes(chosen)
        key = tuple((quantity.name, value) for quantity, value in changes)
        if key not in self._designs:
            made = designed(self.scenario, self.option_name, changes)
            while len(self._designs) >= _KEPT:
                self._designs.pop(next(one for one in self._designs if one != ()))
            self._designs[key] = made
        return self._designs[key]

    def _blank(self, chosen: Mapping[str, float], situation: Situation, depth: float) -> LiveView:
        shown = tuple(replace(one.shown, value=chosen[one.shown.name]) for one in self._sliders)
        return LiveView(
            option=self.option_name, label=self._label, values=shown, speed=situation.speed, height=situation.height,
            depth=depth, vehicle=self._designs[()].vehicle(None), system=None, modes=None, tracks=None, map=None,
            map_reason="", floquet=None, margins=None, margins_reason="not computed yet", requirements=(),
            verdict=Verdict.NOT_EVALUATED, verdict_words="", failure="", notes=(), settled=False, seconds=0.0,
        )  # fmt: skip

    def _sweep(self, made: Designed, chosen: Mapping[str, float], situation: Situation) -> _Swept:
        """Tracks and map, which neither speed nor depth of the operating point change."""
        still = _still(chosen)
        if still not in self._swept:
            found = self._swept_at(made, situation)
            while len(self._swept) >= _KEPT:
                self._swept.pop(next(iter(self._swept)))
            self._swept[still] = found
        return self._swept[still]

    def _swept_at(self, made: Designed, situation: Situation) -> _Swept:
        slider = next(one.shown for one in self._sliders if one.shown.name == SPEED)
        try:
            over = OverSpeed(made, situation, slider.low, slider.high)
        except FAULTS as fault:
            return _Swept(None, None, f"{fault}")
        speeds = np.linspace(slider.low, slider.high, _TRACKED if over.smooth else _FEW)
        if not over.smooth:
            tracks, atlas = self._tracks(made, situation, over, speeds), self._map(made, over)
        else:
            # The map is products of matrices for the most part, and leaves this thread its time.
            with ThreadPoolExecutor(max_workers=1) as pool:
                drawing = pool.submit(copy_context().run, self._map, made, over)
                tracks = self._tracks(made, situation, over, speeds)
                atlas = drawing.result()
        return _Swept(tracks, *atlas)

    def _map(self, made: Designed, over: OverSpeed) -> tuple[LiveMap | None, str]:
        periodic = self.scenario.periodic
        if made.modulation is None or periodic is None:
            return None, made.map_reason
        speed = np.linspace(periodic.map.speed.first, periodic.map.speed.last, _PIXELS)
        depth = np.linspace(0.0, next(one.shown.high for one in self._sliders if one.shown.name == DEPTH), _PIXELS)
        try:
            return fast_map(made, over, speed, depth, self._sizes), ""
        except FAULTS as fault:
            return None, f"{fault}"

    def _tracks(
        self, made: Designed, situation: Situation, over: OverSpeed, speeds: FloatArray
    ) -> ModeTracks | None:  # fmt: skip
        loops = over.at(speeds)
        try:
            return live_tracks(
                loops.full[loops.answered], speeds[loops.answered], over.template,
                lambda speed: modes(made.closed(replace(situation, speed=speed))[0]),
            )  # fmt: skip
        except FAULTS:
            return None


def _still(chosen: Mapping[str, float]) -> tuple[tuple[str, float], ...]:
    """The values that tracks and map belong to."""
    return tuple((name, value) for name, value in chosen.items() if name not in (SPEED, DEPTH))


@dataclass(frozen=True, eq=False, slots=True)
class _Swept:
    """What is shown over speed, or why there is no map."""

    tracks: ModeTracks | None
    map: LiveMap | None
    reason: str
