"""The `[tuning]`, `[uncertainty]` and `[simulation]` parts of a scenario file, and the `[[option.tune]]` parts."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from maglev_ctrl.scenario.records import Many, Record
from maglev_ctrl.scenario.units import NonnegativeRatio, PositiveTime, Ratio, Time

Objective = Literal["ride", "gap", "stroke", "power", "force", "margin", "damping"]


class TuneRecord(Record):
    """One design variable of an option: a value of its file that tuning chooses."""

    value: str = Field(
        min_length=1, max_length=200,
        description='which value, by its name inside the option: "spring_damper.winding.damping", "control.damping"; '
        '"control" with choices',
    )  # fmt: skip
    low: str | float | None = Field(None, alias="from", description="smallest value, with its unit")
    high: str | float | None = Field(None, alias="to", description="largest value, with its unit")
    scale: Literal["logarithmic", "linear"] = Field("logarithmic", description="how values are spread between the two")
    choices: Many[dict[str, Any]] = Field(
        (), max_length=10, description="tables to choose from in place of a range: structures of the control law"
    )


class Tuning(Record):
    """How every option is tuned: all by the same method, against the same objectives, with the same budget."""

    objectives: Many[Objective] = Field(
        ("ride", "gap", "power"), min_length=2, max_length=4,
        description="what is traded: ride (worst passenger's weighted acceleration), gap and stroke (largest share of "
        "the clearance used by 3 sigma), power (supplied to all actuators), force (largest 3 sigma over the limit), "
        "margin (least disk margin, larger is better), damping (least damping ratio, larger is better)",
    )  # fmt: skip
    population: int = Field(24, ge=8, le=400, description="candidates of one generation")
    generations: int = Field(15, ge=1, le=2000, description="how often they are bred anew")
    seed: int = Field(1, ge=0, le=2**31 - 1, description="of the random numbers; another seed is another search")
    choose: Literal["knee", "ride", "gap", "stroke", "power", "force", "margin", "damping"] = Field(
        "knee", description="which point of the Pareto front is taken: its knee, or its best in one objective"
    )
    time_limit: PositiveTime | None = Field(None, description="of one option's search; left out: the generations")


class Uncertainty(Record):
    """How far parameters may be from their values, each way: of one mass or spring all are meant, each on its own."""

    magnetic_force: NonnegativeRatio = Field(0.0, description="stiffness and damping of the magnets")
    mass: NonnegativeRatio = Field(0.0, description="mass of each body")
    inertia: NonnegativeRatio = Field(0.0, description="moments of inertia of each body")
    stiffness: NonnegativeRatio = Field(0.0, description="springs")
    damping: NonnegativeRatio = Field(0.0, description="dampers")
    lag: NonnegativeRatio = Field(0.0, description="time constants of actuators")
    delay: NonnegativeRatio = Field(0.0, description="delays of actuators")


class Simulation(Record):
    """The check on the nonlinear vehicle."""

    duration: PositiveTime = Field(20.0, description="of one run")
    runs: int = Field(8, ge=2, le=200, description="runs over different guideways of the same spectrum")
    seed: int = Field(1, ge=0, le=2**31 - 1, description="of the first run's random numbers")
    settle: Time = Field(4.0, description="time at the start of a run that is left out of its statistics")
    sampling_period: PositiveTime | None = Field(None, description="of the control law; left out: continuous")
    computing_delay: Time = Field(0.0, description="from a sample to its command")
    smallest_growth: Ratio = Field(0.02, description="growth rates below this, 1/s, are not asked to agree in sign")
