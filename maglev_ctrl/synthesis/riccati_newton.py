"""From seeds to one refined solution of a Riccati equation: Newton steps in extended precision, and who agrees.

Shared by the continuous and the discrete equation, which bring the correction of one step and the size of a residual.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import Agreement
from maglev_ctrl.synthesis.extended import Extended

EPS = float(np.finfo(float).eps)
NEWTON_STEPS = 40
SPENT = 0.1
"""Largest share of the decay of the closed loop that may be in doubt; a double root comes out at one."""


@dataclass(frozen=True, eq=False, slots=True)
class Refined:
    """A solution `P` kept as a pair, its gain, the relative size of the next Newton `step`, the seed it came from.

    `edge` tells how stable the loop is: largest real part of its poles, or their largest modulus where sampled;
    `drift` how far one step moved it: at a double root by half of its distance from neutral, else hardly at all.
    """

    P: Extended
    gain: Extended
    step: float
    edge: float
    method: str
    drift: float


Step = Callable[[Extended], tuple[Extended, float, FloatArray] | None]
"""Gain, `edge` and Newton correction at a P; None where P does not stabilise."""


def refined(seed: FloatArray, method: str, newton: Step) -> Refined | None:
    """The best of the iterates from one seed, as told by the size of the step that would follow.

    Examples
    --------
    >>> def newton(P):  # P^2 = 4
    ...     return P, -1.0, (4.0 - P.high**2) / (2.0 * P.high)
    >>> refined(np.array([[3.0]]), "guess", newton).P.high.round(12)
    array([[2.]])
    """
    P, last, before = Extended.of(seed), np.inf, np.inf
    best: Refined | None = None
    for _ in range(NEWTON_STEPS):
        found = newton(P)
        if found is None:
            break
        gain, edge, correction = found
        size = float(np.linalg.norm(P.high))
        step = float(np.linalg.norm(correction)) / size if size > 0.0 else float(np.linalg.norm(correction))
        if not np.isfinite(step):
            break
        drift = abs(edge - before)
        if best is None or step < best.step:
            best = Refined(P, gain, step, edge, method, drift if step > EPS**1.5 else 0.0)
        elif not np.isfinite(best.drift):
            best = replace(best, drift=drift)
        before = edge
        if step <= EPS**1.5 or (step < 1e-9 and step > 0.5 * last):
            break
        P, last = (P + Extended.of(0.5 * (correction + correction.T))).symmetric(), step
    return best


def best_refined(seeds: dict[str, FloatArray], newton: Step, residual: Callable[[Extended], float]) -> Refined | None:
    """Refine seeds in order of their residual until one converges."""
    best: Refined | None = None
    size = {name: residual(Extended.of(P)) for name, P in seeds.items()}
    for name in sorted(size, key=lambda name: size[name]):
        best = better(best, refined(seeds[name], name, newton))
        if best is not None and best.step <= 1e-15:
            break
    return best


def better(first: Refined | None, second: Refined | None) -> Refined | None:
    """The one with the smaller step left."""
    if first is None or second is None:
        return first or second
    return first if first.step <= second.step else second


def exists(departure: float) -> bool:
    """Whether a share `departure` of the loop's decay, used up by the steps left and by rounding, leaves a solution.

    Kantorovich's theorem needs less than one.

    Examples
    --------
    >>> exists(1e-9), exists(1.0), exists(float("nan"))
    (True, False, False)
    """
    return bool(0.0 <= departure <= SPENT)


def agreement(seeds: dict[str, FloatArray], P: FloatArray, condition: float, newton: Step) -> Agreement:
    """Two seeds lie as near the refined solution as rounding of the data explains, or are led there by Newton steps."""
    allowed = max(1e-8, min(1e-3, 1e3 * EPS * condition))
    count = 0
    for name, seed in seeds.items():
        close = np.linalg.norm(seed - P) <= allowed * np.linalg.norm(P)
        if not close and (led := refined(seed, name, newton)) is not None:
            close = np.linalg.norm(led.P.high - P) <= 1e-10 * np.linalg.norm(P)
        count += bool(close)
    return Agreement.AGREED if count >= 2 else Agreement.UNRESOLVED
