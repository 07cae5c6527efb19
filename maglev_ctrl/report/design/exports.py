"""A design's controller as files for MATLAB, Python and C, or as JSON; every file says what it was made from."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from maglev_ctrl.errors import ModelError
from maglev_ctrl.exchange.c_code import KEYWORDS, c_scheduled_source, c_source
from maglev_ctrl.exchange.matlab import mat_bytes
from maglev_ctrl.exchange.python_code import python_source
from maglev_ctrl.proofs.file import DesignFile, Schedule, to_document
from maglev_ctrl.proofs.makers import lyapunov_claim
from maglev_ctrl.proofs.prove import prove
from maglev_ctrl.report.design.schedule_code import python_schedule
from maglev_ctrl.report.style import number
from maglev_ctrl.study.design.document import DAMPERS, PREDICTIVE, kind_of, sampled_controllers, units_of
from maglev_ctrl.synthesis.discretise import discretise
from maglev_ctrl.synthesis.sampling import sampled
from maglev_ctrl.systems import Controller

TARGETS: Final = ("mat", "json", "c", "python")
FORMAT: Final = "maglev_ctrl controller 1"
SI: Final = "Signals in SI units: m, rad, m/s, rad/s, m/s^2, rad/s^2, A; commands in N, voltages in V."
SIGN: Final = "u = K y: the sign of the feedback is in the matrices."
FALLBACK: Final = (
    "This is the law the predictive controller falls back on, not the predictive controller itself: it keeps no limit."
)


@dataclass(frozen=True, eq=False, slots=True)
class SampledForm:
    """Laws as a computer runs them every `period` seconds, and in words what is proved of them."""

    period: float
    controllers: tuple[Controller, ...]
    proved: str


def export_design(design: DesignFile, target: str, *, period: float | None = None) -> dict[str, bytes]:
    """Files of one design by name.

    "mat" and "json" hold the laws as they were designed, and as they run on a computer where there is a period;
    "python" has one script for each of the two; "c" is the law as a computer runs it. A scheduled law comes as a table
    over its parameter. The sampled loop is proved stable first: what is not proved is not written.

    Parameters
    ----------
    design : as read from a design file; its claims are not proved again here
    target : "mat", "json", "c" or "python"
    period : s; None: the period the design was made or sampled with, if it has one

    Raises
    ------
    ValueError : unknown target, or a period that is not positive
    ModelError : there is no law, no period for C, or the law is not proved stable at this period
    """
    if target not in TARGETS:
        raise ValueError(f"target: expected {', '.join(TARGETS)}, got {target!r}")
    if not design.controllers:
        raise ModelError(f"{design.name}: the design has no law to export")
    name = _identifier(design.name) + ("_fallback" if kind_of(design) == PREDICTIVE else "")
    if target == "c" and kind_of(design) == DAMPERS:
        raise ModelError(f"{design.name}: dampers are built, not programmed; export them to mat, json or python")
    held = sampled_form(design, period)
    if target == "c" and held is None:
        raise ModelError(
            f'{design.name}: C needs a sampling period, and the design has none; give one, e.g. --period "2 ms"'
        )
    origin = _origin(design)
    match target:
        case "mat":
            laws = _labelled(design, design.controllers)
            if held is not None and _continuous(design):  # behind the others: claims count the laws from the first
                laws += _labelled(design, held.controllers)
            text = "\n\n".join((_comment(design, held), origin))
            return {f"{name}.mat": mat_bytes(laws, plants=design.plants, claims=design.claims, origin=text)}
        case "json":
            return {f"{name}.json": _json(design, held).encode()}
        case "python":
            made = {f"{name}.py": _python(design, design.controllers, origin).encode()}
            if held is not None and _continuous(design):
                made[f"{name}_sampled.py"] = _python(design, held.controllers, origin, held).encode()
            return made
        case _:
            assert held is not None
            header, source = _c(design, held, name, origin)
            return {f"{name}.h": header.encode(), f"{name}.c": source.encode()}


def sampled_form(design: DesignFile, period: float | None) -> SampledForm | None:
    """The laws as a computer runs them every `period` seconds, proved stable; None without any period.

    Raises
    ------
    ValueError : a period that is not positive
    ModelError : the design was made for another period, or stability is not proved at this one
    """
    own = design.controllers[0].dt
    if own is not None:
        if period is not None and abs(period - own) > 1e-9 * own:
            raise ModelError(
                f"{design.name}: the law was designed for samples every {number(1e3 * own, 'ms')} and runs at no other "
                "period; leave --period out"
            )
        return SampledForm(own, design.controllers, "Designed for this sampling period: the design's own claims hold.")
    stored = sampled_controllers(design)
    if period is None and stored is None:
        return None
    if stored is not None and (period is None or period == stored[0]):
        dt, laws = stored
    else:
        assert period is not None
        if not period > 0.0:
            raise ValueError(f"period: expected a positive time in s, got {period!r}")
        dt, laws = period, tuple(discretise(one, period) for one in design.controllers)
    return SampledForm(dt, laws, _proved_sampled(design, dt, laws))


def _proved_sampled(design: DesignFile, dt: float, laws: Sequence[Controller]) -> str:
    """Words on the stability of the sampled loops, each proved; a scheduled law at its nodes."""
    pairs = dict.fromkeys(pair for claim in design.claims for pair in zip(claim.plants, claim.controllers, strict=True))
    every = f"{design.name}: sampled every {number(1e3 * dt, 'ms')}"
    if not pairs:
        raise ModelError(f"{every}: the design makes no claim, so nothing is known of its loop")
    for i, j in pairs:
        plant, law = sampled(design.plants[i], dt), laws[j]
        try:
            claim = lyapunov_claim([plant], [law])
        except ModelError as fault:
            raise ModelError(f"{every} the loop is not stable at {plant.name}: {fault}") from None
        proof = prove(claim, [plant], [law])
        if not proof.holds:
            raise ModelError(f"{every} the loop is not proved stable at {plant.name}: {proof.reason}")
    points = "the operating point" if len(pairs) == 1 else f"each of the {len(pairs)} operating points"
    return (
        f"By Tustin's rule from the continuous law. The sampled loop is proved stable at {points} of the design "
        "(commands held between samples, no actuator delay); the other claims are of the continuous law."
    )


def _identifier(name: str) -> str:
    """A name that C, Python and MATLAB take for a variable."""
    plain = re.sub(r"[^A-Za-z0-9_]+", "_", name)[:60].strip("_") or "law"  # it names files too
    return plain if plain[0].isalpha() and plain not in KEYWORDS.split() else f"law_{plain}"


def _continuous(design: DesignFile) -> bool:
    return design.controllers[0].dt is None


def _labelled(design: DesignFile, laws: Sequence[Controller]) -> tuple[Controller, ...]:
    """The laws by names that tell them apart: the node of a schedule, the sampling period."""
    found: list[Controller] = []
    for i, law in enumerate(laws):
        name = design.name
        if design.schedule is not None:
            name += f" at {design.schedule.parameter} {design.schedule.nodes[i]:.10g} {design.schedule.unit}"
        if law.dt is not None:
            name += f", sampled every {law.dt:.10g} s"
        found.append(replace(law, name=name))
    return tuple(found)


def _comment(design: DesignFile, held: SampledForm | None) -> str:
    """What the law is and what is known of it, one sentence a line."""
    lines = [f"{design.name}: {design.law}"]
    lines += [FALLBACK] if kind_of(design) == PREDICTIVE else []
    if design.schedule is not None:
        lines.append(f"{_table_words(design.schedule)}; blended linearly between.")
    lines += [SIGN, SI]
    if held is not None:
        lines.append(f"Sampled every {held.period:.10g} s. {held.proved}")
    return "\n".join(lines)


def _table_words(schedule: Schedule) -> str:
    nodes = ", ".join(f"{node:.10g}" for node in schedule.nodes)
    return f"One law at each {schedule.parameter} of {nodes} {schedule.unit}"


def _origin(design: DesignFile) -> str:
    """Everything needed to tell where a file came from, ending in the scenario's own text."""
    scenario, extra = design.scenario, design.extra
    stated = extra.get("statements")
    lines = [f"design {design.name}, {design.law}"]
    lines += [f"made {design.created}"] if design.created else []
    lines += [", ".join(f"{key} {value}" for key, value in design.versions.items())] if design.versions else []
    if isinstance(stated, list):
        lines += ["Proved of the law as it was designed:"]
        lines += [f"- {one['statement']}" for one in stated if isinstance(one, dict) and one.get("proved")]
    for key in ("title", "path", "hash"):
        if scenario.get(key):
            lines.append(f"scenario {key}: {scenario[key]}")
    if scenario.get("text"):
        lines += ["scenario text:", "", str(scenario["text"]).rstrip()]
    return "\n".join(lines)


def _json(design: DesignFile, held: SampledForm | None) -> str:
    def plain(laws: Sequence[Controller]) -> Any:
        return to_document(DesignFile(design.name, design.law, (), tuple(laws), ()))["controllers"]

    schedule = design.schedule
    content: dict[str, Any] = {
        "format": FORMAT, "name": design.name, "about": _comment(design, held).splitlines(),
        "controllers": plain(design.controllers),
        "sampled": None if held is None or not _continuous(design) else
        {"period": held.period, "controllers": plain(held.controllers), "proved": held.proved},
        "units": units_of(design.extra),
        "schedule": None if schedule is None else
        {"parameter": schedule.parameter, "unit": schedule.unit, "nodes": list(schedule.nodes)},
        "origin": {"law": design.law, "created": design.created, "versions": dict(design.versions),
                   "scenario": dict(design.scenario), "statements": design.extra.get("statements", [])},
    }  # fmt: skip
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _python(design: DesignFile, laws: Sequence[Controller], origin: str, held: SampledForm | None = None) -> str:
    text = "\n\n".join((_comment(design, held), origin))
    if design.schedule is not None:
        return python_schedule(laws, design.schedule, name=design.name, origin=text)
    return python_source(replace(laws[0], name=design.name), origin=text)


def _c(design: DesignFile, held: SampledForm, name: str, origin: str) -> tuple[str, str]:
    comment = _comment(design, held)
    if design.schedule is not None:
        return c_scheduled_source(
            list(zip(design.schedule.nodes, held.controllers, strict=True)), name,
            parameter=design.schedule.parameter, comment=comment, origin=origin,
            units=units_of(design.extra) | {design.schedule.parameter: design.schedule.unit},
        )  # fmt: skip
    return c_source(held.controllers[0], name, comment=comment, origin=origin, units=units_of(design.extra))
