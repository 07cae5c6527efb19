"""Claims and designs: what is false is never proved, and what is called solved is held against exact arithmetic."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from fractions import Fraction

import mpmath
import numpy as np
import scipy.linalg
import stress_truth as exact
from stress_record import RIGHT, UNRESOLVED, WRONG, Outcome

from maglev_ctrl.errors import ModelError, Status
from maglev_ctrl.proofs.claims import DecayClaim, EnergyClaim, GainClaim
from maglev_ctrl.proofs.makers import bounded_real_claim, energy_claim, lyapunov_claim
from maglev_ctrl.proofs.prove import prove
from maglev_ctrl.synthesis.h2 import h2_synthesis
from maglev_ctrl.synthesis.h_infinity import h_infinity_synthesis
from maglev_ctrl.synthesis.laws import design_lqr
from maglev_ctrl.synthesis.lmi.request import MultiObjective
from maglev_ctrl.synthesis.lmi.state_feedback import multi_objective
from maglev_ctrl.synthesis.result import Synthesis
from maglev_ctrl.synthesis.riccati import riccati_continuous
from maglev_ctrl.synthesis.weights import InputWeight, OutputWeight
from maglev_ctrl.systems import Controller, SecondOrderSystem
from maglev_ctrl.systems.plant import Plant

Maker = Callable[[Plant, Controller, float], GainClaim | EnergyClaim]


def _idle(A: np.ndarray, B1: np.ndarray, C1: np.ndarray) -> tuple[Plant, Controller]:
    """A plant and a law that does nothing: the closed loop is A itself."""
    n = len(A)
    plant = Plant.from_matrices(A, B1, np.eye(n, 1), C1, np.eye(1, n))
    return plant, Controller.static([[0.0]], measured=plant.measured, commands=plant.commands)


def false_decay(random: np.random.Generator) -> Iterator[Outcome]:
    """Decay at (1 +- 10^-k) of the true rate of a defective, sheared or scaled loop: false ones are never proved."""
    n, k = int(random.integers(1, 5)), int(random.integers(1, 16))
    rate = float(random.integers(1, 9)) / 4.0
    A = -rate * np.eye(n) + np.triu(random.integers(-3, 4, (n, n)), 1).astype(float)
    d = 2.0 ** random.integers(-30, 31, n) if random.random() < 0.5 else np.ones(n)
    A = d[:, None] * A / d
    true = bool(random.random() < 0.5)
    asked = rate * (1.0 - (1.0 if true else -1.0) * 10.0**-k)
    plant, law = _idle(A, np.ones((n, 1)), np.ones((1, n)))
    if true:
        try:
            claim = lyapunov_claim([plant], [law], rate=asked)
        except ModelError as fault:  # eigenvalues of a defective loop lie: no certificate is made
            yield Outcome("proof of decay", "true claims", UNRESOLVED, False, str(fault))
            return
    else:  # the best certificate there is: that of the rate just short of the true one, and a few others
        short = A + rate * (1.0 - 1e-6) * np.eye(n)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            P = scipy.linalg.solve_continuous_lyapunov(short.T, -np.eye(n))
        claim = DecayClaim((0,), (0,), asked, P[None] if np.all(np.isfinite(P)) else np.eye(n)[None])
    yield _claimed("decay", prove(claim, [plant], [law]).holds, true, n == 1 and k <= 12)


def false_gain(random: np.random.Generator) -> Iterator[Outcome]:
    """A peak gain below (1 +- 10^-k) of the true one, a light resonance of known height."""
    k, w = int(random.integers(1, 13)), float(10.0 ** random.uniform(-4, 4))
    c = float(10.0 ** random.uniform(-5, 0)) * w
    A, B, C = np.array([[0.0, 1.0], [-w * w, -c]]), np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]])
    with mpmath.workdps(50):
        stiff, damp = mpmath.mpf(A[1, 0]) * -1, mpmath.mpf(c)
        low = 2 * stiff > damp * damp
        peak = 1 / (damp * mpmath.sqrt(stiff - damp * damp / 4)) if low else 1 / stiff
        energy = mpmath.sqrt(1 / (2 * damp * stiff))
    (plant, law), true = _idle(A, B, C), bool(random.random() < 0.5)
    factor = 1.0 + (1.0 if true else -1.0) * 10.0**-k
    for name, maker, number in (("gain", bounded_real_claim, peak), ("energy", energy_claim, energy)):
        asked = float(number) * factor
        proved = _made(maker, plant, law, asked)
        if proved is None:  # no certificate is to be had at this bound: the one of a looser bound must not serve
            loose = _certificate(maker, plant, law, float(number) * 1.001)
            if loose is None:
                yield Outcome(f"proof of {name}", "false claims", UNRESOLVED, False)
                continue
            kind = GainClaim if name == "gain" else EnergyClaim
            proved = prove(kind((0,), (0,), asked, loose), [plant], [law]).holds
        yield _claimed(name, proved, true, k <= 3 and c > 1e-2 * w)


def _made(maker: Maker, plant: Plant, law: Controller, bound: float) -> bool | None:
    try:
        claim = maker(plant, law, bound)
    except (ModelError, ValueError, np.linalg.LinAlgError):
        return None
    return prove(claim, [plant], [law]).holds


def _certificate(maker: Maker, plant: Plant, law: Controller, bound: float) -> np.ndarray | None:
    try:
        return maker(plant, law, bound).P
    except (ModelError, ValueError, np.linalg.LinAlgError):
        return None


def _claimed(name: str, holds: bool, true: bool, easy: bool) -> Outcome:
    verdict = (RIGHT if true else WRONG) if holds else (UNRESOLVED if true else RIGHT)
    return Outcome(f"proof of {name}", "true claims" if true else "false claims", verdict, easy, f"holds {holds}")


def riccati(random: np.random.Generator) -> Iterator[Outcome]:
    """A scalar chain of equations with closed solutions, in units from 1e-12 to 1e12; the loop counted exactly."""
    n = int(random.integers(1, 7))
    A = random.standard_normal((n, n)) * 10.0 ** random.uniform(-3, 3)
    B = random.standard_normal((n, 1)) * 10.0 ** random.uniform(-6, 0)
    if random.random() < 0.2:  # a mode that no command moves, growing or not
        A[-1], B[-1] = 0.0, 0.0
        A[-1, -1] = float(random.choice([-1.0, 1.0])) * 10.0 ** random.uniform(-12, 0)
    Q = np.diag(10.0 ** random.uniform(-6, 6, n))
    R = np.array([[10.0 ** random.uniform(-12, 12)]])
    d = 10.0 ** random.uniform(-6, 6, n)
    A, B, Q = d[:, None] * A / d, d[:, None] * B, Q / np.outer(d, d)
    found = riccati_continuous(A, B, Q, R)
    if found.status is not Status.SOLVED:
        yield Outcome("Riccati equation", "wild weights", UNRESOLVED, False, found.message)
        return
    yield _closed("Riccati equation", "wild weights", A, B, -found.gain)


def _closed(engine: str, family: str, A: np.ndarray, B: np.ndarray, gain: np.ndarray) -> Outcome:
    """Stability of A + B K from the stored numbers, exactly; what is called solved must be stable."""
    feedback = exact.product(exact.fractions_of(B), exact.fractions_of(gain))
    closed = [[a + b for a, b in zip(*rows, strict=True)] for rows in zip(exact.fractions_of(A), feedback, strict=True)]
    stable = exact.growth_sign(exact.characteristic(closed)) == -1
    return Outcome(engine, family, RIGHT if stable else WRONG, False, "called solved")


def scalar_riccati(random: np.random.Generator) -> Iterator[Outcome]:
    """x' = a x + b u, q x^2 + r u^2: P in closed form, to ten digits where it is called solved."""
    a, b, q, r = (10.0 ** random.uniform(-6, 6, 4)) * np.array([random.choice([-1.0, 1.0]), 1.0, 1.0, 1.0])
    with mpmath.workdps(50):
        big = [mpmath.mpf(float(x)) for x in (a, b, q, r)]
        truth = float(big[3] * (big[0] + mpmath.sqrt(big[0] ** 2 + big[1] ** 2 * big[2] / big[3])) / big[1] ** 2)
    found = riccati_continuous([[a]], [[b]], [[q]], [[r]])
    if found.status is not Status.SOLVED:
        yield Outcome("Riccati equation", "scalar", UNRESOLVED, True, found.message)
        return
    held = abs(found.P[0, 0] - truth) <= 1e-9 * truth
    yield Outcome("Riccati equation", "scalar", RIGHT if held else WRONG, True, f"{found.P[0, 0]!r}, truth {truth!r}")


def laws(random: np.random.Generator) -> Iterator[Outcome]:
    """LQR of an unstable body in wild units: a design that says stable is stable, counted exactly."""
    n = int(random.integers(1, 4))
    mass, stiff = 10.0 ** random.uniform(-6, 6, n), random.standard_normal(n) * 10.0 ** random.uniform(-3, 6, n)
    coupling = np.diag(np.full(n - 1, float(np.abs(stiff).max()) * 0.3), 1)
    system = SecondOrderSystem.from_matrices(
        np.diag(mass), np.zeros((n, n)), np.diag(stiff) + coupling + coupling.T, inputs=("u",), B=np.ones((n, 1))
    )
    weights = [OutputWeight(name, 10.0 ** random.uniform(-6, 3)) for name in system.dofs]
    try:
        design = design_lqr(system, weights, [InputWeight("u", 10.0 ** random.uniform(-3, 6))])
    except (ModelError, ValueError) as fault:
        yield Outcome("LQR", "bodies", UNRESOLVED, False, str(fault))
        return
    if design.status is not Status.SOLVED or not design.certificate.stable:
        yield Outcome("LQR", "bodies", UNRESOLVED, False, design.status.value)
        return
    yield _closed("LQR", "bodies", system.state_matrix(), system.input_matrix(), design.controller.D)


def norms_of_laws(random: np.random.Generator) -> Iterator[Outcome]:
    """H2, H-infinity and inequality laws of a suspended mass in units of any size: proved ones are stable."""
    mass, stiff, unit = 10.0 ** random.uniform(-4, 4), 10.0 ** random.uniform(-4, 6), 10.0 ** random.uniform(-4, 4)
    A = np.array([[0.0, 1.0], [float(random.choice([-1.0, 1.0])) * stiff / mass, 0.0]])
    B = np.array([[0.0], [1.0 / mass]])
    C1 = np.array([[unit, 0.0], [0.0, 0.0]])
    plant = Plant.from_matrices(A, B, B, C1, D12=np.array([[0.0], [1.0 / unit]]))
    chosen = int(random.integers(0, 6))
    try:
        made: Synthesis
        if chosen < 3:
            engine, made = "H2", h2_synthesis(plant)
        elif chosen < 5:
            engine, made = "H-infinity", h_infinity_synthesis(plant).synthesis
        else:
            engine = "LMI"
            made = multi_objective([plant], MultiObjective("h2", decay_rate=0.1 * float(np.sqrt(stiff / mass))))
    except (ModelError, ValueError) as fault:
        yield Outcome("law by norm", "suspended mass", UNRESOLVED, False, str(fault))
        return
    if made.status is not Status.SOLVED:
        yield Outcome(engine, "suspended mass", UNRESOLVED, False, made.message)
        return
    yield _closed(engine, "suspended mass", A, B, made.controller.D)


def unreachable(random: np.random.Generator) -> Iterator[Outcome]:
    """A growing mode that no command moves, or one moved by 10^-k: no law is ever called solved that is not stable."""
    k = int(random.integers(0, 25))
    weak = 0.0 if random.random() < 0.3 else 10.0**-k
    growth = float(10.0 ** random.uniform(-9, 0))
    A, B = np.array([[-1.0, 0.5], [0.0, growth]]), np.array([[1.0], [weak]])
    plant = Plant.from_matrices(A, B, B, np.eye(3, 2), D12=np.array([[0.0], [0.0], [1.0]]))
    for engine, make in (
        ("H2", h2_synthesis), ("H-infinity", lambda one: h_infinity_synthesis(one).synthesis),
    ):  # fmt: skip
        try:
            made = make(plant)
        except (ModelError, ValueError) as fault:
            yield Outcome(engine, "unreachable mode", RIGHT if weak == 0.0 else UNRESOLVED, weak == 0.0, str(fault))
            continue
        if made.status is Status.SOLVED:
            yield _closed(engine, "unreachable mode", A, B, made.controller.D)
        else:
            claimed = made.status is Status.INFEASIBLE and weak != 0.0 and Fraction(weak) > Fraction(1, 10**5)
            verdict = WRONG if claimed else (RIGHT if weak == 0.0 else UNRESOLVED)
            yield Outcome(engine, "unreachable mode", verdict, weak == 0.0, f"{made.status.name}: {made.message}")


FAMILIES = (
    false_decay, false_gain, riccati, scalar_riccati, laws, norms_of_laws, unreachable,
)  # fmt: skip
