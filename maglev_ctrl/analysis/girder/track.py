"""A bending guideway for simulations in time: it is told where it is loaded, and answers how far it has given way."""

from __future__ import annotations

from math import floor, pi
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.analysis.girder.beam import Girder, sine_response
from maglev_ctrl.arrays import FloatArray


class RigidTrack(Protocol):
    """What lies on the girders: displacements and slopes that do not answer to loads, such as a `TrackProfile`."""

    def under(self, x: ArrayLike, y: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Vertical and lateral displacement (...) m."""
        ...

    def slopes(self, x: ArrayLike, y: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Their derivatives by x (...)."""
        ...


class FlexibleGuideway:
    """Equal girders one behind another that bend under the loads of one run.

    Between two calls of `advance` every load is constant and moves on at `speed`, which is solved exactly; all loads
    are taken to act on the centre line (girders do not twist). Girders are at rest until they are first loaded, and
    vibrate on freely after that.

    Parameters
    ----------
    girder : span, stiffness, mass, damping and modes of each
    speed : of the loads, m/s, positive
    below : rigid irregularity, added to the deflection; none when left out
    support : position of one support along the track, m

    Raises
    ------
    ValueError : a speed that is not positive, or a support that is not finite

    Examples
    --------
    >>> girder = Girder(25.0, bending_stiffness=2.5e10, mass_per_length=4e3, damping_ratio=0.5)
    >>> track = FlexibleGuideway(girder, speed=1e-6)
    >>> for k in range(40):
    ...     track.advance(0.1 * k, np.array([12.5]), np.array([1e5]), 0.1)
    >>> round(float(1e3 * track.under(12.5, 0.0)[0]), 3)                # -P L^3/(48 EI) of its first five modes, mm
    -1.301
    """

    responds = True

    def __init__(
        self, girder: Girder, *, speed: float, below: RigidTrack | None = None, support: float = 0.0
    ) -> None:  # fmt: skip
        if not (np.isfinite(speed) and speed > 0.0):
            raise ValueError(f"speed: expected a positive speed in m/s, got {speed}")
        if not np.isfinite(support):
            raise ValueError(f"support: expected a finite position in m, got {support}")
        self.girder, self.speed, self.below, self.support = girder, float(speed), below, float(support)
        self._time = 0.0
        self._spans: dict[int, tuple[float, FloatArray, FloatArray]] = {}

    def fresh(self) -> FlexibleGuideway:
        """The same guideway at rest, for another run."""
        return FlexibleGuideway(self.girder, speed=self.speed, below=self.below, support=self.support)

    def advance(self, time: float, places: FloatArray, loads: FloatArray, step: float) -> None:
        """Move on by a step (s) from `time` (s) under loads (k,) N downwards that start at places (k,) m.

        Raises
        ------
        ValueError : a step that is not positive, or not as many loads as places
        """
        where, force = np.asarray(places, dtype=np.float64).ravel(), np.asarray(loads, dtype=np.float64).ravel()
        if where.shape != force.shape:
            raise ValueError(f"places, loads: expected as many of each, got {where.size} and {force.size}")
        if not (np.isfinite(step) and step > 0.0):
            raise ValueError(f"step: expected a positive time in s, got {step}")
        L, end = self.girder.span, time + step
        parts: dict[int, list[tuple[float, float, float, float]]] = {}
        for s, P in zip((where - self.support).tolist(), force.tolist(), strict=True):
            now = 0.0
            while now < step:
                index = floor(s / L)
                # A load that stands on a support begins the span ahead of it.
                local = min(max(s - index * L, 0.0), L)
                stay = min((L - local) / self.speed, step - now)
                if stay <= 1e-12 * step:
                    s, local, index = (index + 1) * L, 0.0, index + 1
                    stay = min(L / self.speed, step - now)
                parts.setdefault(index, []).append((P, local, now, stay))
                now, s = now + stay, (index + 1) * L
        for index, found in parts.items():
            q, rate = self._freely(index, end)
            for P, local, begun, stay in found:
                more, more_rate = self._loaded(P, local, stay, left=step - begun - stay)
                q, rate = q + more, rate + more_rate
            self._spans[index] = (end, q, rate)
        self._time = end

    def _loaded(self, load: float, local: float, stay: float, *, left: float) -> tuple[FloatArray, FloatArray]:
        """What one load adds that stays for a time (s) from its place on, and is gone for what is left of the step."""
        drive = pi * self.girder.orders * self.speed / self.girder.span
        phase = pi * self.girder.orders * local / self.girder.span
        q, rate = sine_response(self.girder, drive, elapsed=np.asarray(stay), phase=phase)
        q, rate = load * self.girder.mobility * q, load * self.girder.mobility * rate
        return free_vibration(self.girder, q, rate, left) if left > 0.0 else (q, rate)

    def _freely(self, index: int, time: float) -> tuple[FloatArray, FloatArray]:
        """Amplitudes and rates of a span at a time without loads since they were last known."""
        if index not in self._spans:
            return np.zeros(self.girder.modes), np.zeros(self.girder.modes)
        known, q, rate = self._spans[index]
        return free_vibration(self.girder, q, rate, time - known) if time != known else (q, rate)

    def under(self, x: ArrayLike, y: ArrayLike = 0.0) -> tuple[FloatArray, FloatArray]:
        """Vertical and lateral displacement (...) m under places x, y (m), at the time last reached."""
        place, side = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
        vertical, lateral = self._rigid(place, side, slopes=False)
        return vertical - self._summed(place)[0], lateral

    def slopes(self, x: ArrayLike, y: ArrayLike = 0.0) -> tuple[FloatArray, FloatArray]:
        """Slopes (...) along the path of a point that moves at `speed`: times it, they are the rates it meets.

        They hold what the girder's own velocity adds, over the speed.
        """
        place, side = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
        vertical, lateral = self._rigid(place, side, slopes=True)
        _, slope, rate = self._summed(place)
        return vertical - slope - rate / self.speed, lateral

    def midspan(self, index: int) -> float:
        """Deflection (m, downwards) of a girder at mid-span, girder 0 from the support onwards."""
        return float(self.girder.shape(0.5 * self.girder.span) @ self._freely(index, self._time)[0])

    def _rigid(self, place: FloatArray, side: FloatArray, *, slopes: bool) -> tuple[FloatArray, FloatArray]:
        if self.below is None:
            return np.zeros(place.shape), np.zeros(place.shape)
        return self.below.slopes(place, side) if slopes else self.below.under(place, side)

    def _summed(self, place: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Deflection, slope and velocity downwards at places."""
        L = self.girder.span
        index = np.floor((place - self.support) / L).astype(np.int64)
        down, slope, velocity = np.zeros(place.shape), np.zeros(place.shape), np.zeros(place.shape)
        for one in np.unique(index).tolist():
            if one not in self._spans:
                continue
            q, rate = self._freely(one, self._time)
            here = index == one
            local = np.clip(place[here] - self.support - one * L, 0.0, L)
            shape = self.girder.shape(local)
            down[here], slope[here] = shape @ q, self.girder.shape_slope(local) @ q
            velocity[here] = shape @ rate
        return down, slope, velocity


def free_vibration(
    girder: Girder, amplitude: FloatArray, rate: FloatArray, elapsed: float
) -> tuple[FloatArray, FloatArray]:
    """Amplitudes and rates (modes,) of unloaded modes after a time (s).

    Examples
    --------
    >>> girder = Girder(25.0, bending_stiffness=2.5e10, mass_per_length=4e3, modes=1)
    >>> half = free_vibration(girder, np.ones(1), np.zeros(1), 0.5 / girder.first_frequency)[0]
    >>> half.round(12).tolist()
    [-1.0]
    """
    w, zeta = girder.frequencies, girder.damping_ratio
    damped = w * np.sqrt(1.0 - zeta**2)
    decay, cosine, sine = np.exp(-zeta * w * elapsed), np.cos(damped * elapsed), np.sin(damped * elapsed) / damped
    moved = decay * (amplitude * (cosine + zeta * w * sine) + rate * sine)
    return moved, decay * (rate * (cosine - zeta * w * sine) - w**2 * amplitude * sine)
