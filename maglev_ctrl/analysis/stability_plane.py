"""Stability of periodic systems over any two parameters: bounded error, bounded memory, resumable, regions named.

The monodromy matrix is a Chebyshev series in both parameters on panels as large as its tails allow, compared with
integration at points that are no nodes; pixels are evaluated in rows over threads. Points are verified by Hill's method
in the frequency domain, and a panel with a point that disagrees is UNRESOLVED as a whole.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextvars import copy_context
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.analysis.floquet import floquet, scaled_coefficients
from maglev_ctrl.analysis.plane_cells import adaptive_rows
from maglev_ctrl.analysis.plane_estimate import MapEstimate, rough_estimate
from maglev_ctrl.analysis.plane_mean import growth_without_modulation
from maglev_ctrl.analysis.plane_panels import Panel, build_panels
from maglev_ctrl.analysis.plane_pixels import PanelPixels, direct_pixels
from maglev_ctrl.analysis.plane_records import (
    NO_ANSWER,
    UNRESOLVED,
    UNSTABLE,
    Coverage,
    MapAxis,
    MapStore,
    PeriodicFamily,
    StabilityPlane,
)
from maglev_ctrl.analysis.region_naming import HILL_AGREEMENT, check_points, hill_difference, name_regions
from maglev_ctrl.analysis.resonance import NO_RESONANCE, Resonance, state_modes
from maglev_ctrl.analysis.resonance_naming import MOSTLY, name_exponent
from maglev_ctrl.arrays import FloatArray, read_only, read_only_any
from maglev_ctrl.errors import Agreement, ModelError, OutOfDomain
from maglev_ctrl.kernels.radius_engines import radius_engine
from maglev_ctrl.kernels.spectral_radius import RadiusEngine, leading_eigenvalues

__all__ = ["Backend", "MapEstimate", "NothingKept", "estimate", "stability_plane"]

Backend = Literal["numpy", "fast", "gpu"]
MANY_PIXELS = 300_000  # above this many pixels the coverage "auto" computes only those that matter
_CHUNK = 16_384  # pixels of one row chunk
_DIRECT_CHUNK = 512
_STRIP = 33  # rows of one strip where not every pixel is computed
_MOST_FAULTS = 20

Progress = Callable[[str, float], None]


@dataclass(frozen=True, eq=False, slots=True)
class _Job:
    """Rows of one panel (counted from the panel's first row)."""

    panel: Panel
    first: int
    last: int

    @property
    def name(self) -> str:
        return f"{self.panel.rectangle.name}-{self.first}-{self.last}"


class NothingKept:
    """A store that keeps nothing."""

    def get(self, key: str) -> Mapping[str, FloatArray] | None:
        """Nothing."""

    def put(self, key: str, arrays: Mapping[str, FloatArray]) -> None:
        """Forget."""


@np.errstate(over="ignore", invalid="ignore", divide="ignore")  # growth beyond all numbers: judged UNRESOLVED, not said
def stability_plane(
    family: PeriodicFamily, x: MapAxis, y: MapAxis, *, coverage: Coverage = "auto", threads: int = 1,
    backend: Backend = "numpy", states: tuple[str, ...] = (), labels: tuple[str, ...] | None = None, checks: int = 24,
    progress: Progress | None = None, store: MapStore | None = None,
) -> StabilityPlane:  # fmt: skip
    """Stability of a family of periodic systems at every pair of `x` and `y`.

    Parameters
    ----------
    family : the system at (x, y), called from one thread only
    x, y : the axes
    coverage : "every" computes each pixel, "adaptive" fills in between computed ones of one state where no resonance
        can hide, "auto" chooses by the number of pixels
    threads : threads that evaluate pixels
    backend : engine for the multipliers
    states, labels : names for the modes, see `state_modes`; the family's own states when left out
    checks : points compared with Hill's method
    progress : told what is being done and the share that is done
    store : finished parts are kept there and not computed again

    Raises
    ------
    ModelError : the backend is not there
    ValueError : an axis that does not ascend, a coverage that is unknown

    Examples
    --------
    >>> from maglev_ctrl.systems import PeriodicSystem
    >>> def mathieu(W, depth):
    ...     return PeriodicSystem.from_matrices([[0, 1], [-1, -0.02]], [[[0, 0], [-depth, 0]]], frequency=W)
    >>> plane = stability_plane(mathieu, MapAxis("frequency", np.linspace(1.5, 2.5, 21), reciprocal=True),
    ...                         MapAxis("depth", np.linspace(0.0, 0.2, 11), linear=True))
    >>> [t.name for t in plane.tongues], plane.state[10].tolist()
    (['2 w1/1'], [-1, -1, -1, 1, 1, 1, 1, 1, 1, 1, 1])
    """
    _check(x, y, coverage)
    if x.linear and not y.linear:
        return _transposed(
            stability_plane(
                lambda a, b: family(b, a), y, x, coverage=coverage, threads=threads, backend=backend, states=states,
                labels=labels, checks=checks, progress=progress, store=store,
            )
        )  # fmt: skip
    engine = radius_engine(backend)
    kept: MapStore = NothingKept() if store is None else store
    adaptive = coverage == "adaptive" or (coverage == "auto" and len(x.values) * len(y.values) > MANY_PIXELS)
    canvas = _Canvas(
        family, x, y, engine, adaptive=adaptive, store=kept, progress=progress or (lambda text, done: None)
    )
    canvas.fill(threads)
    return canvas.finished(states, labels, checks)


def estimate(
    family: PeriodicFamily, x: MapAxis, y: MapAxis, *, coverage: Coverage = "auto", threads: int = 1,
    backend: Backend = "numpy",
) -> MapEstimate:  # fmt: skip
    """What `stability_plane` with the same arguments will cost; takes a small part of a second.

    Raises
    ------
    ModelError : the backend is not there
    ValueError : an axis that does not ascend, a coverage that is unknown
    """
    _check(x, y, coverage)
    return rough_estimate(
        family, x, y, adaptive=_adaptive(coverage, x, y), threads=threads, engine=radius_engine(backend)
    )


def _adaptive(coverage: Coverage, x: MapAxis, y: MapAxis) -> bool:
    return coverage == "adaptive" or (coverage == "auto" and len(x.values) * len(y.values) > MANY_PIXELS)


def _check(x: MapAxis, y: MapAxis, coverage: str) -> None:
    for axis in (x, y):
        values = read_only(axis.values, name=axis.name, shape=(None,))
        if values.ndim != 1 or len(values) == 0 or np.any(np.diff(values) <= 0.0):
            raise ValueError(f"{axis.name}: expected ascending values")
        if axis.reciprocal and values[0] <= 0.0:
            raise ValueError(f"{axis.name}: expected positive values, got {values[0]:g}")
    if coverage not in ("auto", "every", "adaptive"):
        raise ValueError(f"coverage: expected auto, every or adaptive, got {coverage!r}")


class _Canvas:
    """A map in the making."""

    def __init__(
        self, family: PeriodicFamily, x: MapAxis, y: MapAxis, engine: RadiusEngine, *, adaptive: bool, store: MapStore,
        progress: Progress,
    ) -> None:  # fmt: skip
        self.family, self.x, self.y, self.engine = family, x, y, engine
        self.adaptive, self.store, self.progress = adaptive, store, progress
        shape = len(x.values), len(y.values)
        self.growth, self.error = np.full(shape, np.nan), np.full(shape, np.nan)
        self.state = np.full(shape, NO_ANSWER, dtype=np.int8)
        self.interpolated = np.zeros(shape, dtype=np.bool_)
        self.panels: list[Panel] = []
        self.faults: dict[str, None] = {}
        self.evaluated = self.integrated = self.done = 0
        mark = hashlib.sha256(repr((x.name, x.reciprocal, x.linear, y.name, y.reciprocal, y.linear)).encode())
        mark.update(np.ascontiguousarray(x.values).tobytes() + np.ascontiguousarray(y.values).tobytes())
        self.prefix = mark.hexdigest()[:16]
        self.mode = f"{self.prefix}-{'adaptive' if adaptive else 'every'}-{engine.name}"

    def fill(self, threads: int) -> None:
        """Compute all pixels, or take them from the store."""
        total = self.growth.size
        running: dict[Future[dict[str, FloatArray]], _Job] = {}
        with ThreadPoolExecutor(max_workers=max(1, threads)) as pool:
            try:
                for job in self._jobs():
                    key = f"{self.mode}-{job.name}"
                    kept = self.store.get(key)
                    if kept is not None:
                        self._paint(job, kept)
                    elif threads <= 1 or job.panel.series is None:
                        self._finish(job, self._computed(job))
                    else:
                        running[pool.submit(copy_context().run, self._computed, job)] = job
                    while len(running) >= 2 * threads:
                        self._collect(running)
                    self.progress("stability map", self.done / total)
                while running:
                    self._collect(running)
                    self.progress("stability map", self.done / total)
            except BaseException:
                for future in running:
                    future.cancel()
                raise

    def _collect(self, running: dict[Future[dict[str, FloatArray]], _Job]) -> None:
        done, _ = wait(running, return_when=FIRST_COMPLETED)
        for future in done:
            self._finish(running.pop(future), future.result())

    def _finish(self, job: _Job, arrays: dict[str, FloatArray]) -> None:
        self.store.put(f"{self.mode}-{job.name}", arrays)
        self._paint(job, arrays)

    def _jobs(self) -> Iterator[_Job]:
        self.progress("integration over one period", 0.0)
        for panel in build_panels(self.family, self.x, self.y, store=self.store, prefix=self.prefix):
            self.panels.append(panel)
            self.integrated += panel.integrated
            place = panel.rectangle
            rows, columns = place.last_row - place.first_row, place.last_column - place.first_column
            if panel.series is None:
                step = max(1, _DIRECT_CHUNK // columns)
            else:
                step = _STRIP if self.adaptive else max(1, _CHUNK // columns)
            for first in range(0, rows, step):
                yield _Job(panel, first, min(first + step, rows))

    def _computed(self, job: _Job) -> dict[str, FloatArray]:
        place = job.panel.rectangle
        x = self.x.values[place.first_row : place.last_row]
        y = self.y.values[place.first_column : place.last_column]
        if job.panel.series is None:
            i, j = np.meshgrid(x[job.first : job.last], y, indexing="ij")
            found, _ = direct_pixels(self.family, i.ravel(), j.ravel())
            numbers = np.array([float(i.size), float(found.integrated)])
            text = np.frombuffer("\n".join(found.faults).encode(), dtype=np.uint8).astype(np.float64)
            return {
                "growth": found.growth.reshape(i.shape), "error": found.error.reshape(i.shape),
                "state": found.state.reshape(i.shape).astype(np.float64), "interpolated": np.zeros(i.shape),
                "numbers": numbers, "faults": text,
            }  # fmt: skip
        pixels = PanelPixels(job.panel, x, y, self.engine)
        if self.adaptive:
            share = np.abs(y) / np.max(np.abs(y)) if self.y.linear and np.any(y) else np.ones(len(y))
            cells = adaptive_rows(pixels, job.first, job.last, strength=job.panel.strength * share)
            return {
                "growth": cells.growth, "error": cells.error, "state": cells.state.astype(np.float64),
                "interpolated": cells.interpolated.astype(np.float64),
                "numbers": np.array([float(cells.evaluated), 0.0]), "faults": np.empty(0),
            }  # fmt: skip
        rows, _ = pixels.rows(job.first, job.last)
        return {
            "growth": rows.growth, "error": rows.error, "state": rows.state.astype(np.float64),
            "interpolated": np.zeros(rows.growth.shape), "numbers": np.array([float(rows.growth.size), 0.0]),
            "faults": np.empty(0),
        }  # fmt: skip

    def _paint(self, job: _Job, arrays: Mapping[str, FloatArray]) -> None:
        place = job.panel.rectangle
        part = (slice(place.first_row + job.first, place.first_row + job.last),
                slice(place.first_column, place.last_column))  # fmt: skip
        self.growth[part], self.error[part] = arrays["growth"], arrays["error"]
        self.state[part] = arrays["state"].astype(np.int8)
        self.interpolated[part] = arrays["interpolated"] > 0.5
        self.evaluated += int(arrays["numbers"][0])
        self.integrated += int(arrays["numbers"][1])
        text = arrays["faults"].astype(np.uint8).tobytes().decode()
        if text:
            self.faults.update(dict.fromkeys(text.split("\n")))
        self.done += arrays["growth"].size

    def finished(self, states: tuple[str, ...], labels: tuple[str, ...] | None, checks: int) -> StabilityPlane:
        """The map verified and named."""
        points, difference = self._verify(checks)
        unstable = self.state == UNSTABLE
        self.progress("names of the unstable regions", 1.0)
        index, tongues = self._named(unstable, states, labels)
        direct = sum(p.rectangle.pixels for p in self.panels if p.series is None)
        series = sum(p.series is not None for p in self.panels)
        steps = np.diff(self.x.values)
        width = float(np.max(steps)) * (2.0 if self.adaptive else 1.0) if len(steps) else float("nan")
        return StabilityPlane(
            x=self.x, y=self.y, growth=read_only_any(self.growth), growth_error=read_only_any(self.error),
            state=read_only_any(self.state), interpolated=read_only_any(self.interpolated),
            tongue_index=read_only_any(index.astype(np.int16)), tongues=tongues, checked=read_only_any(points),
            check_difference=read_only_any(difference), faults=tuple(self.faults)[:_MOST_FAULTS],
            evaluated=self.evaluated, integrated=self.integrated, missed_width=width,
            method=f"Taylor propagators, Chebyshev series on {series} panel{'s' * (series != 1)}, {direct} points "
                   f"integrated one by one, {len(points)} points checked by Hill's method",
        )  # fmt: skip

    def _named(
        self, unstable: NDArray[np.bool_], states: tuple[str, ...], labels: tuple[str, ...] | None
    ) -> tuple[NDArray[np.int64], tuple[Resonance, ...]]:
        """Names of the unstable points; what grows for the most part without modulation is no tongue."""
        own = growth_without_modulation(self.family, self.x, self.y, unstable)
        alone = unstable & (own > 0.0) & (self.growth < MOSTLY * own)
        index, tongues = name_regions(self.growth, unstable & ~alone, lambda i, j: self._name(i, j, states, labels))
        if np.any(alone):
            names = [one.name for one in tongues]
            if NO_RESONANCE.name not in names:
                names, tongues = [*names, NO_RESONANCE.name], (*tongues, NO_RESONANCE)
            index[alone] = names.index(NO_RESONANCE.name)
        return index, tongues

    def _verify(self, checks: int) -> tuple[NDArray[np.int64], FloatArray]:
        """Compare points with Hill's method; a panel with a point that disagrees is unresolved as a whole."""
        answered = np.isfinite(self.growth)
        if not np.any(answered) or checks <= 0:
            return np.empty((0, 2), dtype=np.int64), np.empty(0)
        low = np.where(answered, self.growth, -np.inf)
        points = check_points(low, self.state == UNSTABLE, checks)
        points = points[answered[points[:, 0], points[:, 1]]]
        difference = np.empty(len(points))
        for k, (i, j) in enumerate(points):
            self.progress("comparison with Hill's method", 1.0)
            panel = self._panel_at(int(i), int(j))
            difference[k], allowed = self._difference(panel, int(i), int(j))
            if not difference[k] <= allowed:
                place = panel.rectangle
                part = self.state[place.first_row : place.last_row, place.first_column : place.last_column]
                part[part != NO_ANSWER] = UNRESOLVED
        return points, difference

    def _difference(self, panel: Panel, i: int, j: int) -> tuple[float, float]:
        """Distance of the map's exponent at a pixel from Hill's, and what is allowed, 1/s."""
        try:
            system = self.family(float(self.x.values[i]), float(self.y.values[j]))
        except (ModelError, OutOfDomain) as fault:
            self.faults[str(fault)] = None
            return float("inf"), 0.0
        multiplier = self._multiplier(panel, i, j)
        W = float(system.frequency)
        A_0, A_cos, A_sin = scaled_coefficients(system.A_0, system.A_cos, system.A_sin)
        apart = hill_difference(A_0, A_cos, A_sin, frequency=W, multiplier=multiplier)
        growth = float(np.log(abs(multiplier))) * W / (2.0 * np.pi)
        if not apart <= HILL_AGREEMENT * W:
            # a few harmonics may be too few for Hill's method, or it may lose digits to a stiff model
            decided = floquet(system)
            if decided.agreement is Agreement.AGREED:
                apart = max(abs(decided.growth_rate - growth) - decided.growth_error, 0.0)
        if not self.interpolated[i, j]:
            apart = max(apart, abs(growth - self.growth[i, j]))
        return apart, HILL_AGREEMENT * W

    def _multiplier(self, panel: Panel, i: int, j: int) -> complex:
        """Leading multiplier as the map has it."""
        x, y = self.x.values[i : i + 1], self.y.values[j : j + 1]
        if panel.series is not None:
            return complex(leading_eigenvalues(panel.series.points(x, y))[0])
        return complex(direct_pixels(self.family, x, y)[1][0])

    def _panel_at(self, i: int, j: int) -> Panel:
        for panel in self.panels:
            place = panel.rectangle
            if place.first_row <= i < place.last_row and place.first_column <= j < place.last_column:
                return panel
        raise AssertionError("every pixel belongs to a panel")

    def _name(self, i: int, j: int, states: tuple[str, ...], labels: tuple[str, ...] | None) -> Resonance:
        """The resonance behind the leading multiplier at a pixel."""
        system = self.family(float(self.x.values[i]), float(self.y.values[j]))
        A_0, A_cos, A_sin = scaled_coefficients(system.A_0, system.A_cos, system.A_sin)
        W = float(system.frequency)
        exponent = complex(np.log(self._multiplier(self._panel_at(i, j), i, j)) * W / (2.0 * np.pi))
        modes = state_modes(A_0, states=states or system.states, labels=labels)
        return name_exponent(A_0, A_cos, A_sin, frequency=W, exponent=exponent, modes=modes)


def _transposed(plane: StabilityPlane) -> StabilityPlane:
    """The same map with its axes exchanged."""
    steps = np.diff(plane.y.values)
    before = np.diff(plane.x.values)
    factor = plane.missed_width / float(np.max(before)) if len(before) else 1.0
    return replace(
        plane, x=plane.y, y=plane.x, growth=plane.growth.T, growth_error=plane.growth_error.T, state=plane.state.T,
        interpolated=plane.interpolated.T, tongue_index=plane.tongue_index.T,
        checked=read_only_any(plane.checked[:, ::-1]),
        missed_width=factor * float(np.max(steps)) if len(steps) else float("nan"),
    )  # fmt: skip
