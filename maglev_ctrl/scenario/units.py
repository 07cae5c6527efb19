"""Units at the border: "12.7 mm" in a file, 0.0127 inside; pint is loaded on the first quantity read."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic_core import PydanticCustomError, core_schema

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler

Bound = Literal["any", "nonnegative", "positive"]
Dimensions = tuple[tuple[str, float], ...]
Written = Literal["hertz", "angle", ""]
"""Units whose dimensions do not tell them apart: hertz from 1/s, angles from plain numbers."""

_NUMBER = re.compile(r"\s*([+-]?(?:\d[\d_]*\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?)\s*(.*?)\s*$", re.DOTALL)
_PRETTY = str.maketrans({
    "\u00b7": "*", "\u22c5": "*", "\u00d7": "*", "\u2219": "*",  # multiplication signs
    "\u2212": "-", "\u00b5": "u", "\u03bc": "u", "\u2126": "ohm", "\u03a9": "ohm", "\u00b0": " deg",
    "\u00a0": " ", "\u202f": " ", "\u2009": " ",  # narrow and unbreakable spaces
    "\u00b2": "^2", "\u00b3": "^3", "\u2074": "^4",
})  # fmt: skip
_NEGATIVE_POWER = re.compile(r"⁻([¹²³])")
_ROOT = re.compile(r"(?:sqrt|√)\s*\(?\s*([A-Za-z]+)\s*\)?")
_ALLOWED = re.compile(r"[A-Za-z_*/^().\s\d+-]*")
_DIGITS = re.compile(r"\d+(?:\.\d+)?")
_TONS = {"ton", "kiloton", "megaton", "short_ton", "long_ton", "UK_ton", "US_ton"}
_ANGLES = ("radian", "degree", "arcminute", "arcsecond", "turn", "revolution")
_NEWTON_METRE = re.compile(r"(?<![A-Za-z])[kM]?Nm(?![A-Za-z])")
_WORDS = {"tonne": "t", "tonnes": "t", "kilogram": "kg", "metre": "m", "millimetre": "mm", "second": "s", "newton": "N"}
_COMMON = (
    "m", "mm", "cm", "km", "um", "kg", "g", "t", "s", "ms", "us", "min", "h", "m/s", "km/h", "N", "kN", "MN", "N/m",
    "kN/m", "MN/m", "N*s/m", "kN*s/m", "kg*m^2", "t*m^2", "S/m", "MS/m", "A", "kA", "Hz", "rad/s", "rad", "deg", "1/s",
    "m/s^2", "m/s^2/Hz^0.5", "m/s/Hz^0.5", "m/Hz^0.5", "V", "kV", "ohm", "mohm", "H", "mH", "T", "m^2", "cm^2",
    "A/Hz^0.5",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Quantity:
    """A number with its unit, read: the value in SI, its dimensions, and the text it came from."""

    value: float
    dimensions: Dimensions
    text: str
    written: Written = ""


@dataclass(frozen=True, slots=True)
class Unit:
    """What a field of a scenario file measures; as an annotation it makes pydantic read "12.7 mm" as 0.0127.

    Parameters
    ----------
    noun : what it is, in words ("a length")
    unit : the SI unit it is stored in
    example : a text that is accepted
    bound : sign that is accepted

    Examples
    --------
    >>> Unit("a length", "m", "0.2 m").read("12.7 mm")
    0.0127
    """

    noun: str
    unit: str
    example: str
    bound: Bound = "any"
    angular: bool = False  # a frequency stored in rad/s: 1 Hz is 2 pi rad/s

    def read(self, value: object) -> float:
        """The SI value of a text with a unit.

        Raises
        ------
        ValueError : a bare number, an unknown unit, another dimension, a sign or a value that is not allowed
        """
        if not isinstance(value, str):
            raise ValueError(self._bare(value))
        quantity = read_quantity(value, expected=self.expected)
        return self.check(quantity)

    @property
    def expected(self) -> str:
        """The words "a length with its unit, for example ..."."""
        return f'{self.noun} with its unit, for example "{self.example}"'

    def check(self, quantity: Quantity) -> float:
        """The SI value of a quantity already read, its dimensions and sign checked.

        Raises
        ------
        ValueError : another dimension, or a sign that is not allowed
        """
        if quantity.dimensions != dimensions_of(self.unit):
            got = describe(quantity.dimensions)
            raise ValueError(f'expected {self.expected}, got {got}: "{quantity.text}"')
        value = quantity.value
        if self.unit == "rad" and quantity.written != "angle":
            raise ValueError(f'expected {self.expected}, got "{quantity.text}"')
        if quantity.written == "hertz" and self.angular:
            value *= 2.0 * math.pi
        elif quantity.written == "hertz" and self.unit == "1/s":
            raise ValueError(f'expected {self.expected}, got a frequency in Hz: "{quantity.text}"; write it in 1/s')
        if (self.bound == "positive" and value <= 0.0) or (self.bound == "nonnegative" and value < 0.0):
            sign = "above zero" if self.bound == "positive" else "of zero or more"
            raise ValueError(f'expected {self.noun} {sign}, got "{quantity.text}"')
        return value

    def _bare(self, value: object) -> str:
        if isinstance(value, int | float) and not isinstance(value, bool):
            return f'expected {self.expected}, got the bare number {value:g}; did you mean "{value:g} {self.unit}"?'
        return f"expected {self.expected}, got {_kind_of(value)}"

    def _validate(self, value: object) -> float:
        try:
            return self.read(value)
        except ValueError as error:
            raise PydanticCustomError("quantity", "{reason}", {"reason": str(error)}) from None

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(self._validate)

    def __get_pydantic_json_schema__(
        self, schema: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return {
            "type": "string",
            "pattern": r"^\s*[+-]?[0-9.][0-9_.eE+-]*\s*\S.*$",
            "examples": [self.example],
            "x-dimension": self.noun.removeprefix("an ").removeprefix("a "),
            "x-unit": self.unit,
        }


@dataclass(frozen=True, slots=True)
class _AnyUnit:
    """Annotation of a quantity whose dimension depends on another field; the cross-checks decide."""

    bound: Bound = "positive"

    def _validate(self, value: object) -> Quantity:
        try:
            if not isinstance(value, str):
                shown = f"the bare number {value:g}" if isinstance(value, int | float) else _kind_of(value)
                raise ValueError(f'expected a number with its unit, for example "0.5 m/s^2", got {shown}')
            quantity = read_quantity(value, expected='a number with its unit, for example "0.5 m/s^2"')
            if self.bound == "positive" and quantity.value <= 0.0:
                raise ValueError(f'expected a value above zero, got "{value}"')
            if self.bound == "nonnegative" and quantity.value < 0.0:
                raise ValueError(f'expected a value of zero or more, got "{value}"')
            return quantity
        except ValueError as error:
            raise PydanticCustomError("quantity", "{reason}", {"reason": str(error)}) from None

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(
            self._validate,
            serialization=core_schema.plain_serializer_function_ser_schema(lambda quantity: quantity.value),
        )

    def __get_pydantic_json_schema__(
        self, schema: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return {
            "type": "string",
            "examples": ["0.5 m/s^2", "20 mm", "20 kN"],
            "x-dimension": "that of what it belongs to",
        }


@dataclass(frozen=True, slots=True)
class _Plain:
    """Annotation of a ratio: a plain number, or a percentage as text."""

    bound: Bound = "any"

    def _validate(self, value: object) -> float:
        if isinstance(value, str) and (match := _NUMBER.match(value)) and match[2] == "%":
            number = float(match[1]) / 100.0
        elif isinstance(value, int | float) and not isinstance(value, bool):
            number = float(value)
        else:
            shown = f'"{value}"' if isinstance(value, str) else _kind_of(value)
            raise PydanticCustomError(
                "ratio", 'expected a plain number (a ratio), for example 0.05 or "5 %", got {shown}', {"shown": shown}
            )
        if not math.isfinite(number):
            raise PydanticCustomError("ratio", "expected a finite number, got {shown}", {"shown": str(number)})
        if (self.bound == "positive" and number <= 0.0) or (self.bound == "nonnegative" and number < 0.0):
            sign = "above zero" if self.bound == "positive" else "of zero or more"
            raise PydanticCustomError("ratio", "expected a number {sign}, got {shown}", {"sign": sign, "shown": value})
        return number

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(self._validate)

    def __get_pydantic_json_schema__(
        self, schema: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return {"type": ["number", "string"], "examples": [0.05, "5 %"], "x-dimension": "ratio"}


@dataclass(frozen=True, slots=True)
class _Decibel:
    """Annotation of a gain in decibels, kept in decibels."""

    def _validate(self, value: object) -> float:
        match = _NUMBER.match(value) if isinstance(value, str) else None
        if match is not None and match[2].casefold() == "db" and math.isfinite(number := float(match[1])):
            return number
        if isinstance(value, int | float) and not isinstance(value, bool):
            shown, near = f"the bare number {value:g}", f'; did you mean "{value:g} dB"?'
        else:
            shown, near = f'"{_short(value)}"' if isinstance(value, str) else _kind_of(value), ""
        raise PydanticCustomError(
            "quantity",
            'expected a gain in decibels, for example "6 dB", got {shown}{near}',
            {"shown": shown, "near": near},
        )

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(self._validate)

    def __get_pydantic_json_schema__(
        self, schema: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return {"type": "string", "examples": ["6 dB"], "x-dimension": "gain", "x-unit": "dB"}


def read_quantity(text: str, *, expected: str = "a number with its unit") -> Quantity:
    """Read a number followed by a unit.

    Accepts kN*s/m, kN s/m, kN·s/m, m/s², m/s^2/Hz^0.5, m/s^2/sqrt(Hz), 30 deg, 30°.

    Raises
    ------
    ValueError : not a number with a unit, not finite, or a unit that is unknown or ambiguous

    Examples
    --------
    >>> read_quantity("40 kN·s/m").value
    40000.0
    """
    match = _NUMBER.match(text.translate(_PRETTY))
    if match is None:
        raise ValueError(f'expected {expected}, got "{_short(text)}"')
    number, unit = float(match[1].replace("_", "")), match[2]
    if not unit:
        raise ValueError(f'expected {expected}, got "{_short(text)}" without a unit')
    try:
        factor, dimensions, written = _unit(_plain_unit(unit))
    except _UnknownUnit as fault:
        raise ValueError(f"{fault}" if "did you mean" in f"{fault}" else f"{fault}; expected {expected}") from None
    value = number * factor
    if not math.isfinite(value):
        raise ValueError(f'expected {expected}, got "{_short(text)}", which is not finite')
    return Quantity(value, dimensions, _short(text), written)


def dimensions_of(unit: str) -> Dimensions:
    """Dimensions of a unit, as sorted (name, exponent) pairs."""
    return _unit(_plain_unit(unit))[1]


def unit_factor(unit: str, *, kind: Unit) -> float:
    """How many SI units one `unit` is, its dimension checked against `kind` (column headers of data files).

    Raises
    ------
    ValueError : the unit is unknown or of another dimension
    """
    return kind.check(read_quantity(f"1 {unit}", expected=kind.expected))


def describe(dimensions: Dimensions) -> str:
    """Dimensions in words: the noun of a known kind, or the base dimensions.

    Examples
    --------
    >>> describe(dimensions_of("kg"))
    'a mass'
    """
    for kind in KINDS:
        if dimensions_of(kind.unit) == dimensions:
            return kind.noun
    return " ".join(f"{name}^{power:g}" for name, power in dimensions) or "a plain number or an angle"


class _UnknownUnit(ValueError):
    """A unit nobody knows."""


def _plain_unit(unit: str) -> str:
    unit = _NEGATIVE_POWER.sub(lambda m: "^-" + str("¹²³".index(m[1]) + 1), unit.translate(_PRETTY))
    return _ROOT.sub(r"\1^0.5", unit).strip()


@cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry(autoconvert_offset_to_baseunit=False, cache_folder=None)


@cache
def _unit(unit: str) -> tuple[float, Dimensions, Written]:
    """Factor to SI base units, dimensions, and whether the unit is written in hertz or as an angle."""
    if len(unit) > 60 or not _ALLOWED.fullmatch(unit) or any(float(d) > 6 for d in _DIGITS.findall(unit) if d != "1"):
        raise ValueError(f'"{_short(unit)}" is not a unit; write it like kN*s/m or m/s^2')
    try:
        parsed = _registry().parse_units(unit.replace("^", "**"))
    except Exception:  # pint reports unknown names and broken syntax by many types, tokenizer errors included
        raise _UnknownUnit(_unknown(unit)) from None
    names = {str(name) for name in parsed._units}
    if names & _TONS:
        raise ValueError(f'the unit "{unit}" is ambiguous; write t for 1000 kg')
    if _NEWTON_METRE.search(unit):
        raise ValueError(f'the unit "{unit}" is ambiguous; write N*m for newton times metre')
    try:
        base = _registry().Quantity(1.0, parsed).to_base_units()
    except Exception:
        raise ValueError(f'the unit "{unit}" has an offset or a logarithm and cannot be used here') from None
    dimensions = tuple(sorted((str(k), round(float(v), 9)) for k, v in parsed.dimensionality.items()))
    written: Written = ""
    if dimensions == (("[time]", -1.0),) and any(name.endswith("hertz") for name in names):
        written = "hertz"
    elif not dimensions and all(name.endswith(_ANGLES) for name in names):
        written = "angle"
    return float(base.magnitude), dimensions, written


def _unknown(unit: str) -> str:
    folded = {known.casefold(): known for known in reversed(_COMMON)} | _WORDS
    near = get_close_matches(unit.replace(" ", "*").casefold(), folded, n=1, cutoff=0.6)
    return f'unknown unit "{unit}"' + (f'; did you mean "{folded[near[0]]}"?' if near else "")


def _short(text: str) -> str:
    return text if len(text) <= 40 else text[:37] + "..."


def _kind_of(value: object) -> str:
    if isinstance(value, bool):
        return "true or false"
    names = {dict: "a table", list: "a list", str: "a text", int: "a number", float: "a number"}
    return names.get(type(value), f"a {type(value).__name__}")


LENGTH = Unit("a length", "m", "0.2 m")
POSITIVE_LENGTH = Unit("a length", "m", "0.2 m", "positive")
_NONNEGATIVE_LENGTH = Unit("a length", "m", "0.2 m", "nonnegative")
_MASS = Unit("a mass", "kg", "88 t", "positive")
PAYLOAD = Unit("a mass", "kg", "20 t", "nonnegative")
_INERTIA = Unit("a moment of inertia", "kg*m^2", "2.8e7 kg*m^2", "positive")
_TIME = Unit("a time", "s", "2 ms", "nonnegative")
_SPEED = Unit("a speed", "m/s", "500 km/h", "positive")
_FORCE = Unit("a force", "N", "60 kN", "positive")
_DRAG = Unit("a force", "N", "47.5 kN", "nonnegative")
_STIFFNESS = Unit("a stiffness", "N/m", "1.36 MN/m")
_DAMPING = Unit("a damping coefficient", "N*s/m", "120 kN*s/m")
_CONDUCTIVITY = Unit("an electrical conductivity", "S/m", "2.5e7 S/m", "positive")
_CURRENT = Unit("a current", "A", "616 kA", "positive")
_SIGNED_CURRENT = Unit("a current", "A", "6 kA")
ANY_SPEED = Unit("a speed", "m/s", "500 km/h")
_BANDWIDTH = Unit("a frequency", "rad/s", "20 Hz", "positive", angular=True)
_ANGLE = Unit("an angle", "rad", "30 deg")
_RATE = Unit("a growth rate", "1/s", "0 1/s")
_ACCELERATION = Unit("an acceleration", "m/s^2", "0.5 m/s^2")
_LENGTH_NOISE = Unit("a length noise density", "m/Hz^0.5", "0.01 mm/Hz^0.5", "positive")
_SPEED_NOISE = Unit("a velocity noise density", "m/s/Hz^0.5", "1 mm/s/Hz^0.5", "positive")
_ACCELERATION_NOISE = Unit("an acceleration noise density", "m/s^2/Hz^0.5", "0.01 m/s^2/Hz^0.5", "positive")
_ANGULAR_ACCELERATION = Unit("an angular acceleration", "rad/s^2", "0.1 rad/s^2")
_AREA = Unit("an area", "m^2", "0.1 m^2", "positive")
_VOLTAGE = Unit("a voltage", "V", "50 V")
_RESISTANCE = Unit("a resistance", "ohm", "4 ohm", "nonnegative")
_INDUCTANCE = Unit("an inductance", "H", "50 mH", "nonnegative")
_FLUX_DENSITY = Unit("a flux density", "T", "1.2 T", "positive")
_CURRENT_NOISE = Unit("a current noise density", "A/Hz^0.5", "10 mA/Hz^0.5", "positive")
_ROUGHNESS = Unit("a roughness amplitude", "m", "1.5e-6 m", "positive")
_WAVE_NUMBER = Unit("a wave number", "rad/m", "0.02 rad/m", "positive")
_LINE_MASS = Unit("a mass per length", "kg/m", "3 t/m", "positive")
_BENDING_STIFFNESS = Unit("a bending stiffness", "N*m^2", "4e10 N*m^2", "positive")
_ACCELERATION_DENSITY = Unit("an acceleration density", "m^2/s^4/Hz", "0.01 m^2/s^4/Hz", "positive")
_POWER = Unit("a power", "W", "5 kW", "nonnegative")
_FORCE_RATE = Unit("a force rate", "N/s", "100 kN/s", "positive")
POSITIVE_TIME = Unit("a time", "s", "2 ms", "positive")
KINDS = (
    LENGTH, _MASS, _INERTIA, _TIME, _SPEED, _FORCE, _STIFFNESS, _DAMPING, _CONDUCTIVITY, _CURRENT, _BANDWIDTH,
    _ACCELERATION, _LENGTH_NOISE, _SPEED_NOISE, _ACCELERATION_NOISE, _ANGULAR_ACCELERATION,
    _AREA, _VOLTAGE, _RESISTANCE, _INDUCTANCE, _FLUX_DENSITY, _CURRENT_NOISE, _WAVE_NUMBER, _LINE_MASS,
    _BENDING_STIFFNESS, _ACCELERATION_DENSITY, _POWER, _FORCE_RATE,
)  # fmt: skip

Length = Annotated[float, LENGTH]
PositiveLength = Annotated[float, POSITIVE_LENGTH]
NonnegativeLength = Annotated[float, _NONNEGATIVE_LENGTH]
Mass = Annotated[float, _MASS]
Payload = Annotated[float, PAYLOAD]
Inertia = Annotated[float, _INERTIA]
Time = Annotated[float, _TIME]
Speed = Annotated[float, _SPEED]
Force = Annotated[float, _FORCE]
Drag = Annotated[float, _DRAG]
Stiffness = Annotated[float, _STIFFNESS]
Damping = Annotated[float, _DAMPING]
Conductivity = Annotated[float, _CONDUCTIVITY]
Current = Annotated[float, _CURRENT]
SignedCurrent = Annotated[float, _SIGNED_CURRENT]
AnySpeed = Annotated[float, ANY_SPEED]
Bandwidth = Annotated[float, _BANDWIDTH]
Angle = Annotated[float, _ANGLE]
Rate = Annotated[float, _RATE]
Acceleration = Annotated[float, _ACCELERATION]
LengthNoise = Annotated[float, _LENGTH_NOISE]
SpeedNoise = Annotated[float, _SPEED_NOISE]
AccelerationNoise = Annotated[float, _ACCELERATION_NOISE]
Area = Annotated[float, _AREA]
Resistance = Annotated[float, _RESISTANCE]
Inductance = Annotated[float, _INDUCTANCE]
FluxDensity = Annotated[float, _FLUX_DENSITY]
CurrentNoise = Annotated[float, _CURRENT_NOISE]
RoughnessAmplitude = Annotated[float, _ROUGHNESS]
WaveNumber = Annotated[float, _WAVE_NUMBER]
LineMass = Annotated[float, _LINE_MASS]
BendingStiffness = Annotated[float, _BENDING_STIFFNESS]
AccelerationDensity = Annotated[float, _ACCELERATION_DENSITY]
Power = Annotated[float, _POWER]
ForceRate = Annotated[float, _FORCE_RATE]
PositiveTime = Annotated[float, POSITIVE_TIME]
AnyQuantity = Annotated[Quantity, _AnyUnit()]
NonnegativeQuantity = Annotated[Quantity, _AnyUnit("nonnegative")]
Ratio = Annotated[float, _Plain()]
PositiveRatio = Annotated[float, _Plain("positive")]
NonnegativeRatio = Annotated[float, _Plain("nonnegative")]
Decibel = Annotated[float, _Decibel()]
