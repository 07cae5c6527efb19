"""Loops and gains whose margins and norms are known in closed form, over twenty-four decades of units."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction

import mpmath
import numpy as np
import stress_truth as exact
from stress_record import RIGHT, WRONG, Outcome, decision, figure
from stress_systems import Sample

from maglev_ctrl.analysis.common_delay import common_delay_margin
from maglev_ctrl.analysis.hamiltonian import h_infinity_norm as raising_norm
from maglev_ctrl.analysis.loops import Loop
from maglev_ctrl.analysis.margins import loop_margins
from maglev_ctrl.analysis.norms import h2_norm, h_infinity_norm
from maglev_ctrl.analysis.stability_gate import close
from maglev_ctrl.errors import Agreement, ModelError, NotStable

# Margins are replayed on the axis: a number they call verified puts a pole there. Its own error is that of a root of
# the closed loop's polynomial, some 1e-9 in well-separated ones.
MARGIN = 1e-6


def gate(loop: Loop) -> int | None:
    """The stability gate's word: -1, 1, None for a refusal or a pole it cannot tell from the axis."""
    try:
        close(loop)
    except NotStable as fault:
        return None if "indistinguishable" in str(fault) else 1
    except (ModelError, np.linalg.LinAlgError):
        return None
    return -1


def closed_truth(loop: Loop) -> int:
    """Stability of A - B C (no feedthrough), counted exactly from the entries of the loop."""
    A, B, C = (exact.fractions_of(X) for X in (loop.A, loop.B, loop.C))
    back = exact.product(B, C)
    closed = [[a - b for a, b in zip(row, other, strict=True)] for row, other in zip(A, back, strict=True)]
    return exact.growth_sign(exact.characteristic(closed))


def third_order(random: np.random.Generator) -> Iterator[Outcome]:
    """L = k / (s (s + a) (s + b)), k at 1 +- 10^-j of a b (a + b), where the loop goes unstable."""
    a, b = (float(random.integers(1, 9)) / 2.0 for _ in range(2))
    j = int(random.integers(1, 17))
    critical = a * b * (a + b)
    k = critical * (1.0 + float(random.choice([-1.0, 1.0])) * 10.0**-j)
    unit, time = (2.0 ** int(random.integers(-40, 41)) for _ in range(2))
    A = np.array([[0.0, 1.0, 0.0], [0.0, -a, 1.0], [0.0, 0.0, -b]]) * time
    loop = Loop(A, np.array([[0.0], [0.0], [unit * time]]), np.array([[k / unit, 0.0, 0.0]]), [[0.0]], ("u",))
    sample = Sample("third-order loop", closed_truth(loop), j <= 6)
    said = gate(loop)
    yield decision("stability gate", sample, said)
    if sample.truth == -1 and said == -1:
        found = loop_margins(loop).channels[0].gain_increase
        yield figure(
            "gain margin", sample.family, found.value if found.verified else None, critical / k, within=MARGIN,
            easy=j <= 6,
        )  # fmt: skip


def integrator(random: np.random.Generator) -> Iterator[Outcome]:
    """L = k e^(-s tau) / s, k from 1e-12 to 1e12: delay, phase, disk and modulus margins in closed form."""
    k = float(10.0 ** random.uniform(-12, 12))
    if random.random() < 0.5:
        loop = Loop([[0.0]], [[1.0]], [[k]], [[0.0]], ("u",))
        found = loop_margins(loop)
        one = found.channels[0]
        for engine, value, truth in (
            ("delay margin", one.delay.value if one.delay.verified else None, np.pi / (2.0 * k)),
            ("phase margin", one.phase.value if one.phase.verified else None, 90.0),
            ("disk margin", one.disk.alpha if one.disk.verified else None, 2.0),
            ("gain margin", one.gain_increase.value if one.gain_increase.verified else None, np.inf),
            ("modulus margin", one.modulus.value if one.modulus.verified else None, 1.0),
        ):
            yield figure(engine, "integrator", value, truth, within=MARGIN, easy=True)
        common = common_delay_margin(loop)
        said = common.delay if common.agreement is Agreement.AGREED else None
        yield figure("common delay", "integrator", said, np.pi / (2.0 * k), within=MARGIN, easy=True)
        return
    j, sign = int(random.integers(1, 15)), float(random.choice([-1.0, 1.0]))
    tau = np.pi / (2.0 * k) * (1.0 + sign * 10.0**-j)
    with mpmath.workdps(60):
        excess = mpmath.mpf(tau) * mpmath.mpf(k) - mpmath.pi / 2
        truth, left = 1 if excess > 0 else -1, -excess / mpmath.mpf(k)
    loop = Loop([[0.0]], [[1.0]], [[k]], [[0.0]], ("u",), delays=[tau])
    sample = Sample("integrator with delay", truth, j <= 4)
    said = gate(loop)
    yield decision("stability gate", sample, said)
    if truth == said == -1:
        one = loop_margins(loop).channels[0]
        yield figure(
            "delay margin", sample.family, one.delay.value if one.delay.verified else None, float(left),
            within=max(MARGIN, 1e-10 * 10.0**j), easy=j <= 4,
        )  # fmt: skip


def resonance_peak(random: np.random.Generator) -> Iterator[Outcome]:
    """1 / (s^2 + c s + k), damping ratio 10^-j down to 1e-14 and just off zero on the wrong side: norms."""
    w, j = float(10.0 ** random.uniform(-12, 12)), float(random.uniform(0.5, 14.0))
    grows = random.random() < 0.3
    k, c = w * w, (-1.0 if grows else 1.0) * 2.0 * 10.0**-j * w
    A, B, C, D = np.array([[0.0, 1.0], [-k, -c]]), np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]]), np.zeros((1, 1))
    with mpmath.workdps(60):
        ck, kk = mpmath.mpf(c), mpmath.mpf(k)
        peak = 1 / (abs(ck) * mpmath.sqrt(kk - ck * ck / 4)) if 2 * kk > ck * ck else 1 / kk
        energy = mpmath.sqrt(1 / (2 * abs(ck) * kk))
    family = "resonance"
    for engine, norm, known in (("H-infinity norm", h_infinity_norm, peak), ("H2 norm", h2_norm, energy)):
        found = norm(A, B, C, D)
        truth = np.inf if grows else float(known)
        said = found.value if found.agreed is Agreement.AGREED else None
        yield figure(engine, family, said, truth, within=1e-6, easy=j <= (7 if norm is h_infinity_norm else 5))
    try:
        bounds = raising_norm(A, B, C, D)
    except NotStable:
        yield Outcome("peak gain", family, RIGHT if grows else WRONG, False, "refused as not stable")
        return
    spread = bounds.upper - bounds.lower
    held = not grows and bounds.lower - spread <= float(peak) <= bounds.upper
    yield Outcome("peak gain", family, RIGHT if held else WRONG, j <= 7, f"{bounds}, truth {peak}")


def all_pass(random: np.random.Generator) -> Iterator[Outcome]:
    """Products of (s - a) / (s + a): gain one at every frequency, whatever the poles; then a pole moved across."""
    n = int(random.integers(1, 9))
    poles = [float(10.0 ** random.uniform(-4, 4)) for _ in range(n)]
    bad = random.random() < 0.3
    if bad:
        poles[0] = -poles[0] * 10.0 ** -float(random.integers(0, 13))
    A, B, C, D = np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.ones((1, 1))
    for a in poles:  # in series: (s - a) / (s + a) = 1 - 2 a / (s + a)
        top = np.hstack([A, np.zeros((len(A), 1))])
        A = np.vstack([top, np.hstack([C, [[-a]]])])
        B, C = np.vstack([B, D]), np.hstack([C, [[-2.0 * a]]])
    found = h_infinity_norm(A, B, C, D)
    said = found.value if found.agreed is Agreement.AGREED else None
    yield figure("H-infinity norm", "all-pass", said, np.inf if bad else 1.0, within=1e-6, easy=n <= 2)


def hidden_axis_pole(random: np.random.Generator) -> Iterator[Outcome]:
    """A pole at zero that inputs barely move: the norm is infinite however small the coupling, finite only at none."""
    weak = 0.0 if random.random() < 0.3 else 10.0 ** -float(random.integers(1, 25))
    A, B, C = np.diag([-1.0, 0.0]), np.array([[1.0], [weak]]), np.array([[1.0, 1.0 if weak == 0.0 else weak]])
    for engine, norm, rest in (
        ("H-infinity norm", h_infinity_norm, 1.0), ("H2 norm", h2_norm, float(np.sqrt(0.5))),
    ):  # fmt: skip
        found = norm(A, B, C, [[0.0]])
        said = found.value if found.agreed is Agreement.AGREED else None
        yield figure(engine, "hidden pole", said, np.inf if weak else rest, within=1e-6, easy=weak > 1e-4)


def dense_loop(random: np.random.Generator) -> Iterator[Outcome]:
    """Random loops with feedback that leaves the rightmost closed pole 10^-j off the axis; the truth is counted."""
    n, j = int(random.integers(1, 9)), int(random.integers(2, 17))
    A = random.standard_normal((n, n))
    B, C = random.standard_normal((n, 1)), random.standard_normal((1, n))
    closed = A - B @ C
    wanted = float(random.choice([-1.0, 1.0])) * 10.0**-j
    A = A - (float(np.max(np.linalg.eigvals(closed).real)) - wanted) * np.eye(n)
    d = 2.0 ** random.integers(-40, 41, n)
    loop = Loop(d[:, None] * A / d, d[:, None] * B, C / d, [[0.0]], ("u",))
    sample = Sample("dense loop", closed_truth(loop), j <= 6)
    yield decision("stability gate", sample, gate(loop))


def defective_loop(random: np.random.Generator) -> Iterator[Outcome]:
    """A chain that feedback closes to (s + m)^n, m = +-2^-k: a pole of multiplicity n next to the axis."""
    n, k = int(random.integers(2, 6)), int(random.integers(0, 14))
    m = Fraction(int(random.choice([-1, 0, 1])), 2**k)
    p = [Fraction(1)]
    for _ in range(n):
        p = exact.times(p, [m, Fraction(1)])
    A = np.eye(n, k=1)
    loop = Loop(A, np.eye(n, 1, -(n - 1)), [[float(c) for c in p[:-1]]], [[0.0]], ("u",))
    sample = Sample("defective loop", closed_truth(loop), bool(m) and k * n <= 12)
    yield decision("stability gate", sample, gate(loop))


FAMILIES = (
    third_order, integrator, resonance_peak, all_pass, hidden_axis_pole, dense_loop, defective_loop,
)  # fmt: skip
