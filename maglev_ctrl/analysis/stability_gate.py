"""Stability gate: no margin is computed before the closed loop is proven stable, exact delays included.

Without delays the gate is the eigenvalues of the closed loop. With delays it is those of a rational stand-in plus a
proof that the exact loop has as many unstable poles: along the path from the stand-in Theta_a to the exact delay
Theta no pole can cross the axis, because
  above a frequency w_a:  sigma(G) < 1 and |Theta_t| <= 1, so I + G Theta_t is nonsingular (small gain);
  below it:               sigma(S_a G) max|Theta - Theta_a| < 1, so I + G Theta_t = (I + G Theta_a)(I + E), |E| < 1.
Both bounds come from Hamiltonian tests, so no frequency is left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maglev_ctrl.analysis.delay_line import delay_line, sufficient_order
from maglev_ctrl.analysis.hamiltonian import (
    balanced_realisation,
    continuous_equivalent,
    hamiltonian_frequencies,
    peak_gain,
)
from maglev_ctrl.analysis.loops import Loop, balanced, sensitivity_at
from maglev_ctrl.analysis.replay import pole_near
from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.errors import ModelError, NotStable
from maglev_ctrl.kernels import balance

_LINE_ERROR = 1e-7
_LOW_GAIN = 0.1
_SMALL_GAIN = 0.9
_NO_GAIN = 2e-3
_STARTS = 8


@dataclass(frozen=True, eq=False, slots=True)
class ClosedLoop:
    """A loop that passed the gate, with a rational realisation of its sensitivity S = (I + L)^-1.

    The realisation (A, B, C, D) lives on the continuous axis: discrete time is mapped there exactly, delays by their
    rational stand-in. `response` is exact. Frequencies here are on that axis; `true_frequency` gives rad/s.
    With delays, the stand-in is proven close up to `band` and the loop gain has died out at `reach` (inf without);
    `faithful` is False where long delays left the stand-in good for the gate only, not for peaks.
    """

    loop: Loop
    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    poles: ComplexArray
    band: float = np.inf
    reach: float = np.inf
    faithful: bool = True

    @property
    def trusted_factor(self) -> float:
        """Largest gain factor for which the realisation tells the stability of the exact loop."""
        if not np.isfinite(self.reach):
            return np.inf
        return (1.0 - _LOW_GAIN) / _LOW_GAIN if self.faithful else 1.0

    def response(self, frequency: FloatArray) -> ComplexArray:
        """Exact S on the axis at the frequencies, inf included; (N, m, m)."""
        omega = np.atleast_1d(np.asarray(frequency, dtype=np.float64))
        finite = np.isfinite(omega)
        m = self.D.shape[0]
        values = np.empty((omega.size, m, m), dtype=complex)
        values[finite] = sensitivity_at(self.loop, self.points(omega[finite]))
        if not np.all(finite):
            at_end = self.D if self.loop.dt is None else sensitivity_at(self.loop, np.array([-1.0 + 0j]))[0]
            values[~finite] = at_end
        return values

    def points(self, frequency: FloatArray) -> ComplexArray:
        """Points s = j omega, or z on the unit circle, of frequencies on the axis."""
        omega = np.asarray(frequency, dtype=np.float64)
        if self.loop.dt is None:
            return np.asarray(1j * omega)
        half = 0.5j * omega * self.loop.dt
        return np.asarray((1.0 + half) / (1.0 - half))

    def true_frequency(self, frequency: float) -> float:
        """Frequency in rad/s of a frequency on the axis."""
        if self.loop.dt is None:
            return float(frequency)
        return 2.0 / self.loop.dt * float(np.arctan(frequency * self.loop.dt / 2.0))


def close(loop: Loop) -> ClosedLoop:
    """The closed loop of a return ratio, once it is proven stable.

    Raises
    ------
    NotStable : a closed-loop pole is on or beyond the axis; the message names it
    ModelError : the loop is not well posed, or stability with delays could not be proven either way

    Examples
    --------
    >>> close(Loop.from_transfer_function([0.5], [1.0, -1.0]))
    Traceback (most recent call last):
    ...
    maglev_ctrl.errors.NotStable: the closed loop is not stable: pole at 0.5 1/s; margins of it mean nothing
    """
    even = balanced(_with_shift_registers(loop) if loop.dt is not None else loop)
    delayed = bool(np.any(even.delays > 0.0))
    if not delayed:
        A, B, C, D = _sensitivity_realisation(even.A, even.B, even.C, even.D)
        poles = np.asarray(np.linalg.eigvals(A), dtype=complex)
        _require_stable(even, A, poles)
        if even.dt is not None:
            A, B, C, D = continuous_equivalent(A, B, C, D, even.dt)
        return ClosedLoop(even, *balanced_realisation(A, B, C), D, poles)
    return _close_delayed(even)


def _require_stable(loop: Loop, A: FloatArray, poles: ComplexArray) -> None:
    if not poles.size:
        return
    excess = poles.real if loop.dt is None else np.abs(poles) - 1.0
    blur = 100.0 * np.finfo(float).eps * max(float(np.linalg.norm(A, 2)), 0.0 if loop.dt is None else 1.0)
    worst = int(np.argmax(excess))
    if excess[worst] >= -blur:
        raise NotStable(_unstable_message(complex(poles[worst]), loop.dt, on_axis=abs(excess[worst]) <= blur))


def _unstable_message(pole: complex, dt: float | None, *, on_axis: bool) -> str:
    unit = "1/s" if dt is None else "(z plane)"
    name = f"{pole.real:.6g}" if abs(pole.imag) <= 1e-12 * abs(pole) else f"{pole.real:.6g} +- {abs(pole.imag):.6g}j"
    where = ", indistinguishable from the stability boundary" if on_axis else ""
    return f"the closed loop is not stable: pole at {name} {unit}{where}; margins of it mean nothing"


def _sensitivity_realisation(
    A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """State space of S = (I + L)^-1."""
    difference = np.eye(D.shape[0]) + D
    if np.linalg.cond(difference) > 1e12:
        raise ModelError("the loop is not well posed: I + D is singular (feedthrough of the return ratio is -1)")
    R = np.asarray(np.linalg.inv(difference), dtype=np.float64)
    return A - B @ R @ C, B @ R, -R @ C, R


def _with_shift_registers(loop: Loop) -> Loop:
    """A discrete loop whose whole-sample delays are states."""
    assert loop.dt is not None
    samples = np.round(loop.delays / loop.dt).astype(int)
    lines = [(np.eye(k, k=-1), np.eye(k, 1), np.eye(1, k, k - 1)) for k in samples]
    return replace_delays(loop, [line if k else None for line, k in zip(lines, samples, strict=True)])


def replace_delays(loop: Loop, lines: list[tuple[FloatArray, FloatArray, FloatArray] | None]) -> Loop:
    """The loop with a linear system (A, B, C) in front of each input instead of its delay (None: straight through)."""
    n, m = loop.B.shape
    orders = [0 if line is None else line[0].shape[0] for line in lines]
    total = n + sum(orders)
    A, B, C = np.zeros((total, total)), np.zeros((total, m)), np.zeros((m, total))
    D = loop.D.copy()
    A[:n, :n], C[:, :n] = loop.A, loop.C
    at = n
    for i, line in enumerate(lines):
        if line is None:
            B[:n, i] = loop.B[:, i]
            continue
        block = slice(at, at + orders[i])
        A[block, block], B[block, i] = line[0], line[1][:, 0]
        A[:n, block] = loop.B[:, i : i + 1] @ line[2]
        C[:, block] = loop.D[:, i : i + 1] @ line[2]
        D[:, i] = 0.0
        at += orders[i]
    return Loop(A, B, C, D, loop.channels, None, loop.dt)


def _close_delayed(loop: Loop) -> ClosedLoop:
    channel_scale = _channel_scales(loop)
    B, C = loop.B * channel_scale, loop.C / channel_scale[:, None]
    D = loop.D * channel_scale / channel_scale[:, None]
    feedthrough = float(np.linalg.norm(D, 2))
    if feedthrough >= 0.95:
        raise ModelError(
            f"stability with delays cannot be proven: feedthrough gain {feedthrough:.3g} of a delayed loop must be "
            "below 0.95 (add the actuator's bandwidth)"
        )
    for low_gain in (_LOW_GAIN, _SMALL_GAIN):
        level = max(low_gain, 0.5 * (1.0 + feedthrough)) if feedthrough > 0.0 else low_gain
        edge = 1.05 * float(np.max(hamiltonian_frequencies(loop.A, B, C, D, level), initial=0.0))
        chosen = [sufficient_order(edge * tau, _LINE_ERROR) if tau > 0.0 else None for tau in loop.delays]
        error = max(c[1] for c in chosen if c is not None)
        if error <= _LINE_ERROR:
            break
    lines = [None if c is None else delay_line(t, c[0]) for c, t in zip(chosen, loop.delays, strict=True)]
    grown = replace_delays(loop, lines)
    A_s, B_s, C_s, D_s = _sensitivity_realisation(grown.A, grown.B, grown.C, grown.D)
    poles = np.asarray(np.linalg.eigvals(A_s), dtype=complex)
    worst = complex(poles[int(np.argmax(poles.real))])
    if abs(worst.real) <= 1e-9 * abs(worst):
        raise NotStable(_unstable_message(worst, None, on_axis=True))
    still = poles[np.abs(poles.real) <= 1e-9 * np.abs(poles) + 1e-14 * np.max(np.abs(poles), initial=0.0)]
    if still.size:
        raise ModelError(
            f"stability with delays cannot be proven: the loop keeps a pole on the axis at {abs(still[0].imag):.4g} "
            f"rad/s beside its fastest-growing one at {worst:.4g} 1/s"
        )
    # S_a G: a signal added where the delayed command enters the plant, seen at the loop's error.
    added = np.vstack([loop.B, np.zeros((grown.A.shape[0] - loop.A.shape[0], loop.B.shape[1]))])
    through = D_s @ loop.D
    added_gain = peak_gain(
        A_s,
        (added - grown.B @ through) * channel_scale,
        C_s / channel_scale[:, None],
        -through * channel_scale / channel_scale[:, None],
        tolerance=1e-3,
    )
    bound = added_gain.upper * error
    if not bound < 1.0:
        _refuse_exact_pole(loop, poles)
        raise ModelError(
            f"stability with delays cannot be proven: the loop is active up to {edge:.4g} rad/s, where the delay "
            f"turns by {edge * float(np.max(loop.delays)):.3g} rad (proof needs {bound:.3g} < 1)"
        )
    if worst.real > 0.0:
        exact = pole_near(loop, worst).pole
        raise NotStable(_unstable_message(exact if exact.real > 0.0 else worst, None, on_axis=False))
    quiet = hamiltonian_frequencies(loop.A, B, C, D, max(_NO_GAIN, 1.001 * feedthrough))
    reach = max(edge, float(np.max(quiet, initial=0.0)))
    return ClosedLoop(loop, *balanced_realisation(A_s, B_s, C_s), D_s, poles, edge, reach, low_gain == _LOW_GAIN)


def _refuse_exact_pole(loop: Loop, poles: ComplexArray) -> None:
    """One unstable pole of the exact loop, found from those of the stand-in, is proof enough that it is not stable."""
    unstable = poles[poles.real > 0.0]
    for start in unstable[np.argsort(np.abs(unstable))][:_STARTS]:
        found = pole_near(loop, complex(start), iterations=30)
        if found.residual <= 1e-10 and found.pole.real > 1e-6 * abs(found.pole):
            raise NotStable(_unstable_message(found.pole, None, on_axis=False))


def _channel_scales(loop: Loop) -> FloatArray:
    """Positive diagonal d that evens out d_j G_ij / d_i at the frequencies of the poles (channels in N beside N m)."""
    m = loop.B.shape[1]
    if m == 1:
        return np.ones(1)
    poles = np.linalg.eigvals(loop.A) if loop.A.size else np.zeros(1)
    frequencies = 1.01 * np.unique(np.abs(poles)) + 1e-3 * float(np.max(np.abs(poles)) or 1.0)
    n = loop.A.shape[0]
    plain = loop.D + loop.C @ np.linalg.solve(1j * frequencies[:, None, None] * np.eye(n) - loop.A, loop.B + 0j)
    size = np.max(np.abs(plain), axis=0) + 1e-300
    return balance(size)
