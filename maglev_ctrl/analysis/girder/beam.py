"""A simply supported girder under moving loads: modes of the Bernoulli-Euler beam, solved in closed form.

With the deflection u(s, t) = sum of q_n(t) sin(n pi s / L), downwards positive, and loads P_j (N, downwards) at s_j,

    q_n'' + 2 zeta w_n q_n' + w_n^2 q_n = 2/(m L) sum over j of P_j sin(n pi s_j / L),    w_n = (n pi / L)^2 sqrt(EI/m)

A load that moves evenly makes a burst of a sine, whose response is elementary; when it leaves, the same sine
continued with the opposite sign is added, so that free vibration needs nothing new (Fryba, Vibration of Solids and
Structures under Moving Loads, 3rd ed. 1999, ch. 1).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass
from math import pi
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize_scalar

from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only

_PER_CYCLE: Final = 24


@dataclass(frozen=True, eq=False, slots=True)
class Girder:
    """A simply supported girder of constant section.

    Parameters
    ----------
    span : m
    bending_stiffness : E I, N m^2
    mass_per_length : kg/m
    damping_ratio : of every mode, of the critical damping
    modes : how many

    Raises
    ------
    ValueError : a number that is not positive, a damping ratio outside 0 to 1, no mode

    Examples
    --------
    >>> girder = Girder(25.0, bending_stiffness=2.5e10, mass_per_length=4e3)
    >>> round(girder.first_frequency, 4)                       # (pi/2) sqrt(EI/m) / L^2, Hz
    6.2832
    """

    span: float
    _: KW_ONLY
    bending_stiffness: float
    mass_per_length: float
    damping_ratio: float = 0.0
    modes: int = 5

    def __post_init__(self) -> None:
        for label in ("span", "bending_stiffness", "mass_per_length"):
            value = getattr(self, label)
            if not (np.isfinite(value) and value > 0.0):
                raise ValueError(f"{label}: expected a positive number, got {value}")
        if not (np.isfinite(self.damping_ratio) and 0.0 <= self.damping_ratio < 1.0):
            raise ValueError(f"damping_ratio: expected a ratio from 0 to below 1, got {self.damping_ratio}")
        if self.modes < 1:
            raise ValueError(f"modes: expected at least one, got {self.modes}")

    @property
    def orders(self) -> FloatArray:
        """1, 2, ... of the modes."""
        return np.arange(1.0, self.modes + 1.0)

    @property
    def frequencies(self) -> FloatArray:
        """Undamped circular frequencies (modes,), rad/s."""
        return np.asarray((self.orders * pi / self.span) ** 2 * np.sqrt(self.bending_stiffness / self.mass_per_length))

    @property
    def first_frequency(self) -> float:
        """Frequency of the first mode, Hz."""
        return float(self.frequencies[0]) / (2.0 * pi)

    @property
    def mobility(self) -> float:
        """2/(m L): what one newton at an antinode gives each modal acceleration, 1/kg."""
        return 2.0 / (self.mass_per_length * self.span)

    def shape(self, place: ArrayLike) -> FloatArray:
        """sin(n pi s / L) at places s (...) m; (..., modes), zero outside the span."""
        s = np.asarray(place, dtype=np.float64)[..., None]
        inside = (s >= 0.0) & (s <= self.span)
        return np.where(inside, np.sin(pi * self.orders * s / self.span), 0.0)

    def shape_slope(self, place: ArrayLike) -> FloatArray:
        """Derivative of `shape` by s, 1/m; (..., modes)."""
        s, wave = np.asarray(place, dtype=np.float64)[..., None], pi * self.orders / self.span
        inside = (s >= 0.0) & (s <= self.span)
        return np.where(inside, wave * np.cos(wave * s), 0.0)

    def static_deflection(self, load: float, *, place: float, at: float) -> float:
        """Deflection (m) at `at` under a load (N) at `place`, exact (all modes).

        Examples
        --------
        >>> girder = Girder(25.0, bending_stiffness=2.5e10, mass_per_length=4e3)
        >>> girder.static_deflection(1e5, place=12.5, at=12.5) - 1e5 * 25.0**3 / (48 * 2.5e10)
        0.0
        """
        near, far = min(place, at), max(place, at)
        if near < 0.0 or far > self.span:
            return 0.0
        rest = self.span - far
        return load * rest * near * (self.span**2 - rest**2 - near**2) / (6.0 * self.bending_stiffness * self.span)


@dataclass(frozen=True, eq=False, slots=True)
class Loads:
    """Constant loads that move together: `force` (k,) N downwards, `lead` (k,) m how far each is ahead of the origin.

    The origin is at s = speed t.
    """

    force: FloatArray
    lead: FloatArray

    @classmethod
    def at(cls, force: ArrayLike, lead: ArrayLike) -> Loads:
        """Loads, checked.

        Raises
        ------
        ValueError : not as many forces as places
        """
        P, x = read_only(np.atleast_1d(force), name="force"), read_only(np.atleast_1d(lead), name="lead")
        if P.ndim != 1 or P.shape != x.shape or not P.size:
            raise ValueError(f"force, lead: expected as many of each, got shapes {P.shape} and {x.shape}")
        return cls(P, x)

    @classmethod
    def train(cls, force: float, *, count: int, spacing: float) -> Loads:
        """Equal loads one behind another, the first at the origin.

        Raises
        ------
        ValueError : no load, or a spacing that is not positive
        """
        if count < 1 or not (np.isfinite(spacing) and spacing > 0.0):
            raise ValueError(f"count, spacing: expected a load and a positive length, got {count}, {spacing}")
        return cls.at(np.full(count, force), -spacing * np.arange(count))


def modal_response(
    girder: Girder, loads: Loads, *, speed: float, times: ArrayLike
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Modal amplitudes (k, modes) m and rates (k, modes) m/s of a girder at rest before the first load, exact.

    Parameters
    ----------
    speed : m/s, positive
    times : (k,) s; the loads' origin enters at zero

    Raises
    ------
    ValueError : a speed that is not positive
    """
    if not (np.isfinite(speed) and speed > 0.0):
        raise ValueError(f"speed: expected a positive speed in m/s, got {speed}")
    t = np.asarray(times, dtype=np.float64)
    entry = -loads.lead / speed
    crossing = girder.span / speed
    since = t[:, None] - entry
    sign = (-1.0) ** girder.orders
    position, rate = np.zeros((len(t), girder.modes)), np.zeros((len(t), girder.modes))
    drive = pi * girder.orders * speed / girder.span
    for start, factor in ((since, np.ones(girder.modes)), (since - crossing, -sign)):
        found = sine_response(girder, drive, elapsed=np.maximum(start, 0.0)[..., None])
        position += factor * np.einsum("kjn,j->kn", found[0], loads.force)
        rate += factor * np.einsum("kjn,j->kn", found[1], loads.force)
    return girder.mobility * position, girder.mobility * rate


def sine_response(
    girder: Girder, drive: FloatArray, *, elapsed: FloatArray, phase: FloatArray | float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Amplitude and rate of every mode from rest under sin(phase + drive t), after times `elapsed` (..., modes or 1).

    By complex numbers: exp(i W t) turned on at zero leaves (exp(i W t) - exp(s t))/(i W - s) in a mode with the root
    s, which near resonance is t exp(s t) (e^z - 1)/z with z = (i W - s) t, well conditioned there too.
    """
    w, zeta = girder.frequencies, girder.damping_ratio
    damped = w * np.sqrt(1.0 - zeta**2)
    root = -zeta * w + 1j * damped
    turned = np.exp(1j * np.asarray(phase))
    parts = []
    for s in (root, root.conj()):
        apart = 1j * drive - s
        z = apart * elapsed
        near = np.abs(z) < 1.0
        resonant = elapsed * np.exp(s * elapsed) * _relative_exponential(np.where(near, z, 0.0))
        away = (np.exp(1j * drive * elapsed) - np.exp(s * elapsed)) / np.where(near, 1.0, apart)
        parts.append(turned * np.where(near, resonant, away))
    position = (parts[0] - parts[1]) / (2j * damped)
    rate = (root * parts[0] - root.conj() * parts[1]) / (2j * damped)
    return np.asarray(position.imag), np.asarray(rate.imag)


def deflection(girder: Girder, loads: Loads, *, speed: float, place: float, times: ArrayLike) -> FloatArray:
    """Deflection (k,) m at a place s (m) under moving constant loads; see `modal_response`.

    Examples
    --------
    >>> girder = Girder(25.0, bending_stiffness=2.5e10, mass_per_length=4e3, modes=9)
    >>> slow = deflection(girder, Loads.at(1e5, 0.0), speed=0.05, place=12.5, times=[250.0])
    >>> bool(abs(slow[0] / girder.static_deflection(1e5, place=12.5, at=12.5) - 1.0) < 2e-3)
    True
    """
    amplitude, _ = modal_response(girder, loads, speed=speed, times=times)
    return np.asarray(amplitude @ girder.shape(place))


@dataclass(frozen=True, eq=False, slots=True)
class Impact:
    """Largest dynamic over largest static deflection at a place.

    `factor`; `dynamic`, `static` m; `time` (s) of the largest one, `free` whether all loads had left by then.
    """

    factor: float
    dynamic: float
    static: float
    time: float
    free: bool


def impact_factor(girder: Girder, loads: Loads, *, speed: float, place: float | None = None) -> Impact:
    """Impact factor of moving constant loads, over the passage and one period of free vibration.

    The static deflection is summed over the same modes.

    Parameters
    ----------
    place : m; mid-span when left out

    Raises
    ------
    ValueError : a speed that is not positive

    Examples
    --------
    >>> girder = Girder(25.0, bending_stiffness=2.5e10, mass_per_length=4e3, modes=1)
    >>> at = 0.6 * 2.0 * girder.first_frequency * girder.span           # speed parameter 0.6
    >>> round(impact_factor(girder, Loads.at(1e5, 0.0), speed=at).factor, 3)
    1.768
    """
    at = 0.5 * girder.span if place is None else place
    shape = girder.shape(at)
    first, last = -float(np.max(loads.lead)) / speed, (girder.span - float(np.min(loads.lead))) / speed
    period = 1.0 / girder.first_frequency
    fastest = max(float(girder.frequencies[-1]) / (2.0 * pi), girder.modes * speed / (2.0 * girder.span))
    count = int(np.ceil((last + period - first) * fastest * _PER_CYCLE)) + 1
    times = np.linspace(first, last + period, min(count, 400_000))

    def dynamic(t: float) -> float:
        return float(abs(modal_response(girder, loads, speed=speed, times=[t])[0][0] @ shape))

    values = np.concatenate(
        [
            np.abs(modal_response(girder, loads, speed=speed, times=part)[0] @ shape)
            for part in np.array_split(times, max(1, len(times) * loads.force.size // 20_000))
        ]
    )
    time, top = _climbed(dynamic, times, values)
    where = np.linspace(first, last, 4001)

    def static(t: float) -> float:
        push = loads.force @ girder.shape(speed * t + loads.lead)
        return float(abs((girder.mobility * push / girder.frequencies**2) @ shape))

    push = np.einsum("j,kjn->kn", loads.force, girder.shape(speed * where[:, None] + loads.lead))
    still = np.abs((girder.mobility * push / girder.frequencies**2) @ shape)
    _, lowest = _climbed(static, where, still)
    return Impact(top / lowest, top, lowest, time, time > last)


def resonance_speeds(girder: Girder, *, spacing: float, orders: int = 5) -> FloatArray:
    """Speeds f1 d / k (m/s), k = 1..orders, at which loads a distance d (m) apart leave free vibrations that add up.

    Examples
    --------
    >>> girder = Girder(25.0, bending_stiffness=2.5e10, mass_per_length=4e3)
    >>> resonance_speeds(girder, spacing=20.0, orders=2).round(2).tolist()
    [125.66, 62.83]
    """
    if not (np.isfinite(spacing) and spacing > 0.0):
        raise ValueError(f"spacing: expected a positive length in m, got {spacing}")
    return np.asarray(girder.first_frequency * spacing / np.arange(1.0, orders + 1.0))


def cancellation_speeds(girder: Girder, *, orders: int = 5) -> FloatArray:
    """Speeds (m/s) after which a load leaves no free vibration of the undamped first mode: 2 f1 L / (2 j + 1).

    The free amplitude over the static one is 2 alpha |cos(pi/(2 alpha))| / |1 - alpha^2|, alpha = v / (2 f1 L).
    """
    return np.asarray(2.0 * girder.first_frequency * girder.span / (2.0 * np.arange(1.0, orders + 1.0) + 1.0))


def _climbed(value: Callable[[float], float], at: FloatArray, samples: FloatArray) -> tuple[float, float]:
    """Place and height of the top near the largest sample."""
    best = int(np.argmax(samples))
    low, high = float(at[max(best - 1, 0)]), float(at[min(best + 1, len(at) - 1)])
    search = minimize_scalar(lambda t: -value(float(t)), bounds=(low, high), method="bounded",
                             options={"xatol": 1e-10 * max(abs(low), abs(high))})  # fmt: skip
    if -float(search.fun) > float(samples[best]):
        return float(search.x), -float(search.fun)
    return float(at[best]), float(samples[best])


def _relative_exponential(z: ComplexArray) -> ComplexArray:
    """(e^z - 1)/z, one at zero."""
    small = np.abs(z) < 1e-300
    safe = np.where(small, 1.0, z)
    return np.asarray(np.where(small, 1.0, np.expm1(safe) / safe))
