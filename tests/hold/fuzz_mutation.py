"""Changes to files that know what a file is: lines of TOML, cells of a table, places in JSON; and plain bytes."""

from __future__ import annotations

import json
import random
import re
from collections.abc import Callable
from typing import Any

NUMBERS = (
    "nan", "inf", "-inf", "1e308", "-1e308", "1e-320", "5e-324", "-0.0", "0", "-1", "1e400", "1e-400", "0x7f", "1_000",
    "9" * 400, "9" * 5000, "1" + "0" * 308, "1e1000000000", "1/3", "0.1", "2", "1e9", "1e6", "1e-9",
    "1.7976931348623157e308",
    "9007199254740993", "-9223372036854775809", "true", "٣", "1e", ".", "-", "+1", "1,5", "0b1", "1e16", "1e5",
)  # fmt: skip
QUANTITIES = (
    "1e999 m", "1 m**1e9", "9**9**9 m", "1 m^6^6^6", "1 ((((((m))))))", "1 m" + "*m" * 40, "1 __import__('os')",
    "1 1/0",
    "1 degC", "1 dB", "1 m/", "1 /m", "1 " + "(" * 50, "1 eval(1)", "0 m", "-1 kg", "1e308 km", "1e-320 m", "nan m",
    "inf s",
    "1 m;2", "1 \u00b5m", "1 m\u00b2", "\u0663 m", "1 °", "1 kN*s/m", "1 Hz", "1 deg", "1 t", "1 %", "1 sqrt(Hz)",
    "1 m^-1",
    "1 m\x00", "1 m\x1b[31m", "1 \u202em", "1e9 m", "1e-9 m", "1 kg*m^2", "1 MN/m", "1 ms", "1 A", "1 V", "1 W",
    "1" * 300 + " m", "1 " + "m" * 5000, "1 m^0.3333333333", "1 parsec", "1 delta_degC", "1 m\n", "1 lambda",
)  # fmt: skip
TEXTS = (
    "", " ", "\x00", "\x1b[2J", "\x9b31m", "\u202e", "<script>alert(1)</script>", "#import \"x\"", "$(id)",
    "../../x", "/etc/passwd",
    "/dev/zero", "CON", "nul.csv", "a" * 5000, "a" * 19_000, "[red]x[/red]", "[/]", "=cmd|' /C calc'!A0", "{reason}",
    "%s%n", "{0}",
    "\\", "\\\\host\\x", "\u2028", "\ufeff", "\U0001f600", "é", "car", "bogies", "guideway", "heave", "lqr", "table",
    "control", "__class__", "constructor", "NaN", "Infinity", "*/", '"""', "'''", "?>", "]]>", "\t", "\r\n", "\ud7ff",
)  # fmt: skip
_NUMBER = re.compile(r"[-+]?\d[\d_]*\.?\d*(?:[eE][-+]?\d+)?")
_LITERAL = re.compile(r'"[^"\n]*"')
_MARK = "@@{}@@"


def mutated(kind: str, data: bytes, rng: random.Random, *, most: int) -> bytes:
    """One to a few changes of a file of a kind, at most `most` bytes."""
    structured: dict[str, Callable[[str, random.Random], str]] = {"scenario": _toml, "csv": _csv}
    for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
        if rng.random() < 0.12:
            data = _bytes(data, rng)
        else:
            text = data.decode("utf-8", errors="replace")
            try:
                data = structured.get(kind, _json)(text, rng).encode("utf-8", errors="replace")
            except (ValueError, ArithmeticError, LookupError, RecursionError):  # a change that cannot be made
                data = _bytes(data, rng)
        data = data[:most]
    return data


def crossed(one: bytes, other: bytes, rng: random.Random, *, most: int) -> bytes:
    """The beginning of one file and the end of another, cut at lines where there are any."""
    cut = b"\n" if b"\n" in one and b"\n" in other else b","
    first, second = one.split(cut), other.split(cut)
    return cut.join([*first[: rng.randrange(len(first) + 1)], *second[rng.randrange(len(second) + 1) :]])[:most]


def _bytes(data: bytes, rng: random.Random) -> bytes:
    place = rng.randrange(len(data) + 1)
    match rng.randrange(12):
        case 0:
            return data[:place] + bytes([rng.randrange(256)]) + data[place + 1 :]
        case 1:
            return data[:place] + data[place + rng.choice((1, 4, 64, 4096)) :]
        case 2:
            piece = data[place : place + rng.choice((1, 16, 256, 4096))]
            return data[:place] + piece * rng.choice((2, 3, 30)) + data[place:]
        case 3:
            token = rng.choice((*NUMBERS, *QUANTITIES, *TEXTS))
            return data[:place] + token.encode("utf-8", errors="replace") + data[place:]
        case 4:
            return rng.choice((b"\xef\xbb\xbf", b"\xff\xfe", b"\0", b"\x80")) + data
        case 5:
            return data.replace(b"\n", rng.choice((b"\r\n", b"\r", b"\n\r", b"\x0b", b"\xe2\x80\xa8")))
        case 6:
            return (
                data[:place]
                + rng.choice((b"\0", b"\x1b[31m", b"\x80", b"\xed\xa0\x80", b"\xf4\x90\x80\x80"))
                + data[place:]
            )
        case 7:
            return data[:place]
        case 8:
            return data.replace(
                rng.choice((b"=", b",", b'"', b"[", b"]", b"{", b"}", b".")), rng.choice((b"", b"==", b"[[", b",,")), 1
            )
        case 9:
            return (
                data[:place] + rng.choice((b"[", b"{", b"(", b"'", b'"')) * rng.choice((1, 3, 200, 3000)) + data[place:]
            )
        case 10:
            return data.decode("utf-8", errors="replace").encode("utf-16")
    return bytes(byte ^ (1 << rng.randrange(8)) if rng.random() < 0.01 else byte for byte in data)


def _value(rng: random.Random) -> str:
    """A value as TOML writes it, good or bad."""
    match rng.randrange(10):
        case 0 | 1:
            return rng.choice(NUMBERS)
        case 2 | 3:
            return f'"{rng.choice(QUANTITIES)}"'
        case 4:
            return f'"{rng.choice(TEXTS)}"'
        case 5:
            return "[" + ", ".join(_value(rng) for _ in range(rng.choice((0, 1, 2, 7)))) + "]"
        case 6:
            return "{ a = " + _value(rng) + " }"
        case 7:
            return "[" * (depth := rng.choice((2, 11, 13, 60, 900))) + "]" * depth
        case 8:
            return json.dumps(rng.choice(TEXTS))
    return rng.choice(("1979-05-27", "07:32:00", "1979-05-27T00:32:00Z", "true", "[]", "{}", '""'))


def _toml(text: str, rng: random.Random) -> str:
    lines = text.split("\n")
    at = rng.randrange(len(lines))
    keyed = [k for k, line in enumerate(lines) if " = " in line and not line.startswith("#")]
    if keyed and rng.random() < 0.9:
        at = rng.choice(keyed)
    key, _, value = lines[at].partition(" = ")
    match rng.randrange(14):
        case 0 | 1 | 2:
            lines[at] = f"{key} = {_value(rng)}"
        case 3 | 4:
            lines[at] = _NUMBER.sub(lambda found: rng.choice(NUMBERS) if rng.random() < 0.6 else found[0], lines[at])
        case 5:
            other = rng.choice(keyed) if keyed else 0
            lines[at] = f"{key} = {lines[other].partition(' = ')[2]}"
        case 6:
            del lines[at]
        case 7:
            lines.insert(rng.randrange(len(lines) + 1), lines[at])
        case 8:
            others = (f"{key}s", key[:-1], key.upper(), ".".join([key] * 20), json.dumps(rng.choice(TEXTS)), "a" * 900)
            lines[at] = f"{rng.choice(others)} = {value}"
        case 9:
            heads = [k for k, line in enumerate(lines) if line.startswith("[")]
            if heads:
                begin = rng.choice(heads)
                end = next((k for k in heads if k > begin), len(lines))
                table = lines[begin:end]
                if rng.random() < 0.5:
                    del lines[begin:end]
                where = rng.randrange(len(lines) + 1)
                lines[where:where] = table * rng.choice((0, 1, 1, 2, 45))
        case 10:
            lines[at] = _LITERAL.sub(lambda found: json.dumps(rng.choice((*QUANTITIES, *TEXTS))), lines[at], count=1)
        case 11:
            lines.insert(
                at, rng.choice(("[x]", "[[option]]", "[[x.y]]", "[vehicle]", "[", "]]", "x.y.z = 1", "''' = 1"))
            )
        case 12:
            scale = 10.0 ** rng.choice((-300, -12, -6, -3, -1, 1, 3, 6, 12, 300))
            lines[at] = _NUMBER.sub(lambda found: repr(float(found[0].replace("_", "")) * scale), lines[at], count=1)
        case _:
            lines[at] = _NUMBER.sub(
                lambda found: str(rng.choice((-1, 0, 1, 2, 3, 5, 40, 41, 400, 2000, 2001, 10**6))), lines[at]
            )
    return "\n".join(lines)


def _csv(text: str, rng: random.Random) -> str:
    rows = [line.split(",") for line in text.split("\n")]
    at = rng.randrange(len(rows))
    row = rows[at]
    cell = rng.randrange(len(row))
    match rng.randrange(14):
        case 0 | 1:
            row[cell] = rng.choice(NUMBERS)
        case 2:
            row[cell] = rng.choice(TEXTS)
        case 3:
            rows[0][rng.randrange(len(rows[0]))] = rng.choice(
                ("height [mm]", "lift [kN]", "speed [km/h]", "drag [N]", "gap [m]", "guidance [N]", "time [s]",
                "force [N*m]",
                 "frequency [Hz]", "phase [rad]", "amplitude error [N/m]", "phase error [deg]",
                 "static stiffness [N/m]", "record",
                 "static stiffness error [N/m]", "force", "motion", "displacement [deg]",
                 f"lift [{rng.choice(QUANTITIES)[2:]}]")
            )  # fmt: skip
        case 4:
            del rows[at]
        case 5:
            rows.insert(rng.randrange(len(rows) + 1), list(row))
        case 6:
            rows[at:at] = [list(row) for _ in range(rng.choice((1, 2, 30, 500)))]
        case 7:
            row.insert(cell, rng.choice((*NUMBERS, "", "x")))
        case 8:
            del row[cell]
        case 9:
            row[cell] = rng.choice(('"', '""', '"x', "'1", "#", ";", "\t1", " 1 ", "1\r", '"1\n2"'))
        case 10:
            for line in rows[1:]:
                if cell < len(line):
                    line[cell] = rng.choice(NUMBERS)
        case 11:
            scale = 10.0 ** rng.choice((-300, -20, -3, 3, 20, 300))
            for line in rows[1:]:
                if cell < len(line) and _NUMBER.fullmatch(line[cell].strip()):
                    line[cell] = repr(float(line[cell].replace("_", "")) * scale)
        case 12:
            other = rng.randrange(len(row))
            for line in rows:
                if max(cell, other) < len(line):
                    line[cell], line[other] = line[other], line[cell]
        case _:
            rows.append(["1"] * rng.choice((1, 7, 3000)))
    return "\n".join(",".join(line) for line in rows) or "x"


def _json(text: str, rng: random.Random) -> str:
    try:
        whole: Any = json.loads(text)
    except (ValueError, RecursionError):
        return _bytes(text.encode("utf-8", errors="replace"), rng).decode("utf-8", errors="replace")
    raw: list[str] = []
    holder: list[Any] = [whole]
    place: Any = holder
    spot: Any = 0
    for _ in range(rng.randrange(1, 12)):  # deeper places oftener than a walk that may stop anywhere
        inside = place[spot]
        if not isinstance(inside, dict | list) or not inside:
            break
        place = inside
        spot = rng.choice(list(inside)) if isinstance(inside, dict) else rng.randrange(len(inside))
    # What is large already is not made larger: parts that hold one another would double with every change.
    match rng.randrange(12 if len(text) < 20_000 else 6):
        case 0 | 1 | 2:
            raw.append(rng.choice((*NUMBERS, "NaN", "-Infinity", "1e-320", "null", "1.5e308")))
            place[spot] = _MARK.format(0)
        case 3:
            place[spot] = rng.choice((*TEXTS, *QUANTITIES, "\ud800"))
        case 4:
            place[spot] = rng.choice(([], {}, None, True, -1, [[]], [1, 2], {"a": 1}))
        case 5:
            if isinstance(place, dict):
                place[rng.choice(TEXTS)] = place.pop(spot)
        case 6:
            if isinstance(place, list) and place is not holder:
                place[spot:spot] = [place[spot]] * rng.choice((1, 2, 50))
        case 7:
            if place is not holder:
                del place[spot]
        case 8:
            if isinstance(place[spot], float):
                place[spot] *= rng.choice((-1, 0, 2, 1e-3, 1e3, 1e-300, 1e300, 1.0000001))
        case 9:
            raw.append(
                rng.choice(
                    ("[" * 300 + "]" * 300, '{"a": 1, "a": 2}', '"\\ud800"', '"\\u001b[31m"', "9" * 5000, "[1e400]")
                )
            )
            place[spot] = _MARK.format(0)
        case 10:
            if isinstance(place, dict):
                place[spot] = place[rng.choice(list(place))]
            elif place is not holder:
                rng.shuffle(place)
        case _:
            if isinstance(place[spot], list):
                place[spot] = place[spot][::-1] + place[spot]
    try:
        made = json.dumps(holder[0])
    except (ValueError, RecursionError):
        return text
    for k, one in enumerate(raw):
        made = made.replace(f'"{_MARK.format(k)}"', one)
    return made
