"""Attractive electromagnet under a rail: force, flux and their partials (EMS levitation).

Iron core and rail close a magnetic circuit with two air gaps. With c the length of the iron over its relative
permeability, the circuit is as long as l = 2 g + c of air, and with the windings N, the pole area S and the current i

    flux linkage  psi = L i,   L = mu0 N^2 S / l + L_leak
    force         F = -(i^2 / 2) dL/dg = mu0 N^2 i^2 S / l^2         pulls the magnet up, towards the rail
    voltage       v = R i + d psi/dt

(P. K. Sinha, Electromagnetic Suspension, 1987, ch. 2.) About a standing current i0 and gap g0, all changes small,

    F = F0 + K_i i - K_s g,          K_i = 2 F0 / i0,   K_s = 4 F0 / l
    v = R i + L i' - K_i g'          the same K_i: d psi/dg = -dF/di, because both come from one energy

A gap that opens loses force: K_s > 0 is a negative stiffness. Fringing, saturation, hysteresis, lateral forces and
the eddy currents of a moving magnet in a solid rail (its drag) are left out.
"""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.errors import OutOfDomain
from maglev_ctrl.forces.base import (
    EDGE_TOLERANCE,
    AbstractForceModel,
    Domain,
    MagnetDerivatives,
    MagnetForces,
    checked_factor,
    no_forces,
)
from maglev_ctrl.forces.image import MAGNETIC_CONSTANT

Drive = Literal["voltage", "current"]

_EVERYWHERE = Domain(height=(0.0, np.inf), gap=None, speed=(-np.inf, np.inf))


@dataclass(frozen=True, eq=False, slots=True)
class Electromagnet(AbstractForceModel):
    """One attractive magnet; its "height" is the air gap g between pole face and rail, which closes as it rises.

    Parameters
    ----------
    current : standing current i0, A (an array after `scaled` by an array)
    turns : N
    pole_area : S of one pole face, m^2
    resistance : R of the winding, ohm
    leakage : inductance of the flux that misses the rail, H; it takes no part in the force
    iron_gap : c, length of the iron path over its relative permeability, m
    flux_limit : flux density in the gap above which the iron saturates and the model refuses, T; None = no limit
    drive : "voltage": the current follows from the winding's voltage; "current": the current is commanded

    Raises
    ------
    ValueError : turns, area or current that are not positive, a resistance or leakage that is negative

    Examples
    --------
    >>> magnet = Electromagnet.for_lift(32.5e3, 0.01, turns=300, pole_area=0.0967, resistance=4.0)
    >>> round(float(magnet.current), 2), round(float(magnet.flux_density(0.01)), 3)
    (34.48, 0.65)
    """

    current: float | FloatArray
    _: KW_ONLY
    turns: float
    pole_area: float
    resistance: float
    leakage: float = 0.0
    iron_gap: float = 0.0
    flux_limit: float | None = None
    drive: Drive = "voltage"

    def __post_init__(self) -> None:
        limit = {} if self.flux_limit is None else {"flux_limit": self.flux_limit}
        for name, value in {"turns": self.turns, "pole_area": self.pole_area, **limit}.items():
            if not (np.isfinite(value) and value > 0.0):
                raise ValueError(f"{name}: expected a positive number, got {value}")
        for name in ("resistance", "leakage", "iron_gap"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise ValueError(f"{name}: expected a number that is not negative, got {value}")
        if not (np.all(np.isfinite(self.current)) and np.all(np.asarray(self.current) > 0.0)):
            raise ValueError(f"current: expected a positive current, got {self.current}")
        if self.drive not in ("voltage", "current"):
            raise ValueError(f"drive: expected 'voltage' or 'current', got {self.drive!r}")

    @classmethod
    def for_lift(
        cls,
        lift: float,
        gap: float,
        *,
        turns: float,
        pole_area: float,
        resistance: float,
        leakage: float = 0.0,
        iron_gap: float = 0.0,
        flux_limit: float | None = None,
        drive: Drive = "voltage",
    ) -> Electromagnet:
        """The magnet whose standing current gives `lift` (N) at `gap` (m).

        Raises
        ------
        ValueError : a lift that is not positive
        OutOfDomain : the iron would saturate
        """
        if not (np.isfinite(lift) and lift > 0.0):
            raise ValueError(f"lift: expected a positive number, got {lift}")
        unit = cls(
            1.0, turns=turns, pole_area=pole_area, resistance=resistance, leakage=leakage, iron_gap=iron_gap,
            drive=drive,
        )  # fmt: skip
        found = replace(unit.scaled(lift / float(unit.forces(gap, None, 0.0).lift)), flux_limit=flux_limit)
        found.require_unsaturated(gap)
        return found

    @property
    def domain(self) -> Domain:
        """Every open gap and every speed; the guidance gap does not matter."""
        return _EVERYWHERE

    @property
    def hangs(self) -> bool:
        """True: it hangs under its rail."""
        return True

    def path(self, gap: ArrayLike) -> FloatArray:
        """l = 2 g + c, the magnetic circuit as a length of air, m."""
        return np.asarray(2.0 * np.asarray(gap, dtype=np.float64) + self.iron_gap)

    def pull(self, gap: ArrayLike, current: ArrayLike) -> FloatArray:
        """F = mu0 N^2 i^2 S / l^2 at any current, N; (...).

        Examples
        --------
        >>> magnet = Electromagnet(10.0, turns=100, pole_area=0.01, resistance=1.0)
        >>> bool(magnet.pull(0.01, 20.0) == 4.0 * magnet.pull(0.01, 10.0))
        True
        """
        return np.asarray(self._square * np.asarray(current, dtype=np.float64) ** 2 / self.path(gap) ** 2)

    def inductance(self, gap: ArrayLike) -> FloatArray:
        """L = mu0 N^2 S / l + L_leak, H; (...)."""
        return np.asarray(self._square / self.path(gap) + self.leakage)

    def flux_linkage(self, gap: ArrayLike, current: ArrayLike) -> FloatArray:
        """psi = L i at any current, V s; (...)."""
        return np.asarray(self.inductance(gap) * np.asarray(current, dtype=np.float64))

    def flux_density(self, gap: ArrayLike, *, strength: float = 1.0) -> FloatArray:
        """B = mu0 N i0 / l in the gap with the forces times `strength`, T; (...)."""
        standing = np.sqrt(strength) * np.asarray(self.current, dtype=np.float64)
        return np.asarray(MAGNETIC_CONSTANT * self.turns * standing / self.path(gap))

    def require_unsaturated(self, gap: ArrayLike, *, strength: float = 1.0) -> None:
        """Refuse a flux density above the limit, where the force no longer follows the square of the current.

        Parameters
        ----------
        gap : (...) m
        strength : factor on the forces; the current goes with its square root

        Raises
        ------
        OutOfDomain : above `flux_limit`
        """
        if self.flux_limit is None:
            return
        highest = float(np.max(self.flux_density(gap, strength=strength), initial=0.0))
        if highest > self.flux_limit * (1.0 + EDGE_TOLERANCE):
            raise OutOfDomain(
                f"flux density {highest:.4g} T in the gap is above the {self.flux_limit:.4g} T at which the iron "
                "saturates"
            )

    def unlimited(self) -> Electromagnet:
        """The same magnet without its flux limit, for who checks it at another strength."""
        return replace(self, flux_limit=None)

    def forces(self, height: ArrayLike, gap: ArrayLike | None, speed: ArrayLike) -> MagnetForces:
        """Lift at the standing current; no guidance, no drag."""
        lift = self._lift(height, gap, speed)
        return MagnetForces(lift=lift, guidance=np.zeros(()), drag=np.zeros(()))

    def derivatives(self, height: ArrayLike, gap: ArrayLike | None, speed: ArrayLike) -> MagnetDerivatives:
        """Partials at a standing current: only dF/dg = -4 F / l is not zero."""
        lift = self._lift(height, gap, speed)
        nothing = no_forces(lift.shape)
        return MagnetDerivatives(
            by_height=MagnetForces(lift=-4.0 * lift / self.path(height), guidance=np.zeros(()), drag=np.zeros(())),
            by_gap=nothing,
            by_speed=nothing,
            by_vertical_velocity=nothing,
            by_lateral_velocity=nothing,
        )

    def scaled(self, factor: ArrayLike) -> Electromagnet:
        """The same magnet with its current times the square root of `factor`.

        Examples
        --------
        >>> Electromagnet(10.0, turns=100, pole_area=0.01, resistance=1.0).scaled(4.0).current
        20.0
        """
        current = np.asarray(self.current * np.sqrt(checked_factor(factor)))
        return replace(self, current=float(current) if current.ndim == 0 else read_only_any(current))

    @property
    def _square(self) -> float:
        """mu0 N^2 S, H m."""
        return MAGNETIC_CONSTANT * self.turns**2 * self.pole_area

    def _lift(self, height: ArrayLike, gap: ArrayLike | None, speed: ArrayLike) -> FloatArray:
        self.domain.require(height, gap, speed)
        self.require_unsaturated(height)
        lift = self.pull(height, self.current)
        return np.asarray(lift + np.zeros(np.broadcast_shapes(np.shape(speed), () if gap is None else np.shape(gap))))


@dataclass(frozen=True, eq=False, slots=True)
class Circuit:
    """An electromagnet about a standing current and gap, everything of one magnet.

    `current` i0 A; `force` F0 N; `force_by_current` K_i, N/A and V s/m; `force_by_closing` K_s = -dF/dg, N/m;
    `inductance` L, H; `resistance` R, ohm.
    """

    current: float
    force: float
    force_by_current: float
    force_by_closing: float
    inductance: float
    resistance: float

    @property
    def voltage(self) -> float:
        """R i0, V."""
        return self.resistance * self.current

    @property
    def power(self) -> float:
        """R i0^2, W: what levitation costs."""
        return self.resistance * self.current**2


def circuit(magnet: Electromagnet, gap: float, *, strength: float = 1.0) -> Circuit:
    """The linearised magnet at a gap, with its forces times `strength`.

    Raises
    ------
    OutOfDomain : a closed gap, or saturated iron
    ValueError : a magnet that stands for several, with an array of currents

    Examples
    --------
    >>> magnet = Electromagnet.for_lift(1000.0 * 9.80665, 0.01, turns=300, pole_area=0.03, resistance=1.0)
    >>> found = circuit(magnet, 0.01)
    >>> round((found.force_by_closing / 1000.0) ** 0.5, 2)                      # sqrt(2 * 9.80665 / 0.010)
    44.29
    """
    if np.ndim(magnet.current):
        raise ValueError(f"current: expected one magnet, got currents of shape {np.shape(magnet.current)}")
    held = magnet.unlimited().scaled(strength)
    magnet.require_unsaturated(gap, strength=strength)
    force = float(held.forces(gap, None, 0.0).lift)
    standing = float(held.current)
    return Circuit(
        current=standing,
        force=force,
        force_by_current=2.0 * force / standing,
        force_by_closing=4.0 * force / float(held.path(gap)),
        inductance=float(held.inductance(gap)),
        resistance=held.resistance,
    )
