"""Stability maps for machines: arrays (NetCDF), a summary (JSON) and the table of speeds (CSV)."""

from __future__ import annotations

import csv
import io
import json
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from maglev_ctrl._version import __version__
from maglev_ctrl.analysis.first_instability import PeriodicMargin
from maglev_ctrl.analysis.floquet_margins import FloquetMargins
from maglev_ctrl.analysis.plane_records import NO_ANSWER, STABLE, UNRESOLVED, UNSTABLE, StabilityPlane
from maglev_ctrl.analysis.tongue_atlas import TongueAtlas, TongueCrossing
from maglev_ctrl.report.serialise import plain
from maglev_ctrl.study.map.records import MapQuantity, MapStudy, OptionMap, PeriodicLawStudy

if TYPE_CHECKING:
    import xarray

FORMAT: Final = 1
STATES: Final = (("stable", STABLE), ("unresolved", UNRESOLVED), ("unstable", UNSTABLE), ("no_answer", NO_ANSWER))
ARRAYS: Final = (
    ("growth", "1/s", "growth rate of the fastest motion; NaN without an answer", np.float64, np.nan),
    ("growth_error", "1/s", "bound on the error of the growth rate", np.float64, np.nan),
    ("state", "1", "-1 stable, 1 unstable, 0 unresolved, 2 no answer", np.int8, NO_ANSWER),
    ("interpolated", "1", "1 where filled in between computed points of one state", np.int8, 0),
    ("tongue_index", "1", "-1, or the number of the tongue in names", np.int16, -1),
)  # fmt: skip


def netcdf(study: MapStudy) -> bytes:
    """NetCDF 3: every reader of NetCDF knows it, and SciPy writes it."""
    return bytes(to_dataset(study).to_netcdf(engine="scipy"))


def to_dataset(study: MapStudy) -> xarray.Dataset:
    """Every map as arrays (option, x, y) in SI; an option without a map has no answer anywhere.

    Raises
    ------
    ValueError : a map that does not stand on the study's own grid
    """
    import xarray

    names = _axis_names(study)
    dims = ("option", *names)
    parts: dict[str, Any] = {}
    planes = tuple(option.plane for option in study.options)
    laws = tuple(option.law.plane if option.law is not None else None for option in study.options)
    for suffix, found, law in (("", planes, "the option's own law"), ("_periodic_law", laws, "the periodic law")):
        if suffix and not any(plane is not None for plane in found):
            continue
        for name, unit, words, kind, blank in ARRAYS:
            said = array_words(name, unit, f"{words}, under {law}")
            if name == "tongue_index":
                said |= {f"names_of_option_{k}": tongue_names(plane) for k, plane in enumerate(found)}
            parts[name + suffix] = (dims, _stacked(study, found, name, kind, blank), said)
    return xarray.Dataset(
        parts,
        coords={
            "option": ("option", [option.name for option in study.options], {"long_name": "option of the scenario"}),
            **{
                name: (name, np.asarray(q.values), {
                    "units": q.unit if q.scale == 1.0 else "SI", "long_name": q.label, "quantity": q.quantity,
                    "display_unit": q.unit, "display_scale": q.scale, "design": q.design})
                for name, q in zip(names, (study.x, study.y), strict=True)
            },
        },
        attrs={
            "title": study.title, "scenario": study.name, "scenario_hash": study.scenario_hash,
            "maglev_ctrl_version": __version__, "created": study.created, "wavelength_m": study.wavelength,
            "expected_depth": study.depth, "sources": "\n".join(study.sources), "notes": "\n".join(study.notes),
            "backend": study.backend,
            **{f"method_of_option_{k}": plane.method for k, plane in enumerate(planes) if plane is not None},
            **{f"failure_of_option_{k}": o.failure for k, o in enumerate(study.options) if o.failure},
        },
    )  # fmt: skip


def array_words(name: str, unit: str, words: str) -> dict[str, Any]:
    """Attributes of one array of a map: unit, what it is, and the meaning of states."""
    flags = {"flag_values": np.array([value for _, value in STATES], dtype=np.int8),
             "flag_meanings": " ".join(word for word, _ in STATES)}  # fmt: skip
    return {"units": unit, "long_name": words, **(flags if name == "state" else {})}


def _axis_names(study: MapStudy) -> tuple[str, str]:
    """Names that every reader of NetCDF takes; two axes of one name are told apart."""
    first, second = (
        "".join(c if c.isalnum() else "_" for c in q.quantity).strip("_") or "axis" for q in (study.x, study.y)
    )
    return (first, second) if first != second and "option" not in (first, second) else (f"{first}_x", f"{second}_y")


def tongue_names(plane: StabilityPlane | None) -> str:
    """What the numbers of `tongue_index` stand for."""
    return "" if plane is None else "; ".join(f"{k}: {one.name}" for k, one in enumerate(plane.tongues))


def _stacked(
    study: MapStudy, planes: tuple[StabilityPlane | None, ...], name: str, kind: Any, blank: float
) -> np.ndarray[Any, np.dtype[Any]]:
    shape = len(study.x.values), len(study.y.values)
    out = np.full((len(planes), *shape), blank, dtype=kind)
    for k, plane in enumerate(planes):
        if plane is None:
            continue
        values = getattr(plane, name)
        if values.shape != shape:
            raise ValueError(
                f"{study.options[k].name}: expected a map of {shape[0]} x {shape[1]} points as the axes have, "
                f"got {name} of shape {values.shape}"
            )
        out[k] = values
    return out


def json_text(study: MapStudy) -> str:
    """The study without its arrays, every number with its unit, nothing that JSON cannot say."""
    body = {
        "format": FORMAT, "kind": "maglev-ctrl stability maps", "title": study.title, "scenario": study.name,
        "scenario_path": study.scenario_path, "scenario_hash": study.scenario_hash, "created": study.created,
        "seconds": _quantity(study.seconds, "s"), "versions": plain(study.versions), "backend": study.backend,
        "sources": plain(study.sources), "notes": plain(study.notes),
        "wavelength": _quantity(study.wavelength, "m"), "depth": _quantity(study.depth, "1"),
        "x": _axis(study.x), "y": _axis(study.y), "options": [_option(option) for option in study.options],
        "arrays": "map.nc",
    }  # fmt: skip
    return json.dumps(body, ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def _quantity(value: float, unit: str) -> dict[str, Any]:
    return {"value": plain(float(value)), "unit": unit}


def _axis(q: MapQuantity) -> dict[str, Any]:
    return {
        "quantity": q.quantity, "label": q.label, "display_unit": q.unit, "display_scale": q.scale,
        "from": plain(float(q.values[0])), "to": plain(float(q.values[-1])), "points": len(q.values),
        "design": plain(float(q.design)), "unit": "SI",
    }  # fmt: skip


def _option(option: OptionMap) -> dict[str, Any]:
    return {
        "name": option.name, "label": option.label, "kind": option.kind, "summary": plain(option.summary),
        "failure": option.failure, "map": _plane(option.plane), "tongues": plain(option.tongues),
        "atlas": _atlas(option.atlas), "atlas_reason": option.atlas_reason, "margins": _margins(option.margins),
        "margins_reason": option.margins_reason, "periodic_law": _law(option.law), "notes": plain(option.notes),
        "seconds": _quantity(option.seconds, "s"),
    }  # fmt: skip


def _plane(plane: StabilityPlane | None) -> dict[str, Any] | None:
    """What there is to say of a map without its arrays."""
    if plane is None:
        return None
    known = plane.growth[np.isfinite(plane.growth)]
    apart = plane.check_difference[np.isfinite(plane.check_difference)]
    return {
        "shares": {name: plane.share(value) for name, value in STATES},
        "largest_growth": _quantity(float(known.max()) if known.size else float("nan"), "1/s"),
        "tongues": plain(plane.tongues), "faults": plain(plane.faults), "evaluated": plane.evaluated,
        "integrated": plane.integrated, "interpolated_share": float(np.mean(plane.interpolated)),
        "checked": len(plane.checked),
        "largest_check_difference": _quantity(float(apart.max()) if apart.size else float("nan"), "1/s"),
        "missed_width": _quantity(plane.missed_width, "SI"), "method": plane.method,
    }  # fmt: skip


def _crossing(one: TongueCrossing) -> Any:
    """A crossing; its threshold under a name of its own, for it is a multiple of the depth and not a depth."""
    written = plain(one)
    written["onset_over_depth"] = written.pop("onset")
    return written


def _atlas(atlas: TongueAtlas | None) -> dict[str, Any] | None:
    if atlas is None:
        return None
    return {
        "ranges": plain(atlas.ranges), "crossings": [_crossing(one) for one in atlas.crossings],
        "missed_width": _quantity(atlas.missed_width, "m/s"), "scan_step": _quantity(atlas.scan_step, "m/s"),
        "checked": len(atlas.checked),
    }  # fmt: skip


def _margins(margins: FloquetMargins | None) -> dict[str, Any] | None:
    if margins is None:
        return None

    def pair(found: tuple[PeriodicMargin, PeriodicMargin] | None, unit: str) -> dict[str, Any] | None:
        return None if found is None else {"down": _margin(found[0], unit), "up": _margin(found[1], unit)}

    return {"depth": _margin(margins.depth, "1"), "gain": pair(margins.gain, "factor"),
            "speed": pair(margins.speed, "m/s")}  # fmt: skip


def _margin(one: PeriodicMargin, unit: str) -> dict[str, Any]:
    return {
        "value": plain(one.value), "unit": unit, "safe": plain(one.safe), "unsafe": plain(one.unsafe),
        "bound": one.bound, "agreement": one.agreement.value, "nominal": plain(one.nominal),
        "limit": plain(one.limit), "tongue": one.tongue.name, "unmodulated": one.unmodulated,
        "missed_width": plain(one.missed_width), "reason": one.reason, "text": one.text,
    }  # fmt: skip


def _law(law: PeriodicLawStudy | None) -> dict[str, Any] | None:
    if law is None:
        return None
    found = law.comparison
    return {
        "unresolved": law.unresolved, "certificate": plain(law.certificate), "map": _plane(law.plane),
        "ratings": None if found is None else [
            {
                "name": one.name, "stable": one.stable, "spectral_radius": plain(one.spectral_radius),
                "mean_cost_ratio": plain(one.mean_cost_ratio), "worst_cost_ratio": plain(one.worst_cost_ratio),
                "peak_gain": plain(one.peak_gain), "peak_command": plain(one.peak_command),
            }
            for one in (found.periodic, *found.constants)
        ],
    }  # fmt: skip


def ranges_csv(study: MapStudy) -> str:
    """Every speed range of every option; an option without an atlas has one row that says why.

    `narrowest_seen_m_per_s`: where two multipliers meet, an unstable interval narrower than this may be missing.
    """
    stream = io.StringIO()
    out = csv.writer(stream, lineterminator="\n")
    out.writerow(["option", "from_m_per_s", "to_m_per_s", "verdict", "tongues", "growth_per_s", "reason",
                  "narrowest_seen_m_per_s"])  # fmt: skip
    for option in study.options:
        if option.atlas is None:
            reason = option.failure or option.atlas_reason or "no tongue atlas"
            out.writerow([option.name, "", "", "not evaluated", "", "", reason, ""])
            continue
        narrowest = option.atlas.missed_width
        seen = "" if np.isnan(narrowest) else f"{narrowest:.3g}"
        for one in option.atlas.ranges:
            growth = "" if np.isnan(one.growth) else f"{one.growth:.9g}"
            ends = (f"{one.lower:.12g}", f"{one.upper:.12g}")
            out.writerow([option.name, *ends, one.verdict, "; ".join(one.tongues), growth, one.reason, seen])
    return stream.getvalue()
