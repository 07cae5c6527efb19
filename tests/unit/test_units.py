"""Units at the border."""

from __future__ import annotations

import math

import pytest
from pydantic import BaseModel, ValidationError

from maglev_ctrl.scenario import units
from maglev_ctrl.scenario.units import (
    Bandwidth,
    Decibel,
    Length,
    Mass,
    Ratio,
    Unit,
    describe,
    dimensions_of,
    read_quantity,
)

ANY = {
    "length": Unit("a length", "m", "0.2 m"),
    "damping": Unit("a damping coefficient", "N*s/m", "1 N*s/m"),
    "noise": Unit("a noise density", "m/s^2/Hz^0.5", "1 m/s^2/Hz^0.5"),
    "angle": Unit("an angle", "rad", "30 deg"),
    "speed": Unit("a speed", "m/s", "1 m/s"),
    "mass": Unit("a mass", "kg", "88 t", "positive"),
    "rate": Unit("a growth rate", "1/s", "0 1/s"),
    "inertia": Unit("a moment of inertia", "kg*m^2", "1 kg*m^2"),
}


@pytest.mark.parametrize(
    ("kind", "text", "value"),
    [
        ("length", "12.7 mm", 0.0127),
        ("length", "12.7mm", 0.0127),
        ("length", " +1.5e2 cm ", 1.5),
        ("length", ".2 m", 0.2),
        ("length", "-14 m", -14.0),
        ("length", "\u221214 m", -14.0),
        ("damping", "40 kN*s/m", 40e3),
        ("damping", "40 kN s/m", 40e3),
        ("damping", "40 kN\u00b7s/m", 40e3),
        ("damping", "40 kg/s", 40.0),
        ("noise", "0.01 m/s^2/Hz^0.5", 0.01),
        ("noise", "0.01 m/s\u00b2/sqrt(Hz)", 0.01),
        ("noise", "0.01 m/s**2/\u221aHz", 0.01),
        ("angle", "30 deg", math.pi / 6),
        ("angle", "30\u00b0", math.pi / 6),
        ("angle", "0.5 rad", 0.5),
        ("speed", "500 km/h", 500 / 3.6),
        ("mass", "88 t", 88e3),
        ("rate", "0 1/s", 0.0),
        ("inertia", "2.8e7 kg*m^2", 2.8e7),
        ("inertia", "2.8e7 kg m\u00b2", 2.8e7),
    ],
)
def test_accepted(kind: str, text: str, value: float) -> None:
    assert ANY[kind].read(text) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    ("kind", "given", "parts"),
    [
        ("length", 0.2, ['expected a length with its unit, for example "0.2 m"', 'did you mean "0.2 m"?']),
        ("length", 3, ['did you mean "3 m"?']),
        ("length", "0.2", ['expected a length with its unit, for example "0.2 m"', "without a unit"]),
        ("length", "3 kg", ["expected a length", "got a mass"]),
        ("length", "nan m", ["expected a length"]),
        ("length", "inf m", ["expected a length"]),
        ("length", "1e999 m", ["not finite"]),
        ("length", True, ["got true or false"]),
        ("length", {"a": 1}, ["got a table"]),
        ("length", "1 mile/h/h", ["got an acceleration"]),
        ("length", "1 parsnip", ['unknown unit "parsnip"; expected a length with its unit, for example "0.2 m"']),
        ("mass", "88 tonns", ['unknown unit "tonns"; did you mean "t"?']),
        ("length", "1 m**9999", ["not a unit"]),
        ("length", "1 m^(2", ["unit"]),
        ("length", "1 " + "m*" * 200 + "m", ["not a unit"]),
        ("length", "20 degC", ["expected a length"]),
        ("speed", "500 KM/H", ['did you mean "km/h"?']),
        ("mass", "88 ton", ["ambiguous", "write t"]),
        ("mass", "-88 t", ["above zero"]),
        ("mass", "0 t", ["above zero"]),
        ("inertia", "3 Nm", ["N*m"]),
        ("rate", "1 Hz", ["1/s"]),
        ("angle", "6 dB", ["dB"]),
    ],
)
def test_refused_with_the_reason(kind: str, given: object, parts: list[str]) -> None:
    with pytest.raises(ValueError) as caught:
        ANY[kind].read(given)
    for part in parts:
        assert part in str(caught.value)


class _Sample(BaseModel):
    length: Length = 0.0
    mass: Mass = 1.0
    bandwidth: Bandwidth = 1.0
    gain: Decibel = 0.0
    ratio: Ratio = 0.0


def test_hertz_and_radians_per_second_agree() -> None:
    assert _Sample.model_validate({"bandwidth": "20 Hz"}).bandwidth == pytest.approx(40.0 * math.pi, rel=1e-15)
    assert _Sample.model_validate({"bandwidth": "20 rad/s"}).bandwidth == 20.0
    assert _Sample.model_validate({"bandwidth": "1 kHz"}).bandwidth == pytest.approx(2000.0 * math.pi, rel=1e-15)


def test_gains_stay_in_decibels_and_ratios_plain() -> None:
    sample = _Sample.model_validate({"gain": "6 dB", "ratio": "5 %"})
    assert (sample.gain, sample.ratio) == (6.0, 0.05)
    for wrong in ({"gain": 6}, {"gain": "6"}, {"gain": "6 m"}, {"ratio": "0.05"}, {"ratio": float("nan")}):
        with pytest.raises(ValidationError):
            _Sample.model_validate(wrong)


def test_json_schema_teaches_dimension_and_example() -> None:
    length = _Sample.model_json_schema()["properties"]["length"]
    assert (length["type"], length["x-dimension"], length["x-unit"]) == ("string", "length", "m")
    assert length["examples"] == ["0.2 m"]


def test_every_kind_reads_its_own_example() -> None:
    for kind in units.KINDS:
        assert math.isfinite(kind.read(kind.example))


def test_dimensions_in_words() -> None:
    assert describe(dimensions_of("N")) == "a force"
    assert describe(read_quantity("1 m^3").dimensions) == "[length]^3"


def test_dimension_check_would_catch_a_swapped_unit() -> None:
    """Mutant: a kind stored in another unit of the same dimension gives another number."""
    swapped = Unit("a length", "mm", "0.2 m")
    assert swapped.read("12.7 mm") == ANY["length"].read("12.7 mm")  # always SI: the name of the unit cannot scale it
    with pytest.raises(ValueError, match="got a length"):
        ANY["mass"].read("12.7 mm")
