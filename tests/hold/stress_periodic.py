"""Periodic systems with multipliers known in closed form, next to the circle, and matrices whose radius is counted."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import stress_truth as exact
from stress_record import RIGHT, UNRESOLVED, WRONG, Outcome, decision
from stress_systems import Sample

from maglev_ctrl.analysis.boundary import stability_boundaries
from maglev_ctrl.analysis.floquet import floquet
from maglev_ctrl.analysis.plane_records import STABLE, UNSTABLE, MapAxis
from maglev_ctrl.analysis.stability_plane import stability_plane
from maglev_ctrl.kernels.spectral_radius import NumpyRadius
from maglev_ctrl.systems import PeriodicSystem

# The first width of Mathieu's tongue x'' + (a - 2 q cos 2 t) x = 0 at q = 1, characteristic values to 20 digits
# (Abramowitz & Stegun, Handbook of Mathematical Functions, table 20.1): unstable between b1 and a1.
B_1, A_1 = -0.11024881699209516, 1.8591080725143634


def _word(stable: bool | None) -> int | None:
    return None if stable is None else (-1 if stable else 1)


def turning_frame(random: np.random.Generator) -> Iterator[Outcome]:
    """A constant system seen from a turning frame: R(t) A R(-t) + W J, whose exponents are those of A (and +-i W).

    The rate put in is 10^-j of the frequency, j = 1 .. 14; the growth is that of a system in which every entry moves.
    """
    W, j = float(10.0 ** random.uniform(-6, 6)), int(random.integers(1, 15))
    growth = float(random.choice([-1.0, 1.0])) * 10.0**-j * W
    other = -W * float(random.uniform(0.1, 0.5))
    mean, half = (growth + other) / 2.0, (growth - other) / 2.0
    A_0 = np.array([[mean, -W], [W, mean]])
    cosine, sine = np.array([[half, 0.0], [0.0, -half]]), np.array([[0.0, half], [half, 0.0]])
    d = 2.0 ** int(random.integers(-20, 21))
    D = np.array([[1.0, d], [1.0 / d, 1.0]])
    system = PeriodicSystem.from_matrices(A_0 * D, [cosine * D], [sine * D], frequency=2.0 * W)
    found = floquet(system)
    sample = Sample("turning frame", 1 if growth > 0.0 else -1, j <= 9)
    yield decision("Floquet", sample, _word(found.stable))
    held = abs(found.growth_rate - growth) <= found.growth_error + 4e-16 * W
    yield Outcome(
        "Floquet error bound", sample.family, RIGHT if held else WRONG, False,
        f"{found.growth_rate!r} +- {found.growth_error:.1e}, truth {growth!r}",
    )  # fmt: skip


def commuting(random: np.random.Generator) -> Iterator[Outcome]:
    """A (1 + d cos W t): the mean decides, however deep the modulation; A with a pair 10^-j off the axis, or on it."""
    w, j = float(random.uniform(0.5, 4.0)), int(random.integers(1, 15))
    growth = float(random.choice([-1.0, 0.0, 1.0])) * 2.0 ** -int(3.3 * j)
    A, depth = np.array([[growth, w], [-w, growth]]), float(random.uniform(0.0, 3.0))
    k = int(random.integers(-20, 21))
    D = np.array([[1.0, 2.0**k], [2.0**-k, 1.0]])
    system = PeriodicSystem.from_matrices(A * D, [depth * A * D], frequency=float(random.uniform(0.5, 9.0)))
    found = floquet(system)
    yield decision("Floquet", Sample("commuting", int(np.sign(growth)), growth != 0.0 and j <= 8), _word(found.stable))


def mathieu(random: np.random.Generator) -> Iterator[Outcome]:
    """Mathieu's equation at q = 1 with a at 10^-j inside or outside its tongue; outside, nothing grows or decays."""
    j, inside = int(random.integers(1, 13)), bool(random.random() < 0.5)
    edge, direction = (A_1, -1.0) if random.random() < 0.5 else (B_1, 1.0)
    a = edge + (direction if inside else -direction) * 10.0**-j
    time = float(10.0 ** random.uniform(-5, 5))
    system = PeriodicSystem.from_matrices(
        [[0.0, time], [-a * time, 0.0]], [[[0.0, 0.0], [2.0 * time, 0.0]]], frequency=2.0 * time
    )
    sample = Sample("Mathieu's tongue", 1 if inside else 0, inside and j <= 8)
    yield decision("Floquet", sample, _word(floquet(system).stable))


def damped_hill(random: np.random.Generator) -> Iterator[Outcome]:
    """Mathieu with damping c: exp(-c t / 2) times the undamped one; c at 1 +- 10^-j of twice its growth rate."""
    depth, j = float(random.uniform(0.1, 2.0)), int(random.integers(2, 12))
    # x = exp(-c t / 2) y turns x'' + c x' + (k + c^2 / 4 + p cos W t) x = 0 into y'' + (k + p cos W t) y = 0.
    k = 1.0
    plain = floquet(PeriodicSystem.from_matrices([[0.0, 1.0], [-k, 0.0]], [[[0.0, 0.0], [-depth, 0.0]]], frequency=2.0))
    off = float(random.choice([-1.0, 1.0])) * 10.0**-j
    c = 2.0 * plain.growth_rate * (1.0 + off)
    system = PeriodicSystem.from_matrices(
        [[0.0, 1.0], [-(k + c * c / 4.0), -c]], [[[0.0, 0.0], [-depth, 0.0]]], frequency=2.0
    )
    said = _word(floquet(system).stable)
    # The truth of the undamped growth rate is good to its own bound (and its engines' agreement) only.
    if abs(off) * plain.growth_rate > 10.0 * plain.growth_error:
        yield decision("Floquet", Sample("damped Hill", -1 if off > 0.0 else 1, j <= 7), said)


def radius(random: np.random.Generator) -> Iterator[Outcome]:
    """Whole matrices over a power of two with a spectral radius near one, counted exactly on the circle."""
    n, j = int(random.integers(1, 7)), int(random.integers(1, 15))
    A = random.standard_normal((n, n)) * 10.0 ** random.uniform(-3, 3)
    if random.random() < 0.3:
        A = np.triu(A) + np.diag(np.full(n - 1, 10.0 ** random.uniform(0, 6)), 1)
    size = float(np.max(np.abs(np.linalg.eigvals(A))))
    A = A / size * (1.0 + float(random.choice([-1.0, 1.0])) * 10.0**-j)
    d = 2.0 ** random.integers(-15, 16, n) if random.random() < 0.5 else np.ones(n)
    A = d[:, None] * A / d
    truth = exact.roots_outside(exact.characteristic(exact.fractions_of(A)))
    sample = Sample("radius", truth, j <= 5 and bool(np.all(d == 1.0)) and n <= 3)
    said = int(NumpyRadius().decide(A[None], np.ones((1, 1)), 1.0, 1.0)[0])
    yield decision("radius decision", sample, said or None)
    modulus, sure = NumpyRadius().moduli(A[None], np.ones((1, 1)))
    # Ten digits are promised where it says sure, so nothing closer to one than that is decided by it.
    word = None if not sure[0] or abs(modulus[0] - 1.0) <= 1e-10 else (1 if modulus[0] > 1.0 else -1)
    yield decision("radius modulus", sample, word)


def map_pixels(random: np.random.Generator) -> Iterator[Outcome]:
    """A map over depth and damping of a commuting system: the sign of the damping decides every pixel."""
    w = float(random.uniform(0.5, 4.0))
    dampings = np.sort(np.concatenate([-(10.0 ** -random.uniform(0, 14, 4)), 10.0 ** -random.uniform(0, 14, 4)]))

    def family(x: float, y: float) -> PeriodicSystem:
        A = np.array([[-x, w], [-w, -x]])
        return PeriodicSystem.from_matrices(A, [y * A], frequency=3.0)

    # Growth within its error bound counts as none in a map of an undamped system: these are the limits of that word.
    dampings = np.unique(np.where(np.abs(dampings) < 5e-10, np.sign(dampings) * 5e-10, dampings))
    plane = stability_plane(
        family,
        MapAxis("damping", np.unique(dampings)),
        MapAxis("depth", np.linspace(0.0, 1.5, 5)),
        coverage="every",
        checks=4,
    )
    for i, c in enumerate(dampings):
        for state in plane.state[i]:
            said = {STABLE: -1, UNSTABLE: 1}.get(int(state))
            yield decision("map pixel", Sample("commuting map", -1 if c > 0.0 else 1, abs(c) > 1e-8), said)


def mathieu_map(random: np.random.Generator) -> Iterator[Outcome]:
    """The edges of Mathieu's tongue in a map: inside grows, outside nothing does, however near."""
    j = np.sort(random.uniform(0.5, 13.0, 6))
    edge, sign = (A_1, -1.0) if random.random() < 0.5 else (B_1, 1.0)
    offsets = np.unique(np.concatenate([10.0**-j, -(10.0**-j)]))
    values = edge + offsets

    def family(x: float, y: float) -> PeriodicSystem:
        return PeriodicSystem.from_matrices(
            [[0.0, 1.0], [-x * y * y, 0.0]], [[[0.0, 0.0], [2.0 * y * y, 0.0]]], frequency=2.0 * y
        )

    plane = stability_plane(family, MapAxis("a", values), MapAxis("time", np.array([0.25, 1.0, 3.0])), checks=4)
    for i, offset in enumerate(values - edge):
        inside = offset * sign > 0.0
        for state in plane.state[i]:
            told = f"{state} at {offset:.1e}, {'inside' if inside else 'outside'}"
            wrong = state == (STABLE if inside else UNSTABLE)
            right = state == (UNSTABLE if inside else STABLE)
            verdict = WRONG if wrong else (RIGHT if right else UNRESOLVED)
            yield Outcome("map pixel", "Mathieu's edges", verdict, inside and abs(offset) > 1e-6, told)


def turning_map(random: np.random.Generator) -> Iterator[Outcome]:
    """The turning frame again, over rate and speed, by the engine of the maps (adaptive filling included)."""
    W = float(10.0 ** random.uniform(-2, 2))
    rates = np.sort(np.concatenate([-(10.0 ** -random.uniform(1, 12, 6)), 10.0 ** -random.uniform(1, 12, 6)]))

    def family(x: float, y: float) -> PeriodicSystem:
        mean, half = (x + y) / 2.0 * W, (x - y) / 2.0 * W
        return PeriodicSystem.from_matrices(
            [[mean, -W], [W, mean]], [[[half, 0.0], [0.0, -half]]], [[[0.0, half], [half, 0.0]]], frequency=2.0 * W
        )

    axes = MapAxis("rate", rates), MapAxis("other", np.linspace(-0.5, -0.1, 9))
    plane = stability_plane(family, *axes, coverage="adaptive", checks=4)
    for i, rate in enumerate(rates):
        for state in plane.state[i]:
            said = {STABLE: -1, UNSTABLE: 1}.get(int(state))
            yield decision("map pixel", Sample("turning map", 1 if rate > 0.0 else -1, abs(rate) > 1e-7), said)


def crossing(random: np.random.Generator) -> Iterator[Outcome]:
    """A boundary at a place put in by hand: found within the error it tells, on ranges of any size."""
    at, width = float(random.uniform(0.05, 0.95)), float(10.0 ** random.uniform(-12, 12))
    power = int(random.choice([1, 3]))
    found = stability_boundaries(lambda x: (x / width - at) ** power, 0.0, width, samples=21)
    held = len(found.crossings) == 1 and abs(found.crossings[0].value - at * width) <= found.crossings[0].error * 1.01
    verdict = RIGHT if held else (UNRESOLVED if not found.crossings and found.gaps else WRONG)
    yield Outcome("boundary", "one crossing", verdict, True, f"{found.crossings}, truth {at * width!r}")


FAMILIES = (
    turning_frame, commuting, mathieu, damped_hill, radius, map_pixels, mathieu_map, turning_map, crossing,
)  # fmt: skip
