"""Designs as one self-contained file: written from a study, read again, proved again without a solver."""

from __future__ import annotations

import difflib
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import ModelError
from maglev_ctrl.proofs.claims import Proof
from maglev_ctrl.proofs.coverage import spoken_of, uncovered
from maglev_ctrl.proofs.file import DesignFile, Schedule, from_document, recheck, to_document
from maglev_ctrl.scenario import Scenario
from maglev_ctrl.scenario.json_text import SIZE_LIMIT, parse_json
from maglev_ctrl.study.design.records import LawStudy
from maglev_ctrl.study.design.signals import signal_units
from maglev_ctrl.synthesis.discretise import discretise
from maglev_ctrl.systems import Controller

FORMAT = "maglev_ctrl designs 1"
ROUNDING = 1e-9
"""Relative difference between a stored sampled law and the same made again: other libraries round otherwise."""
SAMPLED = "sampled"
"""Key of `extra` that holds the laws as a computer runs them."""
KIND = "kind"
"""Key of `extra` that tells what the law is made of."""
UNITS = "units"
"""Key of `extra` that holds the SI units of the law's signals, by their names."""
LAW, DAMPERS, PREDICTIVE = "law", "dampers", "predictive"


@dataclass(frozen=True, eq=False, slots=True)
class ProvedAgain:
    """Proofs made again from a file, the operating points each speaks of, and what nothing proved speaks of."""

    proofs: tuple[Proof, ...]
    places: tuple[str, ...]
    doubts: tuple[str, ...]

    @property
    def proved(self) -> bool:
        """Every claim holds, and the claims speak of every plant and law of the file."""
        return bool(self.proofs) and all(proof.holds for proof in self.proofs) and not self.doubts


def design_document(scenario: Scenario, study: LawStudy) -> dict[str, Any] | None:
    """One option's design as a document; None where there is no law."""
    synthesis = study.synthesis
    if synthesis is None or not synthesis.controllers:
        return None
    scheduled = study.schedule.schedule if study.schedule is not None else None
    kind = DAMPERS if study.budget is not None else PREDICTIVE if study.predictive is not None else LAW
    first, option = synthesis.controllers[0], next(o for o in scenario.options if o.name == study.name)
    units = signal_units(scenario, option, first.measured, first.commands)
    extra: dict[str, Any] = {"option": study.name, "label": study.label, KIND: kind, UNITS: units, "statements": [
        {"statement": proof.statement, "proved": proof.holds, "margin": proof.margin} for proof in synthesis.proofs
    ]}  # fmt: skip
    if study.sampled is not None:
        held = DesignFile(study.name, study.law, (), study.sampled.controllers, ())
        extra[SAMPLED] = {"period": study.sampled.period, "controllers": to_document(held)["controllers"]}
    return to_document(DesignFile(
        name=study.name, law=study.law, plants=synthesis.plants, controllers=synthesis.controllers,
        claims=synthesis.claims,
        scenario={"title": scenario.title, "path": scenario.path.name, "hash": scenario.hash, "text": scenario.text},
        schedule=None if scheduled is None else
        Schedule(scheduled.parameter, scheduled.unit, tuple(float(x) for x in scheduled.nodes)),
        performance=tuple(
            {"quantity": one.quantity, "unit": one.unit, "recomputed": one.recomputed,
             "reported": one.reported if np.isfinite(one.reported) else None}
            for one in synthesis.performance
        ),
        notes=synthesis.notes, extra=extra,
    ))  # fmt: skip


def designs_text(documents: Sequence[dict[str, Any]], *, created: str, versions: Sequence[tuple[str, str]]) -> str:
    """The documents of a study as the text of one JSON file; floats are written so that they read back the same."""
    designs = dated(documents, created=created, versions=versions)
    whole = {"format": FORMAT, "digest": _digest(designs), "designs": designs}
    return json.dumps(whole, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def changed_since(path: Path) -> str:
    """Whether the file is as it was written; '' where it is, else a sentence.

    A digest finds slips and edits, texts and names among them; it is no seal against someone who makes a new one.

    Raises
    ------
    ModelError : as for `load_designs`
    """
    data = _read(path)
    if data.get("digest") == _digest(data["designs"]):
        return ""
    return "the file is not as it was written: its digest differs" if "digest" in data else "the file has no digest"


def _digest(designs: Sequence[object]) -> str:
    text = json.dumps(designs, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()


def dated(
    documents: Sequence[dict[str, Any]], *, created: str, versions: Sequence[tuple[str, str]]
) -> list[dict[str, Any]]:
    """The documents with when and with what they were made."""
    return [{**one, "created": created, "versions": dict(versions)} for one in documents]


def units_of(extra: Mapping[str, Any]) -> dict[str, str]:
    """SI units of a design's signals by their names; empty where the file tells none."""
    held = extra.get(UNITS)
    return {str(key): str(unit) for key, unit in held.items()} if isinstance(held, Mapping) else {}


def kind_of(design: DesignFile) -> str:
    """LAW, DAMPERS (built, not programmed) or PREDICTIVE (the file holds the law it falls back on)."""
    kind = design.extra.get(KIND, LAW)
    return kind if kind in (DAMPERS, PREDICTIVE) else LAW


def load_designs(path: Path) -> tuple[DesignFile, ...]:
    """The designs of a file.

    Raises
    ------
    ModelError : no such file, not JSON, not of this format, or a part of it is wrong; one sentence with the place
    """
    found: list[DesignFile] = []
    for position, one in enumerate(_read(path)["designs"]):
        try:
            found.append(from_document(one))
        except (ModelError, ValueError) as fault:
            raise ModelError(f"{path}: designs[{position}]: {fault}") from None
    if not found:
        raise ModelError(f"{path}: the file holds no design")
    return tuple(found)


def _read(path: Path) -> dict[str, Any]:
    try:
        with path.open("rb") as stream:
            content = stream.read(SIZE_LIMIT + 1)
    except FileNotFoundError:
        near = difflib.get_close_matches(path.name, [one.name for one in _beside(path)], n=1)
        raise ModelError(f"{path}: no such file" + (f'; did you mean "{near[0]}"?' if near else "")) from None
    except (OSError, ValueError) as fault:
        raise ModelError(f"{path}: cannot be read: {getattr(fault, 'strerror', None) or fault}") from None
    try:
        data = parse_json(content)
    except (ValueError, RecursionError) as fault:
        line, why = getattr(fault, "lineno", 0), str(fault).removeprefix("expected JSON: ")
        place = f"{path}:{line}" if line else f"{path}"
        raise ModelError(f"{place}: expected JSON as `design` writes it: {why}") from None
    if not isinstance(data, dict) or data.get("format") != FORMAT or not isinstance(data.get("designs"), list):
        raise ModelError(f'{path}: expected a file made by `design` (format "{FORMAT}")')
    return data


def pick(designs: Sequence[DesignFile], name: str | None, *, file: Path) -> DesignFile:
    """The design of a name, or the only one.

    Raises
    ------
    ModelError : no design has this name, or there are several and none was named
    """
    names = [one.name for one in designs]
    if name is None:
        if len(designs) > 1:
            raise ModelError(f"{file}: the file holds several designs; choose one with --option: {', '.join(names)}")
        return designs[0]
    if name not in names:
        near = difflib.get_close_matches(name, names, n=1)
        advice = f'did you mean "{near[0]}"?' if near else f"the designs are {', '.join(names)}"
        raise ModelError(f'{file}: --option: no design is called "{name}"; {advice}')
    return designs[names.index(name)]


def prove_again(design: DesignFile) -> ProvedAgain:
    """Every claim of a design proved again from its numbers, and whether the claims speak of all the file holds."""
    if not design.claims:
        return ProvedAgain((), (), ("the file makes no claim: there is nothing to prove",))
    with np.errstate(all="ignore"):  # numbers of a file may be anything; what overflows is not near what it should be
        doubts = (*uncovered(design.claims, design.plants, design.controllers), *_altered(design))
    places = tuple(spoken_of(claim, design.plants) for claim in design.claims)
    return ProvedAgain(recheck(design), places, doubts)


def _altered(design: DesignFile) -> tuple[str, ...]:
    """Sampled laws that are not what sampling makes of the proved ones."""
    held = sampled_controllers(design)
    if held is None:
        return ()
    period, laws = held
    wanted = [law if law.dt is not None else discretise(law, period) for law in design.controllers]
    if len(wanted) != len(laws):
        return (f"the file holds {len(laws)} sampled laws for {len(wanted)} proved ones",)
    for j, (law, right) in enumerate(zip(laws, wanted, strict=True)):
        for key in "ABCD":
            one, other = getattr(law, key), getattr(right, key)
            if one.shape != other.shape or not np.allclose(one, other, rtol=ROUNDING, atol=ROUNDING * _size(other)):
                return (f"sampled law {j + 1} ({law.name!r}) is not the proved law sampled every {period:g} s",)
    return ()


def _size(matrix: FloatArray) -> float:
    return float(np.max(np.abs(matrix), initial=0.0))


def sampled_controllers(design: DesignFile) -> tuple[float, tuple[Controller, ...]] | None:
    """The sampled laws a design file holds and their period in s; None where it holds none.

    Raises
    ------
    ModelError : what it holds is not a law
    """
    held = design.extra.get(SAMPLED)
    if not isinstance(held, dict):
        return None
    empty = to_document(replace(design, plants=(), controllers=(), claims=(), schedule=None, extra={}))
    laws = from_document({**empty, "controllers": held.get("controllers")}).controllers
    period = held.get("period")
    if not isinstance(period, int | float) or not laws or any(law.dt != period for law in laws):
        raise ModelError(f"extra.{SAMPLED}: expected laws and their sampling period")
    return float(period), laws


def _beside(path: Path) -> list[Path]:
    try:
        return list(path.parent.iterdir())
    except OSError:
        return []
