"""What the mutations begin from: small valid files of every kind, and the texts that broke other programs."""

from __future__ import annotations

import json
import random
import re
from pathlib import Path
from typing import Any

import numpy as np

from maglev_ctrl.proofs.claims import DecayClaim, EllipsoidClaim, RegionClaim, SegmentClaim
from maglev_ctrl.proofs.file import DesignFile, Schedule, to_document
from maglev_ctrl.proofs.makers import bounded_real_claim, energy_claim, lyapunov_claim
from maglev_ctrl.scenario.starter import starter_text
from maglev_ctrl.study.design.document import SAMPLED, designs_text
from maglev_ctrl.synthesis.discretise import discretise
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant

KINDS = ("scenario", "csv", "certificate", "design", "report")
SHIPPED = Path(__file__).resolve().parents[2] / "scenarios"

FORCE_TABLE = "height [mm],gap [mm],speed [m/s],lift [kN],guidance [kN],drag [kN]\n" + "".join(
    f"{h},{g},{v},{60.0 * 50 / h:.4f},{3.0 * 50 / g:.4f},{400.0 / v:.4f}\n"
    for h in (30, 50, 70) for g in (40, 50, 60) for v in (50, 100, 150)
)  # fmt: skip

TABLE_SCENARIO = """format = 1
title = "Table"
[vehicle]
model = "heave_surge"
car.mass = "10 t"
[forces]
model = "table"
file = "table.csv"
method = "polynomial"
degree = 1
trim_to_weight = true
[operating]
speed = "100 m/s"
height = "50 mm"
[[option]]
name = "bare"
kind = "baseline"
"""


def plain_design(*, poles: int = 2) -> DesignFile:
    """A double integrator that one law holds, with a claim of every kind."""
    plants = tuple(
        Plant.from_matrices(
            [[0.0, 1.0], [k, -0.1]], [[0.0], [1.0]], [[0.0], [1.0]], [[1.0, 0.0]], name=f"{k:g}",
            states=("gap", "gap.velocity"), commands=("force",),
        )
        for k in (1.0, 1.2)
    )[:poles]  # fmt: skip
    law = Controller.static(
        [[-4.0 / 3.0, -1.1]], measured=plants[0].measured, commands=plants[0].commands, name="state feedback"
    )
    first = lyapunov_claim(plants[:1], [law])
    claims = (
        lyapunov_claim(plants, [law], rate=0.1),
        bounded_real_claim(plants[0], law, 3.002),
        energy_claim(plants[0], law, 2.0),
        EllipsoidClaim((0,), (0,), first.P, (100.0,)),
        RegionClaim((0,), (0,), "left half plane", np.zeros((1, 1)), np.ones((1, 1)), np.linalg.inv(first.P)),
        SegmentClaim((0, 0), (0, 0), np.repeat(first.P, 2, axis=0), 1.0, 0.1),
    )
    held = DesignFile("hover", "lqr", (), (discretise(law, 0.002),), ())
    return DesignFile(
        "hover", "lqr", plants, (law,), claims, created="2026-01-01", versions={"maglev_ctrl": "0"},
        scenario={"title": "Hover", "path": "hover.toml", "hash": "1f", "text": "a = 1\n"},
        performance=({"quantity": "H-infinity norm", "unit": "", "reported": 3.0, "recomputed": 3.0},),
        notes=("one",),
        extra={
            "option": "hover", "label": "Hover", "kind": "law", "units": {"force": "N", "gap": "m"}, "statements": [],
            SAMPLED: {"period": 0.002, "controllers": to_document(held)["controllers"]},
        },
    )  # fmt: skip


def scheduled_design() -> DesignFile:
    """Two scalar laws over a speed, and a claim for each."""
    plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]])
    laws = tuple(Controller.static([[-gain]], measured=("x1",), commands=("u1",)) for gain in (3.0, 4.0))
    claims = tuple(DecayClaim((0,), (j,), 1.0, np.ones((1, 1, 1))) for j in (0, 1))
    return DesignFile("over_speed", "lqr", (plant,), laws, claims, schedule=Schedule("speed", "m/s", (10.0, 20.0)))


def _requirement(name: str, value: Any, verdict: str) -> dict[str, Any]:
    return {
        "name": name, "quantity": "growth_rate", "description": "largest growth rate", "sense": "at_most",
        "limit": {"value": 0.0, "unit": "1/s"}, "value": {"value": value, "unit": "1/s"}, "unit": "1/s",
        "verdict": verdict, "margin_percent": {"value": "NaN", "unit": "%"}, "worst_at": "speed 100 km/h",
        "method": "", "reason": "", "bound": "exact", "hard": True,
    }  # fmt: skip


def report_document(*, worse: bool = False) -> dict[str, Any]:
    """A small report as `report` writes it."""
    modes = {
        "s": {"value": {"re": [-0.5, -0.5, -2.0], "im": [3.0, -3.0, 0.0]}, "unit": "1/s"},
        "error_bound": {"value": [1e-9, 1e-9, 1e-9], "unit": "1/s"}, "damping_ratio": [0.16, 0.16, 1.0],
    }  # fmt: skip
    margins = {
        "channels": [{
            "channel": "force", "gain_reduction": {"value": -6.0, "unit": "dB"},
            "gain_increase": {"value": "Infinity", "unit": "dB"}, "phase": {"value": 50.0, "unit": "deg"},
            "delay": {"value": 0.01, "unit": "s"}, "modulus": {"value": 0.6, "unit": ""}, "disk": {"alpha": 1.1},
        }],
        "multi_loop": {"alpha": 0.9},
    }  # fmt: skip
    options = [
        {
            "name": name, "label": name.title(), "kind": "baseline", "summary": ["one spring"], "verdict": "PASS",
            "failure": "", "requirements": [_requirement("stable", -0.5 + worse, "FAIL" if worse else "PASS")],
            "modes": modes, "margins": margins, "floquet": None,
            "sweeps": [{"name": "speed", "values": [1.0, 2.0]}], "seconds": {"value": 1.0, "unit": "s"},
        }
        for name in (("bare", "damped", "new") if worse else ("bare", "damped"))
    ]  # fmt: skip
    return {
        "format": 1, "kind": "maglev-ctrl comparison", "verdict": "PASS", "title": "Car", "options": options,
        "scenario_text": "a = 2\nb = 3\n" if worse else "a = 1\n", "scenario_hash": "2f" if worse else "1f",
        "versions": [["numpy", "2.0"]], "created": "2026-01-01", "more": {"deep": [1, {"goes": "NaN"}]},
        "design_speed": {"value": 50.0, "unit": "m/s"}, "design_height": {"value": 0.1, "unit": "m"},
    }  # fmt: skip


def _without_prose(text: str) -> str:
    """A scenario without comments, sources and assumptions, which take longest to read and break least."""
    kept = "\n".join(line for line in text.split("\n") if line.strip() and not line.lstrip().startswith("#"))
    kept = re.sub(r'^description = """.*?"""$|^assumptions = \[.*?^\]$', "", kept, flags=re.DOTALL | re.MULTILINE)
    return re.sub(r"^\[sources\].*?(?=^\[)", "", kept, flags=re.DOTALL | re.MULTILINE)


def seeds(kind: str) -> list[bytes]:
    """Valid files of a kind."""
    if kind == "scenario":
        given = [one.read_text(encoding="utf-8") for one in sorted(SHIPPED.glob("*/*.toml"))]
        small = [TABLE_SCENARIO, *(_without_prose(text) for text in given if len(text) < 6000)]
        return [text.encode() for text in (*small * 3, starter_text("Seed"), *map(_without_prose, given))]
    if kind == "csv":
        rows = FORCE_TABLE.splitlines(keepends=True)
        flat = (
            "height [m],speed [km/h],lift [N],drag [N]\n0.05,360,98066.5,9000\n0.06,360,80000,8000\n0.05,400,98e3,8e3\n"
        )
        wave = [(0.01 * k, f"{np.sin(0.7 * k):.5f}", f"{-3.0 * np.sin(0.7 * k + 0.1):.5f}") for k in range(24)]
        time = "time [s],displacement [m],force [N]\n" + "".join(f"{t:.2f},{x},{f}\n" for t, x, f in wave)
        given = [one.read_bytes()[:1500].rpartition(b"\n")[0] + b"\n" for one in sorted(SHIPPED.glob("data/*.csv"))]
        return [FORCE_TABLE.encode(), "".join(rows[:4]).encode(), flat.encode(), time.encode(), *given]
    one, two = (json.loads(json.dumps(to_document(one))) for one in (plain_design(), scheduled_design()))
    if kind == "certificate":
        short = json.loads(json.dumps(to_document(plain_design(poles=1))))
        return [json.dumps(each).encode() for each in (one, two, {**short, "claims": short["claims"][:1]})]
    if kind == "design":
        versions = [("maglev_ctrl", "0")]
        return [
            designs_text(held, created="now", versions=versions).encode()
            for held in ([two], [{**one, "claims": one["claims"][:3]}], [two, two])
        ]
    return [json.dumps(report_document(worse=worse)).encode() for worse in (False, True)]


def classics(kind: str) -> list[bytes]:
    """Files known to break readers: run once, before any mutation."""
    rng = random.Random(0)
    deep, wide = 100_000, 2**20 - 50
    common = [
        b"", b"\0", b"\xef\xbb\xbf", b"\xff\xfe\x00", b"\x80" * 64, b"\n" * wide, b"\r" * 1000, b" " * wide,
        bytes(rng.randrange(256) for _ in range(4096)), b"\x1b]0;owned\x07", "\u202e\ud7ff\U0010ffff".encode(),
        b"\xed\xa0\x80", b"'" * 999, b'"' * 999, b"a," * 500_000, b"9" * 5000, b"9" * 15_000,
    ]  # fmt: skip
    if kind == "scenario":
        return [
            *common, b"a = " + b"[" * 15_000, b"a = " + b"{a=" * 5_000, b"[" + b"a." * 9_000 + b"a]",
            b"a." * 9_000 + b"a = 1", b"a = " + b"9" * 5000, b"a = 0x" + b"f" * 15_000, b"a = 1e999999999",
            b"".join(b"[k%d]\n" % k for k in range(90_000)), b"".join(b"[[option]]\n" for _ in range(90_000)),
            b"a = 9999-99-99", b"a = 00:00:99", b'"\\ud800" = 1', b'a = "\\U00110000"', b"title = '''" + b"x" * 900_000,
            b"".join(b"a%d = 1\n" % k for k in range(90_000)), TABLE_SCENARIO.replace("table.csv",
            "/dev/zero").encode(),
            TABLE_SCENARIO.replace("table.csv", "../table.csv").encode(),
            b"a = [" + b"[]," * 6_000 + b"]", b"x = [" + b"\n1," * 300_000 + b"]",
        ]  # fmt: skip
    if kind == "csv":
        head = b"height [m],speed [m/s],lift [N],drag [N]\n"
        return [
            *common, head + b"1,1,1,1\n" * 100_000, head + b"nan,inf,-inf,1e999\n", head + b'"1,1,1,1\n',
            b"x" * 2_000_000, b"lift [N]," * 100_000, b"height [" + b"(" * 40_000, b"height [m**9**9**9]\n1\n",
            b"time [s],displacement [m],force [N]\n" + b"0,0,0\n" * 50_000,
            b"frequency [Hz],force,motion,amplitude [N/m],phase [deg]\n" + b"1e308,a,b,1e308,1e308\n" * 99,
            b" " * 60_000 + b"[" + b" " * 60_000, b'"' + b"x" * 200_000 + b'"\n', "٣,٤\n".encode() * 9,
        ]  # fmt: skip
    return [
        *common, b"[" * deep, b'{"a":' * deep, b"[" * deep + b"]" * deep, b"NaN", b"1e400", b"9" * 5000, b"-Infinity",
        b'{"format": "maglev_ctrl designs 1", "designs": [' + b"[]," * 300_000 + b"[]]}",
        b'{"format": "maglev_ctrl designs 1", "designs": [NaN, 1e400, "\\ud800"]}', b'"\\ud800"', b'{"a":1,"a":2}',
        b'{"kind": "maglev-ctrl comparison", "format": 1e400}', b'{"kind": "\\ud800\\u001b[31m"}',
    ]  # fmt: skip
