"""Figs. 5 and 6 and the claims of Secs. 4.1 and 4.2, from the image force of Eq. 15 and the assembled vehicles."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Final

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.forces import ImageForce, drag_ratio, lift_ratio
from maglev_ctrl.forces.image import characteristic_speed, drag_ratio_slope
from maglev_ctrl.study.paper.records import DataTable
from maglev_ctrl.vehicle import OperatingPoint, equilibrium, linearize
from maglev_ctrl.vehicle.models import STANDARD_GRAVITY, heave_pitch_surge, heave_surge

EXPONENTS: Final = (1.0, 1.0 / 3.0, 1.0 / 5.0)
# A vehicle for the numbers of Secs. 4.1 and 4.2, which give none: a 20 t vehicle over a 20 mm sheet.
MASS, HEIGHT, CONDUCTIVITY, SHEET, AIR = 20e3, 0.1, 2.5e7, 0.02, 0.5 * 0.3 * 10.0 * 1.2


@dataclass(frozen=True, slots=True)
class SurgeThreshold:
    """Where surge gains stability at constant thrust.

    `vehicle` from the eigenvalues of the assembled vehicle, `closed` = (m w g / 2 K_a)^(1/3), `printed` from the
    paper's Eq. 27 with its missing 1/m put in (NaN: stable at every speed), m/s.
    """

    exponent: float
    vehicle: float
    closed: float
    printed: float


def figure_tables() -> tuple[DataTable, DataTable]:
    """The numbers of Fig. 5 (force ratios over speed) and Fig. 6 (heave frequency over height)."""
    x = np.linspace(0.0, 20.0, 401)
    ratios = [column for n in EXPONENTS for column in (lift_ratio(x, n), drag_ratio(x, n))]
    names = [f"eps_{force} n={name}" for name in ("1", "1/3", "1/5") for force in ("L", "D")]
    gap = np.linspace(0.005, 0.3, 296)
    frequency = np.sqrt(STANDARD_GRAVITY / gap) / (2.0 * pi)
    heave = [assembled_heave_frequency(float(z)) if i % 15 == 0 else np.nan for i, z in enumerate(gap)]
    return (
        DataTable("fig05_force_ratios", ("v/w", *names), read_only_any(np.column_stack([x, *ratios]))),
        DataTable(
            "fig06_heave_frequency", ("z0 (mm)", "f_v of Eq. 25 (Hz)", "f_v of the assembled vehicle (Hz)"),
            read_only_any(np.column_stack([1e3 * gap, frequency, heave])),
        ),
    )  # fmt: skip


def assembled_heave_frequency(height: float, *, speed: float = 100.0) -> float:
    """Heave frequency in Hz of the assembled heave-surge vehicle: the imaginary part of its oscillating pair."""
    s = _spectrum(1.0, height, speed)
    return float(np.max(s.imag)) / (2.0 * pi)


def drag_peaks() -> tuple[tuple[float, float, float], ...]:
    """Exponent, v/w and eps_D of the drag peak of each curve of Fig. 5."""
    found = []
    for n in EXPONENTS:
        at = float(brentq(lambda x, n=n: float(drag_ratio_slope(x, n)), 0.3, 5.0))
        found.append((n, at, float(drag_ratio(at, n))))
    return tuple(found)


def surge_bracket(x: FloatArray | float, exponent: float) -> tuple[FloatArray, FloatArray]:
    """The bracket of C_xx in Eq. 22 at x = v/w: as printed (parenthesis mended) and exact.

    Examples
    --------
    >>> [round(float(part), 4) for part in surge_bracket(2.0, 1.0 / 3.0)]
    [0.4667, -0.2488]
    """
    square = np.asarray(x, dtype=np.float64) ** 2
    printed = (1.0 - (2.0 * exponent - 1.0) * square) / (1.0 + square)
    exact = 2.0 * exponent * square * (1.0 + square) ** (-exponent - 1.0) / (1.0 - (1.0 + square) ** -exponent) - 1.0
    return printed, exact


def surge_thresholds() -> tuple[SurgeThreshold, ...]:
    """Speed above which surge is stable, for each exponent, in two ways and as the paper's Eq. 27 would have it."""
    w = characteristic_speed(CONDUCTIVITY, SHEET)
    closed = (MASS * w * STANDARD_GRAVITY / (2.0 * AIR)) ** (1.0 / 3.0)
    found = []
    for n in EXPONENTS:
        vehicle = float(brentq(lambda v, n=n: float(np.max(_spectrum(n, HEIGHT, v).real)), 20.0, 150.0, xtol=1e-10))
        factor = 2.0 * n - 1.0
        printed = (factor * MASS * w * STANDARD_GRAVITY / (2.0 * AIR)) ** (1.0 / 3.0) if factor > 0.0 else np.nan
        found.append(SurgeThreshold(n, vehicle, closed, float(printed)))
    return tuple(found)


def growth_without_air() -> tuple[float, ...]:
    """Surge growth rate (1/s) at 100 m/s without air drag, for each exponent; the paper expects it for n = 1 only."""
    return tuple(float(np.max(_spectrum(n, HEIGHT, 100.0, air=0.0).real)) for n in EXPONENTS)


def heave_decay() -> float:
    """Re s (1/s) of heave at 100 m/s, n = 1: the damping that quasi-static theory leaves it."""
    s = _spectrum(1.0, HEIGHT, 100.0)
    return float(s[int(np.argmax(s.imag))].real)


def receding_heave_growth() -> float:
    """Re s (1/s) of heave at 100 m/s when the images recede: a line current, n = 1 (Davis and Wilkie)."""
    s = _spectrum(1.0, HEIGHT, 100.0, receding=True)
    return float(s[int(np.argmax(s.imag))].real)


def pitch_ratio(height_to_length: float) -> float:
    """f_p / f_v of the assembled heave-pitch-surge vehicle, a uniform block with magnets at its ends."""
    length = 10.0
    inertia = MASS * length**2 * (1.0 + height_to_length**2) / 12.0
    coil = _coil(1.0, 0.5 * MASS)
    vehicle = heave_pitch_surge(
        MASS, pitch_inertia=inertia, spacing=length, force=coil, reference_height=HEIGHT, drag_factor=AIR
    )
    system = linearize(vehicle, equilibrium(vehicle, OperatingPoint(100.0, HEIGHT)))
    pitch, heave = system.dofs.index("car.pitch"), system.dofs.index("car.heave")
    squares = [system.K[i, i] / system.M[i, i] for i in (pitch, heave)]
    return float(np.sqrt(squares[0] / squares[1]))


def slenderness_of_printed_square() -> float:
    """The h/L that would give f_p = 1.4 f_v."""
    result = minimize_scalar(lambda r: (np.sqrt(3.0 / (1.0 + r**2)) - 1.4) ** 2, bounds=(0.1, 2.0), method="bounded")
    return float(result.x)


def _coil(exponent: float, mass: float, *, height: float = HEIGHT, receding: bool = False) -> ImageForce:
    return ImageForce.for_lift(
        mass * STANDARD_GRAVITY, height, 100.0, length=1.0, conductivity=CONDUCTIVITY, thickness=SHEET,
        exponent=exponent, vertical_velocity="receding_image" if receding else "none",
    )  # fmt: skip


def _spectrum(exponent: float, height: float, speed: float, *, air: float = AIR, receding: bool = False) -> FloatArray:
    """Eigenvalues of the assembled heave-surge vehicle, trimmed at the height and speed."""
    coil = _coil(exponent, MASS, height=height, receding=receding)
    vehicle = heave_surge(MASS, force=coil, reference_height=height, drag_factor=air)
    system = linearize(vehicle, equilibrium(vehicle, OperatingPoint(speed, height)))
    return np.asarray(np.linalg.eigvals(system.state_matrix()))
