"""Records of ride, worst cases, nonlinear check and tuning made by hand, with numbers of a real size."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Literal

import numpy as np
import report_fixture

from maglev_ctrl.analysis.response.records import (
    AccelerationSpectrum,
    ActuatorDemand,
    ClearanceStatistics,
    PassengerRide,
    RideResponse,
)
from maglev_ctrl.analysis.response.weighting import comfort_class
from maglev_ctrl.analysis.robustness.records import FactorBounds, WorstCase, WorstPoint
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import Agreement, Verdict
from maglev_ctrl.study.nonlinear.records import Compared, NonlinearStudy, SimulatedEvent, SimulatedSignal
from maglev_ctrl.study.records import Comparison, OptionStudy, RequirementResult
from maglev_ctrl.study.ride_records import FlexibleSpan, MaskResult, RidePoint, RideStudy, SpanPassing, StepPassing
from maglev_ctrl.study.tuning.records import (
    ObjectiveAxis,
    RankedOption,
    RankingShift,
    TunedOption,
    TunedVariable,
    TuningStudy,
)

SPEED = report_fixture.SPEED
AGREED, UNRESOLVED = Agreement.AGREED, Agreement.UNRESOLVED
PLACES = (
    ("front row", 12.0),
    ("over front bogie", 7.0),
    ("centre", 0.0),
    ("over rear bogie", -7.0),
    ("rear row", -12.0),
)


def passenger(name: str, x: float, vertical: float, lateral: float, *, reason: str = "") -> PassengerRide:
    """One position with its total; without numbers where there is a reason."""
    weighted = np.array([vertical, lateral]) if not reason else np.full(2, math.nan)
    total = float(np.hypot(*weighted))
    return PassengerRide(
        name, x, 0.0, ("vertical", "lateral"), weighted, 1.4 * weighted, total, comfort_class(total),
        UNRESOLVED if reason else AGREED, reason,
    )  # fmt: skip


def clearance(
    name: str, kind: Literal["gap", "stroke"], nominal: float, room: float, deviation: float
) -> ClearanceStatistics:
    """A gap or stroke; crossings by Rice's formula at a typical 1.2 Hz."""
    sag = 0.004 if kind == "gap" else 0.0
    rate = 1.2 * math.exp(-0.5 * ((room - sag) / deviation) ** 2)
    return ClearanceStatistics(
        name, kind, nominal, room, sag, deviation, 3.0 * deviation, (3.0 * deviation + sag) / room, rate,
        1.0 - math.exp(-3600.0 * rate), AGREED, "",
    )  # fmt: skip


def actuator(name: str, force: float, *, limit: float = 60e3) -> ActuatorDemand:
    """An actuator that takes part of its power back."""
    share = 3.0 * force / limit
    saturated = math.erfc(limit / force / math.sqrt(2.0))
    return ActuatorDemand(
        name, force, 9.0 * force, 0.12, -0.01 * force, 0.05 * force, 0.05 * force * 3600.0, limit, share, saturated,
        AGREED, "",
    )  # fmt: skip


def density(frequency: FloatArray, level: float, peak: float) -> FloatArray:
    """A resonance over a slope."""
    ratio = frequency / peak
    return level * ratio**2 / ((1.0 - ratio**2) ** 2 + (0.3 * ratio) ** 2) / (1.0 + (frequency / 8.0) ** 4)


def response(
    *, level: float = 1.0, speed: float = SPEED, active: bool = True, open_point: bool = False
) -> RideResponse:
    """The ride at one speed; `level` scales everything that moves."""
    shape = 1.0 + 0.5 * np.abs([x / 12.0 for _, x in PLACES])
    people = [
        passenger(name, x, 0.24 * level * s, 0.09 * level * s) for (name, x), s in zip(PLACES, shape, strict=True)
    ]
    if open_point:
        people[-1] = passenger("rear row", -12.0, 0.0, 0.0, reason="the two methods differ by 3 %")
    gaps = [
        clearance(f"magnet_{side}_{k}", "gap", 0.2, 0.15, 0.011 * level * (1.0 + 0.03 * k))
        for side in ("front", "rear") for k in range(8)
    ]  # fmt: skip
    strokes = [clearance(f"secondary_{side}", "stroke", 0.0, 0.08, 0.012 * level) for side in ("front", "rear")]
    frequency = np.geomspace(0.1, 50.0, 160)
    spectra = [
        AccelerationSpectrum(name, axis, frequency, density(frequency, gain * level**2, peak * (1.0 + 0.004 * x)))
        for axis, gain, peak in (("vertical", 0.02, 1.1), ("lateral", 0.004, 0.7))
        for name, x in PLACES
    ]
    own = tuple(actuator(f"cylinder_{side}", 9e3 * level) for side in ("front", "rear")) if active else ()
    verdict = UNRESOLVED if open_point else AGREED
    return RideResponse(
        speed, tuple(people), tuple(gaps + strokes), own, tuple(spectra), verdict, 0.03 if open_point else 2.1e-8,
        "rear row: the two methods differ by 3 %" if open_point else "",
    )  # fmt: skip


def mask(found: RideResponse | None, name: str, axis: str, factor: float) -> MaskResult:
    """A mask straight on logarithmic axes, and the largest ratio to it."""
    assert found is not None
    at, height = np.array([0.1, 1.0, 4.0, 8.0, 50.0]), factor * np.array([0.02, 0.1, 0.02, 0.008, 0.0004])
    curve = next(s for s in found.spectra if (s.passenger, s.axis) == (name, axis))
    ratio = curve.density / np.exp(np.interp(np.log(curve.frequency), np.log(at), np.log(height)))
    worst = int(np.argmax(ratio))
    return MaskResult(name, axis, float(ratio[worst]), float(curve.frequency[worst]), at, height)


def ride(*, level: float = 1.0, active: bool = True, open_point: bool = False) -> RideStudy:
    """Nine speeds at two payloads, girders, a moving beam, a step, and a mask."""
    first = RidePoint("the design point", SPEED, 20e3, response(level=level, active=active, open_point=open_point), "")
    points = [first]
    for payload in (0.0, 20e3):
        for speed in np.linspace(100.0, 550.0, 9) / 3.6:
            told = f"{speed * 3.6:.0f} km/h, payload {payload / 1e3:.0f} t"
            gone = payload == 0.0 and speed > 540.0 / 3.6
            scale = level * (0.4 + 0.6 * (speed / SPEED) ** 1.5) * (1.0 if payload else 1.12)
            found = None if gone else response(level=scale, speed=float(speed), active=active)
            points.append(RidePoint(told, float(speed), payload, found, "the loop is not stable there" if gone else ""))
    masks = tuple(
        mask(first.response, *which) for which in (("front row", "vertical", 1.0), ("rear row", "lateral", 2.0))
    )
    speeds = np.linspace(60.0, 550.0, 120) / 3.6
    peaks = ((1.0, 40.0), (0.5, 97.0))
    hump = np.sum([a / np.sqrt((1.0 - (speeds / v) ** 2) ** 2 + 0.02) for a, v in peaks], axis=0)
    passing = SpanPassing(
        span=25.0, sag=0.004, speeds=speeds, gap=1.1e-3 * level * hump, acceleration=0.09 * level * hump,
        design_gap=1.6e-3 * level, design_acceleration=0.13 * level, worst_speed=40.0, worst_gap=7.9e-3 * level,
        worst="the girders meet the mode of 1.6 Hz", check=3.2e-9, reason="",
    )  # fmt: skip
    flexible = FlexibleSpan(6.4, 0.434, 4.6e-3, 4.0e-3, 1.9e-3 * level, 0.15 * level, "stable", "")
    step = StepPassing(0.003, 0.1, 2.7e-3 * level, 0.61 * level, "")
    words = "S(Ω) = A/Ω², A = 1.5e-6 m (standard of the Warwick study)"
    return RideStudy(tuple(points), masks, passing, flexible, step, words)


def worst_case(*, stable: Verdict = Verdict.PASS) -> WorstCase:
    """Four uncertain parameters; the margin between the guaranteed and the found factor is 4 %."""
    names = ("car.mass", "magnets.magnetic_force", "secondary_front.stiffness", "cylinder_front.delay")
    spreads = np.array([0.1, 0.05, 0.1, 0.2])

    def point(nominal: float, value: float, changes: list[float], frequency: float, *, fine: bool = True) -> WorstPoint:
        at = np.array(changes)
        return WorstPoint(
            nominal, value, at, 100.0 * at * spreads, 2.0 * math.pi * frequency, fine, "" if fine else "no margin there"
        )

    scale = {Verdict.PASS: 2.6, Verdict.NOT_EVALUATED: 0.97, Verdict.FAIL: 0.7}[stable]
    factor = FactorBounds(
        scale, 1.12 * scale if stable is Verdict.NOT_EVALUATED else 1.04 * scale,
        1.04 * scale * np.array([1.0, 1.0, -0.4, 1.0]), 2.0 * math.pi * 1.31, 3.2e-10, 5.0, 4,
        UNRESOLVED if stable is Verdict.NOT_EVALUATED else AGREED, "",
    )  # fmt: skip
    return WorstCase(
        names, spreads, stable, factor, point(-0.42, -0.18, [1.0, 1.0, -1.0, 1.0], 1.2),
        point(0.11, 0.054, [1.0, 1.0, -0.6, 1.0], 1.2), point(0.71, 0.48, [-1.0, 1.0, 1.0, 1.0], 3.4), AGREED, "", 4.2,
    )  # fmt: skip


def nonlinear(*, contact: bool = False) -> NonlinearStudy:
    """Eight runs; with contact: events, a disagreement and saturation."""
    time = np.linspace(0.0, 20.0, 800)
    rng = np.random.default_rng(3)

    def noise(size: float, frequency: float) -> FloatArray:
        phases = rng.uniform(0.0, 2.0 * math.pi, 12)
        tones = frequency * np.linspace(0.5, 1.8, 12)
        waves = np.cos(2.0 * math.pi * tones[:, None] * time + phases[:, None])
        return np.asarray(size / math.sqrt(6.0) * np.sum(waves, axis=0))

    compared = [
        Compared("standard deviation of the gap of magnet_front_0", "mm", 11.0, 11.3, 10.6, 12.1, AGREED, ""),
        Compared("weighted vertical acceleration, front row", "m/s^2", 0.384, 0.391, 0.362, 0.424, AGREED, ""),
        Compared("standard deviation of the force of cylinder_front", "kN", 9.0, 8.8, 8.3, 9.4, AGREED, ""),
    ]
    events: tuple[SimulatedEvent, ...] = ()
    if contact:
        compared[0] = Compared(
            "standard deviation of the gap of magnet_front_0", "mm", 28.0, 34.1, 31.2, 37.7, UNRESOLVED,
            "the linear value lies outside the band: forces grow faster than linearly at small gaps",
        )  # fmt: skip
        events = (
            SimulatedEvent(2, 7.31, "contact", "magnet_front_3", 0.42, "the gap closes at 0.42 m/s"),
            SimulatedEvent(5, 12.9, "outside the force data", "magnet_rear_7", math.nan, "height 21 mm below the data"),
        )
    signals = (
        SimulatedSignal("gap of magnet_front_0", "mm", 200.0 + noise(11.0, 1.2)),
        SimulatedSignal("vertical acceleration, front row", "m/s^2", noise(0.5, 1.4)),
        SimulatedSignal("force of cylinder_front", "kN", np.clip(noise(9.0, 1.2), -14.0, 14.0)),
    )
    return NonlinearStudy(
        8, 20.0, 1, 1e-3, 2.4e-5, SPEED, tuple(compared), events,
        (("cylinder_front", 0.031 if contact else 0.0), ("cylinder_rear", 0.0)),
        "settles on a limit cycle of 3.1 mm at 1.4 Hz" if contact else "",
        (("car heave", 0.02, 8, 8), ("car heave", 0.05, 5, 8)), time, signals,
        ("forces over the full map of the magnets", "actuators with their lag, delay and limit"), 41.0,
    )  # fmt: skip


def _front(best: tuple[float, float, float], count: int, seed: int) -> FloatArray:
    """Points of which none betters another: ride against power, gap along with ride."""
    along = np.sort(np.random.default_rng(seed).uniform(0.0, 1.0, count))
    ride_, power = best[0] * (1.0 + 0.8 * along), best[2] * (0.15 + (1.0 - along) ** 2)
    return np.column_stack([ride_, best[1] * (1.0 + 0.3 * (1.0 - along) ** 1.5), power])


def tuning() -> TuningStudy:
    """Three options: one without variables that misses a hard requirement, two searched."""
    axes = (
        ObjectiveAxis("ride", "worst weighted acceleration", "m/s²", 1.0, "smaller"),
        ObjectiveAxis("gap", "largest share of a gap used", "%", 100.0, "smaller"),
        ObjectiveAxis("power", "supplied power", "kW", 1e-3, "smaller"),
    )
    damping = TunedVariable("spring_damper.winding.damping", "damping of the windings", "kN s/m", 1e-3, 1e3, 5e4, 5e4,
                            "50.0 kN s/m", "upper")  # fmt: skip
    weight = TunedVariable("control.output.0.weight", "weight of the car's acceleration", "", 1.0, 0.1, 10.0, 1.73,
                           "1.73", "")  # fmt: skip
    choice = TunedVariable("control", "law", "", 1.0, 0.0, 2.0, 1.0, "H-infinity (2 of 3)", "")
    passive, active = _front((0.41, 0.31, 0.0), 9, 1), _front((0.22, 0.26, 2.1e3), 18, 2)
    passive[:, 2] = 0.0
    searched = ("generations", 1, 92.0)
    options = (
        TunedOption("bare", "No added suspension", "baseline", (), np.array([[0.93, 0.61, 0.0]]), np.zeros((1, 0)), 0,
                    0, False, "stable", 0.82, 1, 0, 0, "no variables", 1, 0.4, ""),
        TunedOption("windings", "Damper windings", "passive_primary", (damping,), passive, np.full((9, 1), 5e4), 2, 2,
                    True, "", 0.0, 600, 3, 25, *searched, ""),
        TunedOption("lqr", "Active secondary, LQR", "active_secondary", (weight, choice), active,
                    np.tile([1.73, 1.0], (18, 1)), 6, 7, True, "", 0.0, 600, 0, 25, *searched, ""),
    )  # fmt: skip
    ranking = (
        RankedOption("lqr", "Active secondary, LQR", 1, 0.31, ()),
        RankedOption("windings", "Damper windings", 2, 0.52, ()),
        RankedOption("bare", "No added suspension", 3, 1.41, ("stable", "damping")),
    )
    shifts = (
        RankingShift("weight of supplied power", 2.0, (2, 1, 3), "windings", True),
        RankingShift("weight of supplied power", 0.5, (1, 2, 3), "lqr", False),
        RankingShift("limit of ride", 1.2, (1, 2, 3), "lqr", False),
        RankingShift("limit of ride", 0.8, (1, 2, 3), "lqr", False),
    )
    situations = ("design point", "100 km/h", "550 km/h, payload 0 t")
    return TuningStudy(
        method="NSGA-II, population 24, 25 generations, seed 1", in_loop=("stable", "damping", "disk", "ride"),
        after=("modulation",), objectives=axes, situations=situations, options=options, ranking=ranking, shifts=shifts,
        seconds=185.0,
    )  # fmt: skip


def wish(*, met: bool = False) -> RequirementResult:
    """A soft requirement on power."""
    verdict, margin = (Verdict.PASS, 30.0) if met else (Verdict.FAIL, -20.0)
    return RequirementResult(
        "little_power", "supplied_power", "power that all actuators draw", "at_most", 750.0, 525.0 if met else 900.0,
        "W", verdict, margin, "the design point", "covariance equations", "" if met else "outside the limit", "exact",
        hard=False,
    )  # fmt: skip


def comfort(value: float = 0.39) -> RequirementResult:
    """A hard requirement on the ride."""
    verdict = Verdict.PASS if value <= 0.315 else Verdict.FAIL
    return RequirementResult(
        "ride", "weighted_acceleration", "frequency-weighted acceleration of the worst passenger", "at_most", 0.315,
        value, "m/s^2", verdict, 100.0 * (0.315 - value) / 0.315, "the design point", "covariance and frequency", 
        "" if verdict is Verdict.PASS else "outside the limit", "exact",
    )  # fmt: skip


def plain_option(name: str, label: str, kind: str, *requirements: RequirementResult) -> OptionStudy:
    """An option of which nothing but its vehicle and requirements is known."""
    return OptionStudy(
        name=name, label=label, kind=kind, summary=(), vehicle=report_fixture.train(), failure="", equilibrium=None,
        system=None, open_system=None, modes=None, design=None, sweeps=(), locus=None, margins=None, margins_reason="",
        nyquist=(), floquet=None, floquet_reason="", requirements=requirements, notes=(), seconds=0.0,
    )  # fmt: skip


def enriched(found: Comparison) -> Comparison:
    """A comparison of three options with every new part: the first unresolved and in contact, the last all well."""
    bare, windings, lqr = found.options
    return replace(
        found, tuning=tuning(),
        options=(
            replace(bare, ride=ride(level=2.2, active=False, open_point=True),
                    robustness_reason="the loop is not stable", nonlinear=nonlinear(contact=True),
                    requirements=(*bare.requirements, comfort(0.86))),
            replace(windings, ride=ride(level=1.3, active=False), robustness=worst_case(stable=Verdict.NOT_EVALUATED),
                    nonlinear_reason="the time limit of the study was reached",
                    requirements=(*windings.requirements, comfort(0.45))),
            replace(lqr, ride=ride(level=0.7), robustness=worst_case(), nonlinear=nonlinear(),
                    requirements=(*lqr.requirements, comfort(0.27), wish())),
        ),
    )  # fmt: skip


@cache
def small() -> Comparison:
    """The three options without modes and maps, quick to make."""
    made = (
        ("bare", "No added suspension", "baseline"), ("windings", "Damper windings", "passive_primary"),
        ("lqr", "Active secondary, LQR", "active_secondary"),
    )  # fmt: skip
    return enriched(Comparison(
        title="Three ways to suspend a test train", description="d", scenario_path="tests/three.toml",
        scenario_text="format = 1", scenario_hash="0" * 64, sources=(), assumptions=(), forces=(), design_speed=SPEED,
        design_height=report_fixture.HEIGHT, options=tuple(plain_option(*names) for names in made), versions=(),
        created="2026-01-01T00:00:00Z", seconds=3.0,
    ))  # fmt: skip
