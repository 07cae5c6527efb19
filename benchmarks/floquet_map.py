"""Cost of a stability map per point against general-purpose integrators, at equal accuracy.

Ours: `stability_plane` over 200 speeds and 200 depths, with growth rates, their error bounds and names of the unstable
regions; with NumPy alone, with the `fast` extra, with two threads, on a GPU where there is one, and once for the
verdict stable or unstable only. Theirs, at a few points of the same map, eigenvalues included: scipy's DOP853 on the
matrix differential equation, scipy's RK45 called for one basis vector after the other, and diffrax's Dopri8 over a
batch, at rtol 1e-9. Every leading multiplier is compared with one at rtol 1e-12 and has to be right to 1e-8.

On these maps the leading multiplier belongs to the slowest mode while the fastest one sets the steps, so rtol 1e-9
gives it far more digits than asked for. The row "loosest that suffices" is DOP853 at the largest power of ten whose
multiplier is right to 1e-8 at every sample: the comparison least kind to us. Ratios are to DOP853 at rtol 1e-9, and in
the column after it to the loosest one.

Every method is timed alike: CPU time, the least of the same number of runs, and DOP853 before and after the others. A
busy machine still slows the interpreter-bound scipy runs more than ours, up to twice: quote ratios of an idle one only.
Rows that say so are wall-clock time and mean nothing on a busy machine. Compiling is told, not counted. Run with one
BLAS thread:

    OPENBLAS_NUM_THREADS=1 python benchmarks/floquet_map.py [states ...]
"""

from __future__ import annotations

import importlib.util
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal, TypeVar

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.integrate import solve_ivp

from maglev_ctrl.analysis.plane_panels import Panel, build_panels
from maglev_ctrl.analysis.plane_records import MapAxis
from maglev_ctrl.analysis.stability_plane import NothingKept, stability_plane
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import ModelError
from maglev_ctrl.kernels.radius_engines import radius_engine
from maglev_ctrl.kernels.spectral_radius import leading_eigenvalues
from maglev_ctrl.systems import PeriodicSystem

Clock = Callable[[], float]
Result = TypeVar("Result")

SIZES = (4, 6, 12, 20)
SPEEDS, DEPTHS = 200, 200
WAVELENGTH = 25.0
SAMPLES = 6
SLOW_SAMPLES = 2
BATCH = 512
REPEATS = 5
LARGEST_ERROR = 1e-8
LOOSER = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
MARGIN = 1e-9  # a radius nearer to one than this is left undecided
TARGETS = {"numpy": (500, 250, 100, 40), "fast": (1000, 400, 130, 50), "decide": (4000, 2000, 600, 200)}


def system(n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A chain of n/2 damped masses (1 to 8 Hz), the stiffness of the outer ones modulated with a phase between them."""
    half = n // 2
    frequency = 2.0 * np.pi * np.linspace(1.0, 8.0, half)
    coupling = 0.1 * np.diag(frequency[1:] * frequency[:-1], 1) if half > 1 else np.zeros((half, half))
    stiffness = np.diag(frequency**2) - coupling - coupling.T
    A_0 = np.zeros((n, n))
    A_0[:half, half:] = np.eye(half)
    A_0[half:, :half], A_0[half:, half:] = -stiffness, -np.diag(0.04 * frequency)
    cosine, sine = np.zeros((1, n, n)), np.zeros((1, n, n))
    for mass, angle in ((0, 0.0), (half - 1, 0.9)):
        cosine[0, half + mass, mass] -= frequency[mass] ** 2 * np.cos(angle)
        sine[0, half + mass, mass] -= frequency[mass] ** 2 * np.sin(angle)
    return A_0, cosine, sine


@dataclass
class Row:
    """One method: time per point in s and largest relative error of the leading multiplier at the samples."""

    name: str
    seconds: float
    error: float
    target: int | None = None


@dataclass
class Map:
    """The map of one system, and the exact leading multipliers at sample points."""

    n: int
    x: MapAxis = field(init=False)
    y: MapAxis = field(init=False)
    samples: list[tuple[int, int]] = field(init=False)
    exact: list[complex] = field(init=False)
    notes: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.A_0, self.cosine, self.sine = system(self.n)
        self.x = MapAxis("speed", np.linspace(20.0, 150.0, SPEEDS), reciprocal=True)
        self.y = MapAxis("depth", np.linspace(0.0, 0.4, DEPTHS), linear=True)
        self.samples = [
            (int((k + 0.5) / SAMPLES * SPEEDS), int(((k + 1) * 0.618 % 1.0) * DEPTHS)) for k in range(SAMPLES)
        ]
        self.exact = [self.integrated(i, j, rtol=1e-12) for i, j in self.samples]

    def family(self, speed: float, depth: float) -> PeriodicSystem:
        """The periodic system at a speed and a depth."""
        frequency = 2.0 * np.pi * speed / WAVELENGTH
        return PeriodicSystem.from_matrices(self.A_0, depth * self.cosine, depth * self.sine, frequency=frequency)

    def integrated(self, i: int, j: int, *, rtol: float, method: str = "DOP853", each: bool = False) -> complex:
        """Leading multiplier by scipy over one period, as one matrix equation or one basis vector after the other."""
        n, depth = self.n, float(self.y.values[j])
        cosine, sine = depth * self.cosine[0], depth * self.sine[0]
        frequency = 2.0 * np.pi * float(self.x.values[i]) / WAVELENGTH

        def rate(t: float, x: FloatArray) -> FloatArray:
            A = self.A_0 + cosine * np.cos(frequency * t) + sine * np.sin(frequency * t)
            return np.asarray((A @ x.reshape(n, -1)).ravel())

        starts = list(np.eye(n)) if each else [np.eye(n).ravel()]
        ends = [
            solve_ivp(rate, (0.0, 2 * np.pi / frequency), x, method=method, rtol=rtol, atol=1e-3 * rtol).y[:, -1]
            for x in starts
        ]
        matrix = np.stack(ends, axis=1) if each else ends[0].reshape(n, n)
        return complex(leading_eigenvalues(matrix[None])[0])

    def theirs(self, name: str, *, method: str, each: bool, count: int, rtol: float = 1e-9) -> Row:
        """A scipy integrator at the samples."""
        places = self.samples[:count]
        runs = [timed(time.process_time, lambda i=i, j=j: self.integrated(i, j, rtol=rtol, method=method, each=each))
                for i, j in places]  # fmt: skip
        error = max(apart(found, exact) for (_, found), exact in zip(runs, self.exact, strict=False))
        return Row(name, sum(seconds for seconds, _ in runs) / count, error)

    def loosest(self) -> Row:
        """DOP853 at the loosest tolerance whose multipliers are right at all samples."""
        for rtol in LOOSER:
            found = [self.integrated(i, j, rtol=rtol) for i, j in self.samples]
            if max(apart(a, b) for a, b in zip(found, self.exact, strict=True)) <= LARGEST_ERROR:
                break
        name = f"DOP853, loosest that suffices ({rtol:.0e})"
        return self.theirs(name, method="DOP853", each=False, count=SAMPLES, rtol=rtol)

    def ours(
        self, name: str, backend: Literal["numpy", "fast", "gpu"], *, threads: int, clock: Clock, checks: int = 0,
        target: str = "",
    ) -> Row:  # fmt: skip
        """The whole map; the best of some runs."""
        error = 0.0
        started = time.perf_counter()
        stability_plane(self.family, small(self.x), small(self.y), backend=backend, threads=threads, checks=0)
        if backend != "numpy":
            self.notes.append(f"{name}: first use takes {time.perf_counter() - started:.1f} s (not counted)")
        seconds, plane = timed(
            clock,
            lambda: stability_plane(
                self.family, self.x, self.y, coverage="every", backend=backend, threads=threads, checks=checks
            ),
        )
        seconds /= SPEEDS * DEPTHS
        for (i, j), exact in zip(self.samples, self.exact, strict=True):
            period = WAVELENGTH / float(self.x.values[i])
            error = max(error, abs(np.exp(plane.growth[i, j] * period) / abs(exact) - 1.0))
        error = max(error, self.series_error())
        return Row(name, seconds, error, TARGETS[target][SIZES.index(self.n)] if target and self.n in SIZES else None)

    def panels(self) -> list[Panel]:
        """The series of the whole map."""
        return list(build_panels(self.family, self.x, self.y, store=NothingKept(), prefix=""))

    def series_error(self) -> float:
        """Largest relative error of the complex leading multiplier that the series gives at the samples."""
        panels, worst = self.panels(), 0.0
        for (i, j), exact in zip(self.samples, self.exact, strict=True):
            for panel in panels:
                place = panel.rectangle
                inside = place.first_row <= i < place.last_row and place.first_column <= j < place.last_column
                if inside and panel.series is not None:
                    matrix = panel.series.points(self.x.values[i : i + 1], self.y.values[j : j + 1])
                    worst = max(worst, apart(complex(leading_eigenvalues(matrix)[0]), exact))
        return worst

    def decided(self, name: str, backend: Literal["numpy", "fast", "gpu"], *, target: str = "") -> Row:
        """Stable or unstable at every point, by norms and traces of powers, with no eigenvalue at all."""
        engine = radius_engine(backend)

        def undecided() -> int:
            count = 0
            for panel in self.panels():
                place, series = panel.rectangle, panel.series
                if series is None:
                    raise RuntimeError("expected a series everywhere on this map")
                basis = series.y_basis(self.y.values[place.first_column : place.last_column])
                for coefficients in series.rows(self.x.values[place.first_row : place.last_row]):
                    verdict = engine.decide(coefficients, basis, 1.0 - MARGIN, 1.0 + MARGIN)
                    count += int(np.count_nonzero(verdict == 0))
            return count

        undecided()  # compiles what there is to compile
        seconds, left = timed(time.process_time, undecided)
        seconds /= SPEEDS * DEPTHS
        self.notes.append(f"{name}: {left} of {SPEEDS * DEPTHS} points within {MARGIN:g} of the unit circle")
        return Row(name, seconds, self.series_error(), TARGETS[target][SIZES.index(self.n)] if target else None)

    def diffrax(self) -> Row:
        """diffrax's Dopri8 over a batch of points of the map, compiled beforehand."""
        import diffrax
        import jax
        import jax.numpy as jnp

        jax.config.update("jax_enable_x64", True)
        A_0, cosine, sine = (jnp.asarray(m) for m in (self.A_0, self.cosine[0], self.sine[0]))
        n = self.n

        def one(frequency: Any, depth: Any) -> Any:
            def rate(t: Any, x: Any, _: Any) -> Any:
                return (A_0 + depth * (cosine * jnp.cos(frequency * t) + sine * jnp.sin(frequency * t))) @ x

            period = 2.0 * jnp.pi / frequency
            return diffrax.diffeqsolve(
                diffrax.ODETerm(rate), diffrax.Dopri8(), t0=0.0, t1=period, dt0=period / 20.0, y0=jnp.eye(n),
                stepsize_controller=diffrax.PIDController(rtol=1e-9, atol=1e-12), max_steps=4096,
            ).ys[0]  # fmt: skip

        batch = jax.jit(jax.vmap(one))
        rng = np.random.default_rng(0)
        extra = rng.integers(0, (SPEEDS, DEPTHS), (BATCH - SAMPLES, 2))
        places = np.concatenate([np.array(self.samples), extra])
        frequency, depth = 2.0 * np.pi * self.x.values[places[:, 0]] / WAVELENGTH, self.y.values[places[:, 1]]
        start = time.perf_counter()
        jax.block_until_ready(batch(frequency, depth))
        self.notes.append(f"diffrax: compiling takes {time.perf_counter() - start:.1f} s (not counted)")
        start = time.process_time()
        found = leading_eigenvalues(np.asarray(jax.block_until_ready(batch(frequency, depth))))
        seconds = (time.process_time() - start) / BATCH
        return Row(
            "diffrax Dopri8, vmap", seconds, max(apart(complex(a), b) for a, b in zip(found, self.exact, strict=False))
        )


def timed(clock: Clock, work: Callable[[], Result]) -> tuple[float, Result]:
    """The least time of some runs, and the result."""
    seconds = float("inf")
    for _ in range(REPEATS):
        start = clock()
        result = work()
        seconds = min(seconds, clock() - start)
    return seconds, result


def small(axis: MapAxis) -> MapAxis:
    """A few points of an axis, for a first run that compiles what there is to compile."""
    return MapAxis(axis.name, axis.values[:: len(axis.values) // 8], axis.reciprocal, axis.linear)


def apart(found: complex, exact: complex) -> float:
    """Relative distance of a multiplier, or of its conjugate, from the exact one."""
    return min(abs(found - exact), abs(found.conjugate() - exact)) / abs(exact)


def rows_of(n: int) -> tuple[list[Row], list[str]]:
    """All methods on the map with n states; the first row is the one the others are compared with."""
    atlas = Map(n)
    rows = [
        atlas.theirs("scipy DOP853, matrix equation", method="DOP853", each=False, count=SAMPLES),
        atlas.loosest(),
        atlas.theirs("scipy RK45, one vector at a time", method="RK45", each=True, count=SLOW_SAMPLES),
    ]
    if importlib.util.find_spec("diffrax") is not None:
        rows.append(atlas.diffrax())
    cpu, wall = time.process_time, time.perf_counter
    rows.append(atlas.ours("ours, NumPy", "numpy", threads=1, clock=cpu, target="numpy"))
    rows.append(atlas.ours("ours, NumPy, 24 points verified", "numpy", threads=1, clock=cpu, checks=24))
    rows.append(atlas.ours("ours, NumPy, two threads (wall)", "numpy", threads=2, clock=wall))
    rows.append(atlas.decided("ours, NumPy, verdict only", "numpy"))
    for backend, threads in (("fast", 1), ("fast", 2), ("gpu", 1)):
        name = f"ours, {backend}" + (", two threads (wall)" if threads == 2 else " (wall)" if backend == "gpu" else "")
        clock, target = (cpu, "fast") if name == "ours, fast" else (wall, "")
        try:
            rows.append(atlas.ours(name, backend, threads=threads, clock=clock, target=target))  # type: ignore[arg-type]
            if name == "ours, fast":
                rows.append(atlas.decided("ours, fast, verdict only", "fast", target="decide"))
        except ModelError as missing:
            atlas.notes.append(f"{name}: left out ({missing})")
    # the baseline again: the machine may have changed speed meanwhile
    again = atlas.theirs("scipy DOP853, again", method="DOP853", each=False, count=SAMPLES)
    rows[0].seconds = min(rows[0].seconds, again.seconds)
    return rows, atlas.notes


def main(sizes: tuple[int, ...]) -> int:
    """Print the table; the exit status tells whether all methods were accurate."""
    worst, notes = 0.0, []
    print(f"{'states':>6} {'method':40} {'us/point':>10} {'ratio':>8} {'loosest':>8} {'target':>7} {'error':>9}")
    for n in sizes:
        rows, told = rows_of(n)
        notes += [f"{n} states, {note}" for note in told]
        for row in rows:
            worst = max(worst, row.error)
            target = "" if row.target is None else f"{row.target}"
            print(f"{n:6d} {row.name:40} {1e6 * row.seconds:10.2f} {rows[0].seconds / row.seconds:8.1f} "
                  f"{rows[1].seconds / row.seconds:8.1f} {target:>7} {row.error:9.1e}", flush=True)  # fmt: skip
    for note in notes:
        print(note)
    print(f"largest error of a leading multiplier {worst:.1e}, allowed {LARGEST_ERROR:.0e}")
    return 0 if worst <= LARGEST_ERROR else 1


if __name__ == "__main__":
    sys.exit(main(tuple(int(a) for a in sys.argv[1:]) or SIZES))
