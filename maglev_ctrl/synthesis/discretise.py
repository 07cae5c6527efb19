"""Continuous laws run at a stated rate: the sampled law, the margins it costs, and the slowest rate that is stable."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from maglev_ctrl.analysis.loops import Loop, balanced
from maglev_ctrl.analysis.margins import Margins, loop_margins
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import ModelError, NotStable
from maglev_ctrl.synthesis.sampling import held, period
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant, require_fit

Method = Literal["tustin", "hold"]
SCAN_RATIO = 1.05
"""Ratio of neighbouring periods in the search for the slowest stable rate."""
SAMPLES_OF_FASTEST = (100.0, 30.0, 10.0)
"""The search starts at this many samples per radian of the fastest closed-loop pole: the first of them that is stable.

At many samples a slow pole is so near 1 that rounding may hide which side it is on."""
SLOWEST = 1e3
"""The search ends at this many time constants (radians) of the slowest closed-loop pole."""
VERIFIED = 1e-6
"""Relative distance from the border at which the two sides are looked at again."""


@dataclass(frozen=True, eq=False, slots=True)
class LargestPeriod:
    """Largest sampling period up to which the loop is stable.

    `value` s; inf where no period was found to destabilise, NaN where no short period is stable. `verified`: just
    below the loop is stable, just above it is not, and every period of the scan below is stable.
    """

    value: float
    verified: bool
    reason: str = ""


@dataclass(frozen=True, eq=False, slots=True)
class DiscretisationLoss:
    """What running a continuous law every `dt` seconds costs.

    `controller` the sampled law (a computation delay included); `continuous` and `sampled` the margins at the plant's
    commands, `sampled` None where the sampled loop is not stable; `spectral_radius` of the sampled loop;
    `largest_period` the slowest sampling that is stable with the same method and delay.
    """

    dt: float
    method: Method
    delay_samples: int
    controller: Controller
    continuous: Margins
    sampled: Margins | None
    spectral_radius: float
    largest_period: LargestPeriod

    @property
    def stable(self) -> bool:
        """Whether the sampled loop is stable."""
        return self.spectral_radius < 1.0

    @property
    def disk_margin_lost(self) -> float:
        """Share of the disk margin (all commands at once) that sampling takes; 1 where the sampled loop is unstable."""
        if self.sampled is None:
            return 1.0
        return 1.0 - self.sampled.multi_loop.alpha / self.continuous.multi_loop.alpha

    def phase_lost(self, command: str) -> float:
        """Degrees of phase margin of one command that sampling takes; NaN where the sampled loop is unstable.

        Raises
        ------
        ValueError : no such command
        """
        before = self.continuous.channel(command).phase.value
        return before - self.sampled.channel(command).phase.value if self.sampled is not None else float("nan")


def discretise(
    controller: Controller, dt: float, *, method: Method = "tustin", prewarp: float | None = None
) -> Controller:
    """The law that runs every `dt` seconds in place of a continuous one.

    "tustin" replaces s by a (z - 1)/(z + 1) with a = 2/dt, or a = w / tan(w dt/2) so that both laws agree at the
    frequency w = `prewarp`; "hold" is exact for measurements that are constant between samples.

    Parameters
    ----------
    dt : sampling period, s
    prewarp : rad/s, below the Nyquist frequency pi/dt; "tustin" only

    Raises
    ------
    ValueError : the law is sampled already, `dt` or `prewarp` out of range, unknown method
    ModelError : the law has a pole at s = a, where the replacement has none

    Examples
    --------
    >>> law = Controller.from_matrices([[-2.0]], [[1.0]], [[2.0]], [[0.0]], measured=("y",), commands=("u",))
    >>> discretise(law, 1.0).A.tolist(), discretise(law, 1.0).D.tolist()
    ([[0.0]], [[0.5]])
    """
    period(dt)
    if controller.dt is not None:
        raise ValueError(f"controller: {controller.name!r} is sampled already, every {controller.dt:g} s")
    if method not in ("tustin", "hold"):
        raise ValueError(f"method: expected 'tustin' or 'hold', got {method!r}")
    if prewarp is not None and (method != "tustin" or not 0.0 < prewarp < np.pi / dt):
        raise ValueError(f"prewarp: expected a frequency in rad/s below pi/dt = {np.pi / dt:.6g}, for 'tustin' only")
    if method == "hold":
        A, B = held(controller.A, controller.B, dt)
        return _law(controller, A, B, controller.C, controller.D, dt)
    a = 2.0 / dt if prewarp is None else float(prewarp / np.tan(0.5 * prewarp * dt))
    unit = np.eye(len(controller.A))
    poles = np.linalg.eigvals(controller.A) if len(controller.A) else np.zeros(0)
    if np.any(np.abs(poles - a) <= 1e-9 * a):
        raise ModelError(f"the law has a pole at {a:.6g} rad/s, where the bilinear rule fails: change the rate")
    # (s I - A)^-1 = (z + 1) (z M - W)^-1 with M = a I - A and W = a I + A
    shifted = a * unit - controller.A
    power, ahead = (
        np.asarray(np.linalg.solve(shifted, x), dtype=float) for x in (a * unit + controller.A, controller.B)
    )
    through = np.asarray(np.linalg.solve(shifted.T, controller.C.T).T, dtype=float)
    return _law(controller, power, 2.0 * ahead, a * through, controller.D + controller.C @ ahead, dt)


def delayed(controller: Controller, samples: int) -> Controller:
    """A sampled law whose commands come out `samples` periods later (time to compute); further states hold them.

    Raises
    ------
    ValueError : the law is continuous, or `samples` is negative

    Examples
    --------
    >>> law = Controller.static([[2.0]], measured=("y",), commands=("u",), dt=0.1)
    >>> delayed(law, 1).B.tolist(), delayed(law, 1).D.tolist()
    ([[2.0]], [[0.0]])
    """
    if controller.dt is None:
        raise ValueError(f"controller: expected a sampled law, got the continuous {controller.name!r}")
    if samples < 0 or samples != int(samples):
        raise ValueError(f"samples: expected a whole number of periods, none negative, got {samples!r}")
    law = controller
    m = len(law.commands)
    for _ in range(int(samples)):
        n = len(law.A)
        A = np.block([[law.A, np.zeros((n, m))], [law.C, np.zeros((m, m))]])
        C = np.hstack([np.zeros((m, n)), np.eye(m)])
        law = _law(law, A, np.vstack([law.B, law.D]), C, np.zeros_like(law.D), controller.dt)
    return law


def discretisation_loss(
    plant: Plant,
    controller: Controller,
    dt: float,
    *,
    method: Method = "tustin",
    prewarp: float | None = None,
    delay_samples: int = 0,
) -> DiscretisationLoss:
    """Margins of the continuous loop beside those of the sampled one: the plant behind a hold, the law discretised.

    The hold (half a period of lag) is in the exact sampled plant; a computation delay is counted in whole periods.

    Parameters
    ----------
    plant, controller : continuous; u = K y
    dt : sampling period, s
    method, prewarp : as in `discretise`
    delay_samples : periods between reading the sensors and setting the commands; 0 neglects the computing time

    Raises
    ------
    ValueError : plant or law is sampled, names do not fit, or as in `discretise`
    NotStable : the continuous loop is not stable

    Examples
    --------
    >>> plant = Plant.from_matrices([[0.0]], [[1.0]], [[1.0]], [[1.0]])
    >>> law = Controller.static([[-1.0]], measured=("x1",), commands=("u1",))
    >>> loss = discretisation_loss(plant, law, 0.5)
    >>> round(loss.spectral_radius, 12), round(loss.largest_period.value, 5)
    (0.5, 2.0)
    """
    if plant.dt is not None:
        raise ValueError(f"plant: expected a continuous plant, got one sampled every {plant.dt:g} s")
    law = delayed(discretise(controller, dt, method=method, prewarp=prewarp), delay_samples)
    continuous = loop_margins(balanced(return_ratio(plant, controller)))
    radius = _radius(plant, law)
    at_samples: Margins | None = None
    if radius < 1.0:
        try:
            at_samples = loop_margins(balanced(return_ratio(_held_plant(plant, dt), law)))
        except NotStable:
            radius = max(radius, 1.0)
    largest = largest_period(plant, controller, method=method, delay_samples=delay_samples)
    return DiscretisationLoss(
        dt=float(dt), method=method, delay_samples=delay_samples, controller=law, continuous=continuous,
        sampled=at_samples, spectral_radius=radius, largest_period=largest,
    )  # fmt: skip


def return_ratio(plant: Plant, controller: Controller) -> Loop:
    """Return ratio L broken at the commands, negative feedback u = -L u; states of the plant, then of the law.

    Raises
    ------
    ValueError : names or sampling periods do not fit

    Examples
    --------
    >>> plant = Plant.from_matrices([[0.0]], [[1.0]], [[1.0]], [[1.0]])
    >>> return_ratio(plant, Controller.static([[-3.0]], measured=("x1",), commands=("u1",))).C.tolist()
    [[3.0]]
    """
    require_fit(plant, controller)
    n_k = len(controller.A)
    A = np.block([[plant.A, np.zeros((len(plant.A), n_k))], [controller.B @ plant.C2, controller.A]])
    B = np.vstack([plant.B2, controller.B @ plant.D22])
    C = -np.hstack([controller.D @ plant.C2, controller.C])
    return Loop(A, B, C, -controller.D @ plant.D22, plant.commands, dt=plant.dt)


def largest_period(
    plant: Plant, controller: Controller, *, method: Method = "tustin", delay_samples: int = 0
) -> LargestPeriod:
    """Largest sampling period up to which the loop is stable, by a scan from short periods and bisection.

    Without prewarping, because the period changes.

    Raises
    ------
    ValueError : plant or law is sampled, or names do not fit
    NotStable : the continuous loop is not stable
    """
    loop = return_ratio(plant, controller)
    # u = C x + D u with the loop's C and D of opposite sign: u = -(I + D)^-1 C x
    closed = loop.A - loop.B @ np.linalg.solve(np.eye(len(loop.channels)) + loop.D, loop.C)
    poles = np.linalg.eigvals(closed)
    if not np.all(poles.real < 0.0):
        raise NotStable(f"the continuous loop has a pole at {poles[np.argmax(poles.real)]:.6g} rad/s")

    def stable(dt: float) -> bool:
        try:
            law = delayed(discretise(controller, dt, method=method), delay_samples)
            return _radius(plant, law) < 1.0
        except (ModelError, np.linalg.LinAlgError):
            return False

    end = SLOWEST / float(np.min(np.abs(poles)))
    starts = [1.0 / (many * float(np.max(np.abs(poles)))) for many in SAMPLES_OF_FASTEST]
    low = next((start for start in starts if stable(start)), np.nan)
    if np.isnan(low):
        low = starts[0]
        return LargestPeriod(np.nan, False, f"UNRESOLVED: not stable at {low:.3g} s, the shortest period tried")
    high = low * SCAN_RATIO
    while stable(high):
        low, high = high, high * SCAN_RATIO
        if high > end:
            return LargestPeriod(np.inf, True, f"stable at every period tried, up to {low:.3g} s")
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable(middle) else (low, middle)
        if high - low <= 1e-12 * high:
            break
    verified = stable(low * (1.0 - VERIFIED)) and not stable(high * (1.0 + VERIFIED))
    return LargestPeriod(low, verified, "" if verified else "UNRESOLVED: the border is not sharp")


def _radius(plant: Plant, law: Controller) -> float:
    """Spectral radius of the sampled loop: the plant behind a hold, the sampled law."""
    assert law.dt is not None
    loop = return_ratio(_held_plant(plant, law.dt), law)
    A = loop.A - loop.B @ np.linalg.solve(np.eye(len(loop.channels)) + loop.D, loop.C)
    return float(np.max(np.abs(np.linalg.eigvals(A)))) if A.size else 0.0


def _held_plant(plant: Plant, dt: float) -> Plant:
    """Commands to measurements behind a hold; the other channels are left out."""
    A, B = held(plant.A, plant.B2, dt)
    n = len(A)
    return Plant.from_matrices(
        A, np.zeros((n, 0)), B, np.zeros((0, n)), plant.C2, D21=np.zeros((len(plant.measured), 0)), D22=plant.D22,
        states=plant.states, commands=plant.commands, measured=plant.measured, dt=dt, name=plant.name,
    )  # fmt: skip


def _law(of: Controller, A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, dt: float) -> Controller:
    return Controller.from_matrices(A, B, C, D, measured=of.measured, commands=of.commands, name=of.name, dt=float(dt))
