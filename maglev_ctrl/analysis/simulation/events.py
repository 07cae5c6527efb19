"""What ends a run: contact, a magnet that leaves its force model's data, divergence; found by interpolation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.analysis.simulation.magnets import Winding
from maglev_ctrl.analysis.simulation.motion import Equations, Rates
from maglev_ctrl.analysis.simulation.records import Event, EventKind, Limits
from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.forces.base import EDGE_TOLERANCE
from maglev_ctrl.vehicle import Vehicle

_PLACES = ("height", "guidance gap", "speed")
_UNITS = ("m", "m", "m/s")


@dataclass(frozen=True, eq=False, slots=True)
class Node:
    """What the limits are held against at one time: all (r, *), of the runs `rows` (r,)."""

    time: float
    rows: NDArray[np.int64]
    q: FloatArray
    currents: FloatArray
    rates: Rates


@dataclass(frozen=True, eq=False, slots=True)
class Bounds:
    """Limits of a vehicle ready for batches: `low`, `high` (3, m) of heights, gaps and speeds, `stroke` (l,) m.

    `touching` (3, m): whether the lower limit is a contact and not the end of the data.
    """

    names: tuple[str, ...]
    links: tuple[str, ...]
    dofs: tuple[str, ...]
    low: FloatArray
    high: FloatArray
    touching: NDArray[np.bool_]
    stroke: FloatArray
    travel: FloatArray
    saturating: tuple[Winding, ...]

    @classmethod
    def of(cls, vehicle: Vehicle, equations: Equations, limits: Limits) -> Bounds:
        """The limits of a vehicle.

        Raises
        ------
        ValueError : a stroke's limit names no connection or actuator
        """
        magnets = equations.magnets
        links = tuple(link.name for link in vehicle.links)
        for name in limits.strokes:
            if name not in links:
                raise ValueError(f"limits: there is no stroke of {name!r}; the links are {', '.join(links) or 'none'}")
        low, high = magnets.low.copy(), magnets.high.copy()
        low -= EDGE_TOLERANCE * np.where(np.isfinite(low), np.abs(low), 0.0)
        high += EDGE_TOLERANCE * np.where(np.isfinite(high), np.abs(high), 0.0)
        contact = np.full_like(low, -np.inf)
        contact[0], contact[1] = limits.height, np.where(magnets.side != 0.0, limits.gap, -np.inf)
        turning = [name.rsplit(".", 1)[1] in ("roll", "pitch", "yaw") for name in vehicle.dofs]
        travel = np.where(turning, limits.turn, limits.travel)
        surging = np.array([name.endswith(".surge") for name in vehicle.dofs])
        return cls(
            names=tuple(magnet.name for magnet in vehicle.magnets),
            links=links,
            dofs=vehicle.dofs,
            low=read_only_any(np.maximum(low, contact)),
            high=read_only_any(high),
            touching=read_only_any(contact >= low),
            stroke=read_only_any(np.array([limits.strokes.get(name, np.inf) for name in links])),
            travel=read_only_any(np.where(surging, np.inf, travel)),
            saturating=tuple(w for w in magnets.windings if w.limit is not None),
        )

    def crossed(self, node: Node) -> NDArray[np.bool_]:
        """Which of a node's runs are beyond a limit, (r,)."""
        places = node.rates.places
        # Not a number counts as inside here: gaps of magnets without a wall; states are asked below.
        out = ((places <= self.low) | (places > self.high)).reshape(len(places), -1).any(axis=1)
        out |= (np.abs(node.rates.strokes) > self.stroke).any(axis=1)
        for winding in self.saturating:
            out |= self._flux(winding, node) > 0.0
        return np.asarray(out | ~(np.abs(node.q) <= self.travel).all(axis=1))

    def event(self, before: Node | None, after: Node, row: int) -> Event:
        """The first limit that a run crossed between two nodes; `row` is its place in the later one."""
        run = int(after.rows[row])
        earlier = None if before is None else int(np.flatnonzero(before.rows == run)[0])
        if not np.all(np.isfinite(after.q[row])):
            return Event(run, "diverged", after.time, "", np.nan, "the motion is no longer finite")
        found: list[Event] = []
        places, closing = after.rates.places[row], after.rates.closing[row]
        for axis, member in zip(*np.nonzero((places <= self.low) | (places > self.high)), strict=True):
            under = bool(places[axis, member] <= self.low[axis, member])
            edge, sign = (self.low, 1.0) if under else (self.high, -1.0)
            margins = [sign * (places[axis, member] - edge[axis, member])]
            slopes = [sign * closing[axis, member]] if axis < 2 else [np.nan]
            if before is not None and earlier is not None:
                margins.insert(0, sign * (before.rates.places[earlier, axis, member] - edge[axis, member]))
                slopes.insert(0, sign * before.rates.closing[earlier, axis, member] if axis < 2 else np.nan)
            kind: EventKind = "contact" if under and self.touching[axis, member] else "data"
            what = f"{_PLACES[axis]} {edge[axis, member]:.6g} {_UNITS[axis]}"
            reason = f"{what} is contact" if kind == "contact" else f"{what} is the end of the force model's data"
            found.append(_located(run, kind, before, after, self.names[member], margins, slopes, reason))
        strokes, rates = after.rates.strokes[row], after.rates.stroke_rates[row]
        for link in np.flatnonzero(np.abs(strokes) > self.stroke):
            sign = -float(np.sign(strokes[link]))
            margins, slopes = [self.stroke[link] + sign * strokes[link]], [sign * rates[link]]
            if before is not None and earlier is not None:
                margins.insert(0, self.stroke[link] + sign * before.rates.strokes[earlier, link])
                slopes.insert(0, sign * before.rates.stroke_rates[earlier, link])
            reason = f"stroke {-sign * self.stroke[link]:.6g} is at its limit"
            found.append(_located(run, "contact", before, after, self.links[link], margins, slopes, reason))
        for winding in self.saturating:
            over = self._flux(winding, after)[row]
            if over > 0.0:
                margins = [-over]
                if before is not None and earlier is not None:
                    margins.insert(0, -self._flux(winding, before)[earlier])
                reason = f"flux density {winding.limit:.4g} T: the iron saturates, the end of the force model's data"
                name = self.names[winding.member]
                found.append(_located(run, "data", before, after, name, margins, [np.nan] * len(margins), reason))
        far = np.flatnonzero(np.abs(after.q[row]) > self.travel)
        if not found:
            name = self.dofs[far[0]]
            reason = f"{name} is further than {self.travel[far[0]]:.6g} from the equilibrium"
            return Event(run, "diverged", after.time, name, np.nan, reason)
        return min(found, key=lambda event: event.time)

    def _flux(self, winding: Winding, node: Node) -> FloatArray:
        """Flux density above a winding's limit, (r,) T."""
        path = winding.model.path(node.rates.places[:, 0, winding.member])
        linked = winding.model.flux_density(1.0) * winding.model.path(1.0) / float(winding.model.current)
        current = np.abs(winding.current + node.currents[:, self.saturating.index(winding)])
        return np.asarray(linked * current / path - (winding.limit or np.inf))


def _located(
    run: int,
    kind: EventKind,
    before: Node | None,
    after: Node,
    element: str,
    margins: list[float],
    slopes: list[float],
    reason: str,
) -> Event:
    """An event where a margin, positive inside, first vanishes: the cubic through both nodes' values and slopes."""
    if before is None or len(margins) == 1 or margins[0] <= 0.0:
        return Event(run, kind, after.time, element, abs(float(slopes[-1])), reason)
    width = after.time - before.time
    m0, m1 = margins
    share = m0 / (m0 - m1)
    speed = np.nan
    if np.all(np.isfinite(slopes)):
        d0, d1 = width * slopes[0], width * slopes[1]
        cubic = np.array([2.0 * m0 - 2.0 * m1 + d0 + d1, -3.0 * m0 + 3.0 * m1 - 2.0 * d0 - d1, d0, m0])
        roots = np.roots(cubic)
        inside = sorted(float(z.real) for z in roots if abs(z.imag) < 1e-9 and -1e-9 <= z.real <= 1.0 + 1e-9)
        share = inside[0] if inside else share
        speed = abs(float(np.polyval(np.polyder(cubic), share))) / width
    return Event(run, kind, before.time + share * width, element, speed, reason)
