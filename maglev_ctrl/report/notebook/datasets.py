"""Results as xarray datasets: named axes, and on every variable its unit and what it is.

Units are SI. What is complex stands as two real variables, because NetCDF has no complex numbers: eigenvalues and
exponents as `growth_rate` and `angular_frequency`, shapes and multipliers as `..._real` and `..._imag`. What is true or
false is 1 or 0. Every dataset can be written with `.to_netcdf(path)`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import singledispatch
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from maglev_ctrl._version import __version__
from maglev_ctrl.analysis.floquet import Floquet
from maglev_ctrl.analysis.ledger import Ledger
from maglev_ctrl.analysis.margins import Margins
from maglev_ctrl.analysis.modes import Modes
from maglev_ctrl.analysis.plane_records import StabilityPlane
from maglev_ctrl.analysis.resonance_map import ResonanceMap
from maglev_ctrl.analysis.response.records import RideResponse
from maglev_ctrl.analysis.simulation.records import Trajectory
from maglev_ctrl.analysis.tracking import ModeTracks
from maglev_ctrl.arrays import ComplexArray
from maglev_ctrl.report.charts_margins import requirement_names
from maglev_ctrl.report.map.data import ARRAYS, array_words, tongue_names
from maglev_ctrl.report.map.data import to_dataset as map_dataset
from maglev_ctrl.report.simulation.folder import to_dataset as simulation_dataset
from maglev_ctrl.report.simulation.folder import trajectory_dataset
from maglev_ctrl.study.map.records import MapStudy
from maglev_ctrl.study.nonlinear.records import SimulationStudy
from maglev_ctrl.study.records import Comparison, Sweep

if TYPE_CHECKING:
    import xarray

_PARAMETERS: Final = {
    "speed": ("m/s", "speed"), "height": ("m", "levitation height"), "gap": ("m", "guidance gap"),
    "payload": ("kg", "payload"), "lateral_offset": ("m", "lateral offset"), "depth": ("1", "modulation depth"),
}  # fmt: skip
_MARGINS: Final = (
    ("gain_reduction", "1", "smallest factor on the gain"), ("gain_increase", "1", "largest factor on the gain"),
    ("phase", "deg", "phase margin"), ("phase_lag", "deg", "phase lag survived"),
    ("phase_lead", "deg", "phase lead survived"), ("delay", "s", "additional delay survived"),
    ("modulus", "1", "modulus margin, 1 / max |S|"), ("complementary_peak", "1", "largest |T|"),
)  # fmt: skip


@singledispatch
def to_dataset(result: object) -> xarray.Dataset:
    """A result as an xarray dataset: named axes, units, what was verified, and the verdict.

    Knows modes, followed modes and sweeps, ledgers, margins, Floquet results, resonance maps, stability planes, map
    studies, rides, trajectories, simulation studies and comparisons.

    Raises
    ------
    TypeError : a result that has no such form

    Examples
    --------
    >>> from maglev_ctrl import SecondOrderSystem, modes
    >>> found = to_dataset(modes(SecondOrderSystem.from_matrices([[1.0]], [[0.2]], [[4.0]], dofs=("car.heave",))))
    >>> found.growth_rate.attrs["units"], float(found.growth_rate[0].round(6)), found.attrs["verdict"]
    ('1/s', -0.1, 'stable')
    """
    known = ", ".join(sorted(kind.__name__ for kind in to_dataset.registry if kind is not object))
    raise TypeError(f"result: a {type(result).__name__} has no dataset; there are those of {known}")


def _made(
    variables: Mapping[str, tuple[Sequence[str], Any, str, str]],
    coordinates: Mapping[str, tuple[Any, str, str]],
    attributes: dict[str, Any],
) -> xarray.Dataset:
    """A dataset from (dims, values, unit, words) per variable and (values, unit, words) per axis; "" is no unit."""
    import xarray

    def plain(values: Any) -> Any:
        array = np.array(values)
        return array.astype(np.int8) if array.dtype == bool else array

    def said(unit: str, words: str) -> dict[str, str]:
        return {**({"units": unit} if unit else {}), "long_name": words}

    return xarray.Dataset(
        {key: (tuple(dims), plain(v), said(unit, words)) for key, (dims, v, unit, words) in variables.items()},
        coords={key: (key, plain(v), said(unit, words)) for key, (v, unit, words) in coordinates.items()},
        attrs={"maglev_ctrl_version": __version__, **attributes},
    )


def _parts(key: str, dims: Sequence[str], values: ComplexArray, unit: str, words: str) -> dict[str, Any]:
    return {
        f"{key}_real": (dims, values.real, unit, f"{words}, real part"),
        f"{key}_imag": (dims, values.imag, unit, f"{words}, imaginary part"),
    }


def _rates(dims: Sequence[str], s: ComplexArray) -> dict[str, Any]:
    return {
        "growth_rate": (dims, s.real, "1/s", "growth rate"),
        "angular_frequency": (dims, s.imag, "rad/s", "angular frequency"),
    }


@to_dataset.register(Modes)
def _modes(found: Modes) -> xarray.Dataset:
    one = ("mode",)
    variables = {
        **_rates(one, found.s),
        "frequency": (one, found.frequency, "Hz", "frequency"),
        "natural_frequency": (one, found.natural_frequency, "rad/s", "modulus of the eigenvalue"),
        "damping_ratio": (one, found.damping_ratio, "1", "damping ratio"),
        "error_bound": (one, found.error_bound, "1/s", "bound on the error of the eigenvalue"),
        "kind": (one, [kind.value for kind in found.kind], "", "what the mode does"),
        "participation": (("coordinate", "mode"), found.participation, "1", "share of each coordinate in the mode"),
        **_parts("shape", ("coordinate", "mode"), found.shapes, "1", "mode shape, largest entry 1"),
        **_shares(found.ledger, ("element", "mode")),
    }  # fmt: skip
    axes = {
        "mode": (list(found.labels), "", "mode, named by participation"),
        "coordinate": (list(found.dofs), "", "coordinate of the model"),
        "element": (list(found.ledger.elements), "", "element of the vehicle"),
    }
    return _made(variables, axes, {"verdict": found.verdict.name.lower(), "agreement": found.agreement.value})


def _shares(found: Ledger, dims: Sequence[str]) -> dict[str, Any]:
    return {
        "damping_share": (dims, found.damping, "1/s", "share of the growth rate through damping"),
        "circulatory_share": (dims, found.circulatory, "1/s", "share of the growth rate through circulatory stiffness"),
    }


@to_dataset.register(Ledger)
def _ledger(found: Ledger) -> xarray.Dataset:
    variables = {
        **_shares(found, ("element", "mode")),
        "stiffness_share": (("element", "mode"), found.stiffness_share, "SI", "generalised stiffness"),
        "growth_rate": (("mode",), found.growth, "1/s", "growth rate"),
        "residual": (("mode",), found.residual, "1/s", "growth rate minus the sum of the shares"),
    }
    axes = {
        "element": (list(found.elements), "", "element of the vehicle"),
        "mode": (np.arange(len(found.growth)), "1", "number of the mode"),
    }
    return _made(variables, axes, {})


@to_dataset.register(ModeTracks)
def _tracks(found: ModeTracks) -> xarray.Dataset:
    return _followed(found, "parameter", "SI", "swept parameter")


@to_dataset.register(Sweep)
def _sweep(found: Sweep) -> xarray.Dataset:
    unit, words = _PARAMETERS[found.parameter]
    dataset = _followed(found.tracks, found.parameter, unit, words)
    crossings = [crossing.value for crossing in found.boundaries.crossings]
    return dataset.assign_attrs({"stability_boundaries": np.array(crossings)} if crossings else {})


def _followed(found: ModeTracks, name: str, unit: str, words: str) -> xarray.Dataset:
    dims = (name, "mode")
    kinds = [["" if kind is None else kind.value for kind in line] for line in found.kinds]
    variables = {
        **_rates(dims, found.s),
        "confidence": (dims, found.confidence, "1", "assurance criterion with the point before"),
        "kind": (dims, kinds, "", "what the mode does; empty where its mirror image is followed"),
    }
    axes = {name: (found.parameter, unit, words), "mode": (list(found.labels), "", "mode, named by participation")}
    return _made(variables, axes, {})


@to_dataset.register(Margins)
def _margins(found: Margins) -> xarray.Dataset:
    one = ("channel",)
    variables: dict[str, Any] = {}
    for name, unit, words in _MARGINS:
        values = [getattr(channel, name) for channel in found.channels]
        variables[name] = (one, [v.value for v in values], unit, words)
        variables[f"{name}_at"] = (one, [v.frequency for v in values], "rad/s", f"{words}: where it is reached")
        variables[f"{name}_verified"] = (one, [v.verified for v in values], "1", f"{words}: 1 if a replay confirmed it")
    disks = [channel.disk for channel in found.channels]
    variables["disk"] = (one, [d.alpha for d in disks], "1", "disk margin; NaN where its bounds differ")
    variables["disk_proven"] = (one, [d.alpha_proven for d in disks], "1", "disk margin, proven lower bound")
    whole = found.multi_loop
    return _made(variables, {"channel": ([c.channel for c in found.channels], "", "broken signal")}, {
        "verified": int(found.verified), "skew": found.sigma, "multi_loop_disk": whole.alpha,
        "multi_loop_disk_proven": whole.alpha_proven, "multi_loop_agreement": whole.agreement.value,
    })  # fmt: skip


@to_dataset.register(Floquet)
def _floquet(found: Floquet) -> xarray.Dataset:
    one = ("exponent",)
    variables = {
        **_rates(one, found.exponents),
        **_parts("multiplier", one, found.multipliers, "1", "Floquet multiplier"),
        "error_bound": (one, found.error_bound, "1/s", "bound on the error of the exponent"),
    }
    axes = {"exponent": (np.arange(len(found.exponents)), "1", "fastest growth first")}
    verdict = {True: "stable", False: "unstable", None: "unresolved"}[found.stable]
    return _made(variables, axes, {"verdict": verdict, "agreement": found.agreement.value, "period_s": found.period})


@to_dataset.register(ResonanceMap)
def _resonance_map(found: ResonanceMap) -> xarray.Dataset:
    name = found.parameter_name
    unit, words = _PARAMETERS.get(name, ("SI", name))
    both = (name, "depth")
    variables = {
        "growth_rate": (both, found.growth_rate, "1/s", "largest growth rate"),
        "spectral_radius": (both, found.spectral_radius, "1", "largest modulus of a multiplier"),
        "unstable": (both, found.unstable, "1", "1 where unstable"),
        "unresolved": (both, found.unresolved, "1", "1 where the two engines do not agree"),
        "tongue_index": (both, found.tongue_index, "1", "-1, or the number of the tongue in names"),
        "error_bound": ((name,), found.error_bound, "1/s", "bound on the error of the growth rate"),
    }
    axes = {name: (found.parameter, unit, words), "depth": (found.depths, "1", "modulation depth")}
    dataset = _made(variables, axes, {"method": found.method, "points_checked": len(found.checked)})
    dataset.tongue_index.attrs["names"] = "; ".join(f"{k}: {one.name}" for k, one in enumerate(found.tongues))
    return dataset


@to_dataset.register(StabilityPlane)
def _plane(found: StabilityPlane) -> xarray.Dataset:
    import xarray

    names = (found.x.name, found.y.name)
    units = {axis.name: _PARAMETERS.get(axis.name, ("SI", axis.name)) for axis in (found.x, found.y)}
    variables = {
        key: (names, np.asarray(getattr(found, key)).astype(kind), array_words(key, unit, words))
        for key, unit, words, kind, _ in ARRAYS
    }
    variables["tongue_index"][2]["names"] = tongue_names(found)
    return xarray.Dataset(
        variables,
        coords={
            axis.name: (axis.name, np.asarray(axis.values), {"units": units[axis.name][0],
                                                              "long_name": units[axis.name][1]})
            for axis in (found.x, found.y)
        },
        attrs={"maglev_ctrl_version": __version__, "method": found.method, "missed_width": found.missed_width,
               "faults": "\n".join(found.faults)},
    )  # fmt: skip


@to_dataset.register(RideResponse)
def _ride(found: RideResponse) -> xarray.Dataset:
    """Spectra on one axis of frequencies: all that occur, NaN where a spectrum was not evaluated."""
    grid = np.unique(np.concatenate([np.zeros(0), *(one.frequency for one in found.spectra)]))
    density = np.full((len(found.spectra), len(grid)), np.nan)
    for k, one in enumerate(found.spectra):
        density[k, np.searchsorted(grid, one.frequency)] = one.density
    who, what = ("passenger",), ("spectrum", "frequency")
    variables = {
        "density": (what, density, "(m/s2)2/Hz", "one-sided power spectral density of the acceleration"),
        "spectrum_passenger": (("spectrum",), [one.passenger for one in found.spectra], "", "whose acceleration"),
        "spectrum_axis": (("spectrum",), [one.axis for one in found.spectra], "", "along which axis"),
        "weighted_total": (who, [p.total for p in found.passengers], "m/s2", "frequency-weighted r.m.s. acceleration"),
        "place_x": (who, [p.x for p in found.passengers], "m", "place forward of the car's centre of mass"),
        "place_y": (who, [p.y for p in found.passengers], "m", "place left of the car's centre of mass"),
        "comfort": (who, [p.comfort for p in found.passengers], "", "words of ISO 2631-1"),
    }
    axes = {
        "spectrum": (np.arange(len(found.spectra)), "1", "number of the spectrum"),
        "frequency": (grid, "Hz", "frequency"),
        "passenger": ([p.name for p in found.passengers], "", "place in the car"),
    }
    attributes = {"speed_m_per_s": found.speed, "agreement": found.agreement.value, "reason": found.reason}
    return _made(variables, axes, attributes)


@to_dataset.register(Comparison)
def _comparison(found: Comparison) -> xarray.Dataset:
    names, both = requirement_names(found), ("option", "requirement")
    shape = (len(found.options), len(names))
    value, margin = np.full(shape, np.nan), np.full(shape, np.nan)
    verdict = np.full(shape, "not asked", dtype="<U13")
    bound, limit, unit = np.full(shape, "", dtype="<U5"), np.full(len(names), np.nan), [""] * len(names)
    for i, option in enumerate(found.options):
        for one in option.requirements:
            j = names.index(one.name)
            value[i, j], margin[i, j], verdict[i, j] = one.value, one.margin_percent, one.verdict.value
            bound[i, j], limit[j], unit[j] = one.bound, one.limit, one.unit
    variables = {
        "value": (both, value, "see unit", "value of the requirement's quantity; NaN where not evaluated"),
        "margin": (both, margin, "percent", "distance inside the limit, per cent of the limit"),
        "verdict": (both, verdict, "", "PASS, FAIL, NOT EVALUATED or not asked"),
        "bound": (both, bound, "", "exact, or the side on which the value is only a bound"),
        "limit": (("requirement",), limit, "see unit", "limit of the requirement"),
        "unit": (("requirement",), unit, "", "unit of value and limit"),
        "overall": (("option",), [option.verdict.value for option in found.options], "", "verdict of the option"),
        "label": (("option",), [option.label for option in found.options], "", "option as readers know it"),
    }
    axes = {
        "option": ([option.name for option in found.options], "", "option of the scenario"),
        "requirement": (list(names), "", "requirement"),
    }
    attributes = {
        "title": found.title, "verdict": found.verdict.value, "scenario_hash": found.scenario_hash,
        "design_speed_m_per_s": found.design_speed, "design_height_m": found.design_height, "created": found.created,
    }  # fmt: skip
    return _made(variables, axes, attributes)


to_dataset.register(MapStudy, map_dataset)
to_dataset.register(SimulationStudy, simulation_dataset)
to_dataset.register(Trajectory, trajectory_dataset)
