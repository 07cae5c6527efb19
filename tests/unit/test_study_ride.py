"""The ride of an option: against an integral written out here, against the exact passing, and its verdicts."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.integrate
from comparison_fixture import actuator, clearance, passenger, response, worst_case
from ride_scenario import HEAD, ONE_MASS, OPTIONS, REQUIREMENTS, TRAIN, read

from maglev_ctrl.analysis.girder.contacts import element_places
from maglev_ctrl.analysis.girder.estimate import passing_estimate
from maglev_ctrl.analysis.girder.passing import passing_response
from maglev_ctrl.analysis.response.requests import Clearance
from maglev_ctrl.errors import Agreement, MaglevError, ModelError, Verdict
from maglev_ctrl.study.evidence import Evidence
from maglev_ctrl.study.law import designed_option
from maglev_ctrl.study.option import study_option
from maglev_ctrl.study.passing import flexible_span, girder_shape, largest_gap_change, span_passing, step_passing
from maglev_ctrl.study.requirements import judge
from maglev_ctrl.study.requirements_ride import RIDE_FINDERS, RIDE_OVER, points_over
from maglev_ctrl.study.ride import ride_at, ride_situations, ride_study
from maglev_ctrl.study.ride_records import MaskResult, RidePoint
from maglev_ctrl.study.robustness import robustness_study, uncertain_parameters
from maglev_ctrl.study.situation import OptionModel, Situation

PASS, FAIL, OPEN = Verdict.PASS, Verdict.FAIL, Verdict.NOT_EVALUATED
AMPLITUDE = 1.5e-6  # m, of HEAD
PLACES = {"bogie_magnet_1": 1.5, "bogie_magnet_2": -1.5, "front_winding_bogie": 3.0, "rear_winding_bogie": -3.0}
"""m forward: four magnets over 6 m are two stations of 3 m; the windings as HEAD and OPTIONS say."""


@pytest.fixture(scope="module")
def train(tmp_path_factory):
    return read(tmp_path_factory.mktemp("train"), TRAIN)


@pytest.fixture(scope="module")
def damped(train):
    return OptionModel(train, train.options[1])


@pytest.fixture(scope="module")
def studied(damped):
    return ride_study(damped, None)


# ------------------------------------------------------------------------------- against an integral of this file
def wk(s):
    """Wk of ISO 2631-1, table 3: band limits 0.4 and 100 Hz, transition 12.5 Hz, step 2.37 to 3.35 Hz."""
    w1, w2, w3, w4, w5, w6 = (2.0 * math.pi * f for f in (0.4, 100.0, 12.5, 12.5, 2.37, 3.35))
    limits = s**2 / (s**2 + math.sqrt(2.0) * w1 * s + w1**2) / (1.0 + math.sqrt(2.0) * s / w2 + (s / w2) ** 2)
    transition = (1.0 + s / w3) / (1.0 + s / (0.63 * w4) + (s / w4) ** 2)
    step = (1.0 + s / (0.91 * w5) + (s / w5) ** 2) / (1.0 + s / (0.91 * w6) + (s / w6) ** 2) * (w5 / w6) ** 2
    return limits * transition * step


def answers(model, speed, *, lead=1.0):
    """Frequencies and, for the gaps, the stroke and the car's acceleration, densities by w (1 rad/s).

    From M, C, K and the guideway's matrices alone. An element at x meets the guideway x / v before the origin does;
    `lead` -1 is the mistake of letting it come later.
    """
    plant = model.plant(Situation.of_design(model.scenario))
    assert plant.internal == ()
    w = np.geomspace(1e-3, 1e5, 400_001)
    s = 1j * w[:, None, None]
    x = np.array([PLACES[name.partition("@")[2]] for name in plant.guideway])
    met = np.exp(lead * 1j * w[:, None] * x / speed)
    force = met @ plant.K_w.T + (1j * w)[:, None] * (met @ plant.C_w.T)
    q = np.linalg.solve(s**2 * plant.M + s * plant.C + plant.K, force[..., None])[..., 0]
    rows = [plant.outputs.index(n) for n in ("bogie_magnet_1.gap", "bogie_magnet_2.gap", "secondary_bogie.stroke")]
    told = q @ plant.H_q[rows].T + met @ plant.H_w[rows].T
    car = -(w**2) * q[:, plant.dofs.index("car.heave")]
    # S(W) = 0.25 A Wc^2 / ((W^2 + Wc^2) W^2), one-sided over W = w / v
    wave, corner = w / speed, 0.8245
    density = 0.25 * AMPLITUDE * corner**2 / ((wave**2 + corner**2) * wave**2) / speed
    table = np.column_stack([told, car, car * wk(1j * w)])
    return w, np.abs(table) ** 2 * density[:, None]


def deviations(model, speed, **how):
    w, density = answers(model, speed, **how)
    return np.sqrt(scipy.integrate.trapezoid(density * w[:, None], np.log(w), axis=0))


def test_deviations_are_those_of_an_independent_integral(damped, studied):
    found = studied.points[0].response
    speed = damped.scenario.operating.speed
    told = {one.name: one.deviation for one in found.clearances}
    (rider,) = found.passengers
    mine = np.array([told["bogie_magnet_1"], told["bogie_magnet_2"], told["secondary_bogie"],
                     rider.unweighted[0], rider.weighted[0]])  # fmt: skip
    # Trapezoids over the logarithm of a smooth function that dies off at both ends: far better than 1e-6.
    assert mine == pytest.approx(deviations(damped, speed), rel=1e-6)
    assert found.agreement is Agreement.AGREED and rider.total == rider.weighted[0]
    wrong = deviations(damped, speed, lead=-1.0)  # the delay the wrong way round: front and rear change places
    assert abs(wrong[0] / mine[0] - 1.0) > 0.05 and abs(wrong[1] / mine[1] - 1.0) > 0.05


def test_the_mask_meets_the_density_of_that_integral(damped, studied):
    w, density = answers(damped, damped.scenario.operating.speed)
    inside = (w >= 2.0 * np.pi) & (w <= 20.0 * np.pi)
    (mask,) = studied.masks
    assert mask.ratio == pytest.approx(2.0 * np.pi * density[inside, 3].max() / 0.01, rel=1e-3)


def test_the_share_of_a_gap(studied):
    for one in studied.points[0].response.clearances:
        assert one.used == pytest.approx((3.0 * one.deviation + one.sag) / one.clearance, rel=1e-12)
        assert one.clearance == (pytest.approx(0.08) if one.kind == "gap" else 0.06)
        assert one.sag > 0.0 and abs(one.used * one.clearance / (3.0 * one.deviation) - 1.0) > 0.05  # sag counts


def test_places_over_the_sweeps(damped, studied):
    labels = [where for where, _ in ride_situations(damped)]
    told = [p.where for p in studied.points]
    assert labels[0] == "design point" and told[: len(labels)] == labels
    # where girders move the gaps most is looked at too, unless it is one of them
    assert told[len(labels) :] in ([], [f"speed {studied.passing.worst_speed * 3.6:.4g} km/h"])
    assert [w for w in labels if w.startswith("speed")] == [
        f"speed {v:.4g} km/h" for v in np.linspace(120.0, 400.0, 7)
    ]  # fmt: skip
    assert [w for w in labels if w.startswith("payload")] == ["payload 0 t", "payload 3 t"]
    assert {p.payload for p in studied.points} == {0.0, 2000.0, 3000.0}  # 2 t: the file's own
    only = points_over(studied.points, "payload")
    assert [p.where for p in only] == ["design point", "payload 0 t", "payload 3 t"]
    assert [p.where for p in points_over(studied.points, "nominal")] == ["design point"]
    fast = {p.where: p.response.passengers[0].total for p in studied.points}
    assert fast["speed 400 km/h"] > fast["design point"] > fast["speed 120 km/h"]


def test_a_search_sees_the_same_numbers(damped, studied):
    quick = ride_at(damped, None, Situation.of_design(damped.scenario), quick=True)
    full = studied.points[0].response
    assert quick.passengers[0].weighted == pytest.approx(full.passengers[0].weighted, rel=1e-9)
    assert {g.name: pytest.approx(g.used, rel=1e-9) for g in quick.clearances} == {
        g.name: g.used for g in full.clearances
    }
    assert quick.agreement is not Agreement.AGREED and quick.spectra == ()


# --------------------------------------------------------------------------------------------- girders and a step
def test_girders_by_harmonics_are_those_of_the_exact_passing(damped, studied):
    vehicle = damped.vehicle()
    closed = damped.closed_of(vehicle, Situation.of_design(damped.scenario), None)
    outputs = ("bogie_magnet_1.gap", "bogie_magnet_2.gap", "secondary_bogie.stroke", "car.heave.acceleration")
    speed, places, shape = damped.scenario.operating.speed, element_places(vehicle), girder_shape(damped)
    assert shape is not None
    near = passing_estimate(closed, shape, speed=speed, places=places, outputs=outputs)
    exact = passing_response(closed, shape, speed=speed, places=places, outputs=outputs)
    assert near == pytest.approx([exact.of(name).peak for name in outputs], rel=0.02)
    few = passing_estimate(closed, shape, speed=speed, places=places, outputs=outputs, harmonics=1)
    assert np.max(np.abs(few / near - 1.0)) > 0.02  # one harmonic is not enough
    passing = studied.passing
    assert passing.design_gap == exact.of("bogie_magnet_2.gap").peak > exact.of("bogie_magnet_1.gap").peak
    assert passing.check < 1e-6 and passing.reason == "" and passing.span == 25.0 and passing.sag == 3e-3
    assert passing.worst_gap >= 0.98 * np.nanmax(passing.gap) and passing.speeds[0] <= passing.worst_speed
    sags = {one.name: one.sag for one in studied.points[0].response.clearances}
    named = [sags[name] for name in ("bogie_magnet_1", "bogie_magnet_2", "secondary_bogie")]
    assert named == pytest.approx(near[:3].tolist(), rel=1e-9)


def test_without_girders_nothing_sags_and_nothing_is_passed(tmp_path):
    smooth = "".join(line for line in HEAD.splitlines(keepends=True) if not line.startswith(("girder", "step")))
    scenario = read(tmp_path, smooth + OPTIONS)
    model = OptionModel(scenario, scenario.options[1])
    assert span_passing(model, None) is flexible_span(model, None) is step_passing(model, None) is None
    here = Situation.of_design(scenario)
    (vehicle, _), plant = model.balance(here), model.plant(here)
    assert largest_gap_change(model, vehicle, plant, None, here, ("bogie_magnet_1.gap",)) == {"bogie_magnet_1.gap": 0.0}
    assert all(one.sag == 0.0 for one in ride_at(model, None, here, quick=True).clearances)


def test_a_bending_girder_only_where_it_is_asked_for(tmp_path, studied):
    assert studied.flexible is None
    beam = 'girder = { span = "25 m", flexible = { line_mass = "4 t/m", bending_stiffness = "5e10 N*m^2", modes = 1 } }'
    scenario = read(tmp_path, ONE_MASS.replace("band = {", f"{beam}\nband = {{"))
    found = flexible_span(OptionModel(scenario, scenario.options[0]), None)
    first = (math.pi / 25.0) ** 2 * math.sqrt(5e10 / 4000.0) / (2.0 * math.pi)
    assert found.frequency == pytest.approx(first, rel=1e-12)
    assert found.speed_ratio == pytest.approx(scenario.operating.speed / (2.0 * first * 25.0), rel=1e-12)
    # One mode of a girder that carries 10 t in its middle: 2 P / (m l w1^2) = 2 P l^3 / (pi^4 E I).
    bent = 2.0 * 10e3 * 9.80665 * 25.0**3 / (math.pi**4 * 5e10)
    assert found.static_deflection == pytest.approx(bent, rel=1e-4)
    assert found.stable == "stable" and found.reason == ""
    assert found.deflection == pytest.approx(found.static_deflection, rel=0.3)


def test_the_step_is_felt_at_once_and_not_more_than_the_ride_allows(damped, studied):
    step = studied.step
    assert (step.height, step.ramp, step.reason) == (2e-3, 0.5, "")
    assert 2e-3 < step.gap < 4e-3  # the surface rises 2 mm before the bogie can follow
    assert 0.0 < step.acceleration < 1.0


# ------------------------------------------------------------------------------------------------------- verdicts
@pytest.fixture(scope="module")
def bare(train):
    return study_option(train, train.options[0])


def test_an_unstable_option_has_reasons_and_never_passes(bare):
    assert all(p.response is None and "no steady response" in p.reason for p in bare.ride.points)
    assert bare.ride.masks == () and bare.ride.passing.reason and bare.ride.step.reason
    assert math.isnan(bare.ride.passing.design_gap) and math.isnan(bare.ride.step.gap)
    assert {one.verdict for one in bare.requirements} == {OPEN} and bare.verdict is OPEN
    assert all("no steady response" in one.reason and math.isnan(one.value) for one in bare.requirements)


def evidence(**found):
    return Evidence(
        design=SimpleNamespace(), sweeps={}, sweep_checks={}, margin_points=(), has_loops=False, floquet=None,
        floquet_reason="", design_values={}, **found,
    )  # fmt: skip


def test_a_wish_that_is_missed_fails_nothing(train, bare, studied):
    results = tuple(judge(one, evidence(ride=studied)) for one in train.judged)
    assert [one.verdict for one in results] == [PASS, PASS, PASS, FAIL]
    assert [one.hard for one in results] == [True, True, True, False]
    judged = replace(bare, failure="", requirements=results)
    assert judged.verdict is PASS
    assert replace(judged, requirements=(*results[:3], replace(results[3], hard=True))).verdict is FAIL
    power = results[2]
    assert power.value == 0.0 and power.worst_at == "every point"  # nothing is driven: no power is supplied


def test_a_law_supplies_power_and_calms_the_car(train, studied):
    model, design = designed_option(train, train.options[2])
    here = Situation.of_design(train)
    found = ride_at(model, design.controller, here)
    (demand,) = found.actuators
    assert demand.limit == 20e3 and 0.0 < demand.supplied_power < demand.force * demand.velocity
    assert demand.three_sigma_share == pytest.approx(3.0 * demand.force / 20e3, rel=1e-12)
    assert found.passengers[0].total < studied.points[0].response.passengers[0].total


def wanted(quantity, sense, limit, over="nominal"):
    return SimpleNamespace(name="one", quantity=quantity, sense=sense, limit=limit, over=over, unit="", hard=True)


def ridden(*responses, masks=()):
    """Evidence of a design point and speeds 1, 2, ...; None where a response is missing."""
    points = tuple(
        RidePoint("design point" if i == 0 else f"speed {i} km/h", 100.0, 0.0, one, "" if one else "not stable")
        for i, one in enumerate(responses)
    )
    study = SimpleNamespace(points=points, masks=masks)
    return evidence(ride=study)


CALM = replace(
    response(), passengers=(passenger("front", 9.0, 0.3, 0.0), passenger("rear", -9.0, 0.4, 0.0)),
    clearances=(clearance("magnet", "gap", 0.1, 0.08, 0.01), clearance("spring", "stroke", 0.0, 0.06, 0.01)),
    actuators=(actuator("one", 5e3), actuator("two", 4e3)),
)  # fmt: skip
ROUGH = replace(CALM, passengers=(passenger("front", 9.0, 0.9, 0.0), passenger("rear", -9.0, 0.5, 0.0)))
DOUBTFUL = replace(CALM, passengers=(CALM.passengers[0], passenger("rear", -9.0, 0.4, 0.0, reason="differ by 3 %")))
UNSURE = replace(
    CALM, clearances=tuple(replace(one, agreement=Agreement.UNRESOLVED, reason="differ") for one in CALM.clearances),
    actuators=(CALM.actuators[0], replace(CALM.actuators[1], agreement=Agreement.UNRESOLVED, reason="differ")),
)  # fmt: skip
EXACT = {
    "weighted_acceleration": 0.4,
    "gap_used": (0.03 + 0.004) / 0.08,
    "stroke_used": 0.03 / 0.06,
    "contact_probability": max(one.contact_per_hour for one in CALM.clearances),
    "force_used": 3.0 * 5e3 / 60e3,
    "supplied_power": 0.05 * 9e3,
    "force_rate": 9.0 * 5e3,
}


@pytest.mark.parametrize(("quantity", "value"), EXACT.items())
def test_every_quantity_of_the_ride_passes_fails_and_stays_open(quantity, value):
    loose, tight = (wanted(quantity, "at_most", factor * value) for factor in (1.01, 0.99))
    assert judge(loose, ridden(CALM)).verdict is PASS and judge(tight, ridden(CALM)).verdict is FAIL
    assert judge(loose, ridden(CALM)).margin_percent == pytest.approx(100.0 * (1.0 - 1.0 / 1.01), rel=1e-6)
    doubtful = judge(loose, ridden(DOUBTFUL if quantity == "weighted_acceleration" else UNSURE))
    assert doubtful.verdict is OPEN and "differ" in doubtful.reason
    missed = judge(replace_over(loose), ridden(CALM, None))
    assert missed.verdict is OPEN and "speed 1 km/h: not stable" in missed.reason
    assert judge(loose, ridden(CALM, None)).verdict is PASS  # asked at the design point alone
    nothing = judge(loose, evidence())
    assert nothing.verdict is OPEN and "no irregularity" in nothing.reason


def test_contact_at_rest_and_a_vehicle_without_gaps_never_pass():
    gap, contact = wanted("gap_used", "at_most", 0.5), wanted("contact_probability", "at_most", 0.9)
    loose = ridden(CALM)
    touching = RidePoint("payload 60 t", 100.0, 0.0, None, "magnet touches at rest", touches=True)
    loose.ride.points = (*loose.ride.points, touching)
    for requirement in (gap, contact):
        assert judge(requirement, loose).verdict is PASS  # asked at the design point alone
        over = judge(replace_over(requirement, "payload"), loose)
        assert over.verdict is FAIL and over.worst_at == "payload 60 t" and "touches at rest" in over.reason
    floating = ridden(replace(CALM, clearances=()))
    for requirement in (gap, contact, wanted("stroke_used", "at_most", 0.5)):
        assert judge(requirement, floating).verdict is OPEN


def replace_over(requirement, over="speed"):
    return SimpleNamespace(**(vars(requirement) | {"over": over}))


def test_the_worst_point_decides():
    calm = wanted("weighted_acceleration", "at_most", 0.5)
    assert judge(calm, ridden(CALM, ROUGH)).verdict is PASS
    over = judge(replace_over(calm), ridden(CALM, ROUGH))
    assert (
        over.verdict is FAIL and over.value == pytest.approx(0.9) and over.worst_at == "speed 1 km/h, passenger front"
    )
    assert judge(replace_over(calm, "payload"), ridden(CALM, ROUGH)).verdict is PASS
    assert set(RIDE_OVER) == {"nominal", "speed", "payload"}


def test_masks():
    mask = wanted("acceleration_mask", "at_most", 1.0)
    grid = np.array([1.0, 10.0])
    good, bad, none = (MaskResult("centre", "vertical", r, 2.0, grid, grid) for r in (0.9, 1.1, math.nan))
    assert judge(mask, ridden(CALM, masks=(good,))).verdict is PASS
    over = judge(mask, ridden(CALM, masks=(good, bad)))
    assert over.verdict is FAIL and "centre, vertical, 2 Hz" in over.worst_at
    assert judge(mask, ridden(CALM, masks=(good, none))).verdict is OPEN
    assert judge(mask, ridden(CALM)).verdict is OPEN


def test_robust_quantities_are_bounds_and_judged_as_bounds():
    safe, lost = worst_case(), worst_case(stable=FAIL)
    factor = wanted("robust_factor", "at_least", 1.0)
    proven = safe.factor.proven
    passed = judge(factor, evidence(robustness=safe))
    assert passed.verdict is PASS and passed.bound == "lower" and passed.value == proven
    # more than is proven: not known, and never a failure
    assert judge(wanted("robust_factor", "at_least", proven * 1.01), evidence(robustness=safe)).verdict is OPEN
    broken = replace(lost, factor=replace(lost.factor, found=0.8))
    failed = judge(factor, evidence(robustness=broken))
    assert failed.verdict is FAIL and failed.value == 0.8 and failed.reason
    # unstable inside the spreads, whatever factor a search along one ray found
    assert (
        judge(factor, evidence(robustness=replace(lost, factor=replace(lost.factor, found=math.inf)))).verdict is FAIL
    )
    # stable for every combination, proven in parts: the factor is at least one
    parts = replace(safe, factor=replace(safe.factor, proven=0.9))
    assert judge(factor, evidence(robustness=parts)).verdict is PASS
    assert judge(wanted("robust_factor", "at_least", 0.5), evidence(robustness=broken)).verdict is OPEN
    unknown = replace(safe, factor=replace(safe.factor, proven=math.nan), reason="a delay has no bound")
    assert judge(factor, evidence(robustness=unknown)).verdict is OPEN
    growth, damping = wanted("worst_case_growth", "at_most", 0.0), wanted("worst_case_damping", "at_least", 0.01)
    assert judge(growth, evidence(robustness=safe)).verdict is PASS
    grown = replace(lost, growth=replace(lost.growth, value=0.3, verified=True))
    assert judge(growth, evidence(robustness=grown)).verdict is FAIL
    between = replace(safe, stable=OPEN, growth=replace(safe.growth, value=-0.3, verified=True))
    assert judge(growth, evidence(robustness=between)).verdict is OPEN  # a worse combination is not excluded
    little = replace(safe, damping=replace(safe.damping, value=0.005, verified=True))
    assert judge(damping, evidence(robustness=little)).verdict is FAIL
    much = replace(safe, damping=replace(safe.damping, value=0.5, verified=True))
    assert judge(damping, evidence(robustness=much)).verdict is OPEN
    doubt = replace(safe, damping=replace(safe.damping, verified=False, reason="not replayed"))
    assert judge(damping, evidence(robustness=doubt)).reason == "not replayed"
    for quantity in ("robust_factor", "worst_case_growth", "worst_case_damping"):
        assert judge(wanted(quantity, "at_least", 0.1), evidence()).verdict is OPEN
    assert set(RIDE_FINDERS) >= set(EXACT) | {"robust_factor", "worst_case_growth", "worst_case_damping"}


# --------------------------------------------------------------------------------------------------- uncertainty
def test_what_is_uncertain_in_which_vehicle(tmp_path):
    spreads = "[uncertainty]\nmagnetic_force = 0.05\nmass = 0.02\ninertia = 0.02\ndamping = 0.9\nlag = 0.2\n"
    scenario = read(tmp_path, HEAD + spreads + OPTIONS)
    names = [
        [one.name for one in uncertain_parameters(model, model.vehicle())]
        for model in (OptionModel(scenario, option) for option in scenario.options)
    ]
    common = ["magnetic force", "mass of car", "mass of bogie", "inertia of bogie"]
    windings = ["damping of front_winding_bogie", "damping of rear_winding_bogie"]
    assert names[0] == common and names[2] == [*common, *windings, "lag of cylinder_bogie"]
    assert sorted(names[1]) == sorted([*common, "damping of damper_bogie", *windings])
    idle = read(tmp_path, HEAD + "[uncertainty]\nlag = 0.2\n" + OPTIONS)
    with pytest.raises(ModelError, match="none of the parameters"):
        robustness_study(OptionModel(idle, idle.options[1]), None)


def test_the_worst_dampings_put_the_vehicle_on_the_axis(tmp_path):
    """The combination found, written into the file by hand, has a root on the axis; nine tenths of it have not."""
    scenario = read(tmp_path, HEAD + "[uncertainty]\ndamping = 0.5\n" + OPTIONS)
    found = robustness_study(OptionModel(scenario, scenario.options[1]), None)
    assert found.stable is PASS and found.growth.value < 0.0
    assert 1.0 < found.factor.proven <= found.factor.found
    assert math.isfinite(found.factor.found) and found.factor.found < 2.0  # at 2 the dampers are gone

    def abscissa(share):
        text = OPTIONS
        for name, change in zip(found.names, found.factor.changes.tolist(), strict=True):
            label = name.removeprefix("damping of ").removesuffix("_bogie")
            head, _, tail = text.partition('name = "damped"')
            before, _, after = tail.partition(f'name = "{label}"')
            value = 30e3 if label == "damper" else 10e3
            old = f'damping = "{value / 1e3:g} kN*s/m"'
            new = f'damping = "{value * (1.0 + 0.5 * share * change)!r} N*s/m"'
            assert after.split("[[option")[0].count(old) == 1
            text = f'{head}name = "damped"{before}name = "{label}"{after.replace(old, new, 1)}'
        changed = read(tmp_path, HEAD + text)
        plant = OptionModel(changed, changed.options[1]).plant(Situation.of_design(changed))
        return float(np.max(np.linalg.eigvals(plant.state_matrix()).real))

    assert abs(abscissa(1.0)) < 1e-5 * found.factor.frequency
    assert abscissa(0.9) < -1e-3


def test_no_irregularity_no_ride(tmp_path):
    start, end = TRAIN.index("[irregularity]"), TRAIN.index("[ride]")
    scenario = read(tmp_path, TRAIN[:start] + TRAIN[end:].replace(REQUIREMENTS, ""))
    model = OptionModel(scenario, scenario.options[1])
    with pytest.raises(MaglevError, match="no irregularity"):
        ride_study(model, None)
    with pytest.raises(MaglevError, match="no irregularity"):
        ride_at(model, None, Situation.of_design(scenario))


def test_a_clearance_that_is_gone_is_refused():
    with pytest.raises(ValueError, match="positive length"):
        Clearance("gap", "gap", "m.gap", nominal=0.02, clearance=0.0)
