"""The `[option.control]` part of a scenario file: which law drives the actuators, and what is asked of it."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from maglev_ctrl.scenario.records import Many, Name, Record
from maglev_ctrl.scenario.units import (
    AccelerationNoise,
    AnyQuantity,
    Damping,
    NonnegativeQuantity,
    NonnegativeRatio,
    Payload,
    PositiveLength,
    PositiveRatio,
    Rate,
    Speed,
    SpeedNoise,
    Time,
)

Scheduling = Literal["speed", "height", "gap", "payload"]
_SAMPLING = "sampling period of the computer that runs the law; exports are sampled with it and the loss is told"


class Allowed(Record):
    """A weight in engineering terms: the largest value of an output or of an actuator's force you would accept."""

    output: str | None = Field(
        None,
        max_length=100,
        description='e.g. "car.heave.acceleration", "car.pitch", "magnet_gap" (all magnets), "<element>.stroke"',
    )
    actuator: Name | None = Field(
        None,
        description='an actuator of this option, or windings of electromagnets: "magnet" (all), "<bogie>_magnet", '
        "or one magnet",
    )
    value: AnyQuantity = Field(description="largest value you would accept, above zero")


class Amount(Record):
    """An output or a freedom and a value of it."""

    output: str = Field(max_length=100, description="name of an output, or of a freedom of a body")
    value: AnyQuantity = Field(description="its value, above zero")


class Limit(Record):
    """A limit on an output that predictive control keeps."""

    output: str = Field(max_length=100, description='e.g. "magnet_gap", "cylinder.stroke"')
    value: AnyQuantity = Field(description="largest deviation from the equilibrium, either way")
    hard: bool = Field(False, description="true: never exceeded, or the step is infeasible; false: exceeded at a price")


class Corners(Record):
    """Operating points a law has to hold at: every combination of the values given (the design point is added)."""

    speed: Many[Speed] = Field((), max_length=8, description="speeds")
    payload: Many[Payload] = Field((), max_length=8, description="payloads")
    height: Many[PositiveLength] = Field((), max_length=8, description="levitation heights")
    gap: Many[PositiveLength] = Field((), max_length=8, description="guidance gaps")
    magnetic_stiffness: Many[PositiveRatio] = Field(
        (),
        max_length=4,
        description="factors on the magnets' stiffness, for what the force model may be wrong by",
    )


class _Sampled(Record):
    later_keys: ClassVar[frozenset[str]] = frozenset({"sampling_period"})

    sampling_period: Time | None = Field(None, description=_SAMPLING)


class _Weighted(_Sampled):
    allowed: Many[Allowed] = Field(min_length=2, description="weights of outputs and actuators")


class Lqr(_Weighted):
    """Linear-quadratic state feedback: every state is taken as measured."""

    law: Literal["lqr"]


class Lqi(_Weighted):
    """Linear-quadratic state feedback with integral action: chosen outputs have no steady error."""

    law: Literal["lqi"]
    integral: Many[Amount] = Field(
        min_length=1, description='outputs without steady error and the largest integral you would accept ("5 mm*s")'
    )


class Lqg(_Weighted):
    """Linear-quadratic feedback of the option's sensors through a Kalman filter."""

    law: Literal["lqg"]
    disturbance: AccelerationNoise = Field(description="acceleration noise density on every freedom of every body")


class _Disturbed(_Weighted):
    disturbance: AccelerationNoise = Field(description="acceleration noise density on every freedom of every body")
    command_disturbance: NonnegativeRatio = Field(
        0.0,
        description="density of a disturbance on every command, in allowed values per Hz^0.5; buys margins",
    )


class RiccatiLaw(_Disturbed):
    """H2 or H-infinity law by Riccati equations, of all states or of the option's sensors."""

    law: Literal["h2", "h_infinity"]
    feedback: Literal["states", "sensors"] = Field("states", description="what the law measures")
    guideway: SpeedNoise | None = Field(
        None, description="velocity density of the guideway's roughness as a further disturbance; sensors only"
    )
    back_off: PositiveRatio = Field(
        1.05, description="H-infinity only: the design's gamma over the smallest possible, above 1"
    )
    gain_bound: PositiveRatio | None = Field(
        None, description="H-infinity only: largest gain of the law, SI units; gamma is raised until it is met"
    )


class MultiObjective(_Disturbed):
    """State feedback by one linear matrix inequality: several requirements at once, over all corners."""

    law: Literal["multi_objective"]
    objective: Literal["h2", "h_infinity", "decay_rate", "gain", "none"] = Field(
        "h2", description="what is made small (decay_rate: large) within the other requirements"
    )
    h2_below: PositiveRatio | None = Field(None, description="bound on the H2 norm")
    h_infinity_below: PositiveRatio | None = Field(None, description="bound on the H-infinity norm")
    decay_rate: Rate | None = Field(None, description="every pole decays at least this fast")
    damping_ratio: PositiveRatio | None = Field(None, description="every pole has at least this damping ratio (sector)")
    fastest: Rate | None = Field(None, description="no pole is farther than this from the origin (disk)")
    gain_below: PositiveRatio | None = Field(
        None, description="bound on the gain: its largest singular value, SI units"
    )
    hold_from: Many[Amount] = Field(
        (), description="freedoms or velocities and how far off they may start without any command meeting its limit"
    )
    corners: Corners | None = Field(None, description="operating points the law has to hold at")
    lyapunov: Literal["common", "parameter_dependent"] = Field(
        "common", description="common: holds for any variation between the corners; parameter_dependent: for slow ones"
    )
    cross_check: bool = Field(False, description="solve again with a second solver and compare")
    time_limit: Time = Field(60.0, description="longest time for the solver")


class OutputFeedback(_Disturbed):
    """Static or low-order feedback of the option's sensors with a prescribed information pattern."""

    law: Literal["output_feedback"]
    objective: Literal["h2", "h_infinity", "decay_rate", "damping_ratio"] = Field(
        "h_infinity", description="what is made best"
    )
    order: int = Field(0, ge=0, le=6, description="states of the law; 0 = constant gains")
    links: Many[Annotated[Many[Name], Field(min_length=2, max_length=2)]] = Field(
        (),
        description="pairs [sensor, actuator] that are allowed, for constant gains; left out: every actuator sees "
        "every sensor",
    )
    corners: Corners | None = Field(None, description="operating points the law has to hold at")
    starts: int = Field(8, ge=1, le=500, description="starting points of the search")
    seed: int = Field(0, ge=0, description="seed of the random starting points")
    time_limit: Time = Field(60.0, description="longest time for the search")


class SkyHook(_Sampled):
    """Each actuator brakes the absolute velocity measured at its place."""

    law: Literal["sky_hook"]
    damping: Damping = Field(description="force per absolute velocity")
    sensor: Name = Field(
        description="a sensor of velocity (or acceleration, integrated), one per actuator, in the actuators' order"
    )


class HookedLaw(_Sampled):
    """Sky-hook, ground-hook, relative and gap-rate damping, alone or together.

    Each damping is a force per velocity and they add up; each uses the sensors that stand at its actuators.
    """

    law: Literal["damping"]
    sky: Damping = Field(0.0, description="per absolute velocity of the body the actuator pushes (velocity sensor)")
    ground: Damping = Field(0.0, description="per absolute velocity of the body it reacts on (velocity or gap sensor)")
    relative: Damping = Field(0.0, description="per velocity of the stroke between both (stroke or gap sensor)")
    gap_rate: Damping = Field(0.0, description="per rate of the gap to the guideway (gap sensor)")


class Scheduled(_Weighted):
    """State feedback whose gains follow an operating parameter."""

    law: Literal["scheduled"]
    over: Scheduling = Field(description="the parameter")
    nodes: Many[NonnegativeQuantity] = Field(
        min_length=2,
        max_length=60,
        description="its values at which laws are designed, the design point among or between them",
    )
    method: Literal["interpolated", "polytopic"] = Field(
        "interpolated",
        description="interpolated: linear-quadratic gains with a bound on how fast the parameter may change; "
        "polytopic: one Lyapunov matrix, however fast it changes",
    )
    fastest_change: AnyQuantity | None = Field(
        None, description='how fast the parameter changes at most, e.g. "1.5 m/s^2" for speed; judged against the proof'
    )
    time_limit: Time = Field(60.0, description="longest time for the solver")


class Predictive(Record):
    """Model predictive control within force limits, gap and stroke limits; a verified law takes over where it fails."""

    law: Literal["mpc"]
    allowed: Many[Allowed] = Field(min_length=2, description="weights of outputs and actuators")
    sampling_period: Time = Field(description="time between two steps")
    horizon: int = Field(30, ge=2, le=200, description="steps looked ahead")
    limits: Many[Limit] = Field((), alias="limit", description="limits on outputs, besides the actuators' force limits")
    start: Many[Amount] = Field((), description="shown manoeuvre: freedoms or velocities at its beginning")
    load: Many[Amount] = Field((), description="shown manoeuvre: constant accelerations of freedoms, from outside")
    duration: Time = Field(5.0, description="shown manoeuvre: how long")


ControlRecord = Annotated[
    Lqr | Lqi | Lqg | RiccatiLaw | MultiObjective | OutputFeedback | SkyHook | HookedLaw | Scheduled | Predictive,
    Field(discriminator="law"),
]
WEIGHTED = (Lqr, Lqi, Lqg, RiccatiLaw, MultiObjective, OutputFeedback, Scheduled, Predictive)
"""Laws with a list of allowed values."""
DISTURBED = (Lqg, RiccatiLaw, MultiObjective, OutputFeedback)
"""Laws that name the disturbance they are made against."""


class DampingBudget(Record):
    """Choose the damping of the option's passive dampers: the cheapest that is proved to decay fast enough.

    The dampers' own `damping` is where the search starts. The whole curve of cost against decay rate is shown.
    """

    decay_rates: Many[Rate] = Field(min_length=2, max_length=40, description="decay rates of the curve, rising")
    choose: Rate = Field(description="the decay rate the option is built with; one of decay_rates")
    costs: Many[PositiveRatio] = Field(
        (), description="price per N s/m of each spring_damper, in the file's order; left out: all equal"
    )
    largest: Damping | None = Field(None, description="largest damping at one place")
    corners: Corners | None = Field(None, description="operating points the dampers have to hold at")
    time_limit: Time = Field(120.0, description="longest time for the search")
