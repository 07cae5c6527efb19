"""The reproduction of the paper, on a force model whose answers are known: the perfectly conducting corner.

Its field is a gradient, so that undamped flutter would violate the conservation of energy; the paper's kinematics
nevertheless "flutter" from 17.24 to 22.30 mm (errata), and the guidance force has its maximum at 16.89 mm.
"""

from __future__ import annotations

import csv
import io
import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from maglev_ctrl.cli import main
from maglev_ctrl.errors import Agreement
from maglev_ctrl.forces import AbstractForceModel, CornerImageForce, Domain, MagnetDerivatives, MagnetForces
from maglev_ctrl.report import swap
from maglev_ctrl.report.paper import files, write_reproduction
from maglev_ctrl.report.paper.shapes import LARGEST, drawings
from maglev_ctrl.study.paper import cases, double_l, image_theory
from maglev_ctrl.study.paper.claims_double_l import double_l_claims
from maglev_ctrl.study.paper.claims_forces import force_claims
from maglev_ctrl.study.paper.double_l import Line, assembled_squares, closed_matrices, sweep, unstable
from maglev_ctrl.study.paper.evidence import Evidence, ranges_words, within
from maglev_ctrl.study.paper.magnet_forces import guidance_extreme, guidance_extremes, reciprocity_residual
from maglev_ctrl.study.paper.records import MODELS, ClaimVerdict, Model, Reproduction
from maglev_ctrl.study.paper.run import reproduce
from maglev_ctrl.study.paper.table1 import PRINTED, mode_table, ratios
from maglev_ctrl.vehicle.models import double_l_geometry

CORNER = CornerImageForce(6000.0, length=50.8e-3, width=25.4e-3, thickness=6.35e-3)
BAND = (17.24e-3, 22.30e-3)  # given to two decimals of a millimetre
TWO_DECIMALS = 0.01e-3
GAP, SPEED = 12.7e-3, 36.1


class Bent(AbstractForceModel):
    """The corner's forces with guidance bent by a factor on its slope over height: no gradient any more."""

    def __init__(self, factor: float) -> None:
        self.factor = factor

    @property
    def domain(self) -> Domain:
        return CORNER.domain

    def forces(self, height, gap, speed):
        return CORNER.forces(height, gap, speed)

    def derivatives(self, height, gap, speed):
        found = CORNER.derivatives(height, gap, speed)
        by_height = replace(found.by_height, guidance=self.factor * found.by_height.guidance)
        return replace(found, by_height=by_height)

    def scaled(self, factor):
        raise NotImplementedError


@pytest.fixture(scope="module")
def found() -> Reproduction:
    return reproduce(cases.perfect_conductor, quick=True)


@pytest.fixture(scope="module")
def evidence(found: Reproduction) -> Evidence:
    return Evidence(
        solved=found.solved, extremes=found.extremes, slow_extremes={},
        sweeps={(one.key, one.model): one for one in found.sweeps}, modes=found.modes, reciprocity=0.0, speeds=None,
    )  # fmt: skip


# --- Eigenvalues and boundaries --------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize(
    ("line", "value"),
    [(Line(CORNER, SPEED, GAP, "height"), 0.019), (Line(CORNER, SPEED, 25e-3, "lateral_offset", 12.7e-3), 0.004)],
)
def test_closed_matrices_are_those_of_the_assembly(model: Model, line: Line, value: float) -> None:
    mass, K = closed_matrices(line, value, model)
    closed = np.sort_complex(np.linalg.eigvals(K / mass[:, None]))
    np.testing.assert_allclose(np.sort_complex(assembled_squares(line, value, model)), closed, rtol=1e-9)


def test_the_papers_kinematics_flutter_in_the_known_band(found: Reproduction) -> None:
    paper = found.sweep("fig10", "P")
    assert paper.agreement is Agreement.AGREED
    np.testing.assert_allclose(paper.flutter, [BAND], atol=TWO_DECIMALS)
    assert not paper.divergence
    for edge in paper.boundaries:
        assert edge.value == pytest.approx(edge.eigenvalue, abs=1e-9)


def test_consistent_kinematics_never_flutter(found: Reproduction) -> None:
    """The mutant of the test above, which asks for the band: it has none, by conservation of energy."""
    for one in found.sweeps:
        if one.model != "P":
            assert one.agreement is Agreement.AGREED, one.reason
            assert not one.flutter
    ((begins, ends),) = found.sweep("fig10", "CG").divergence
    assert begins == pytest.approx(38.6e-3, abs=0.1e-3)  # "about 39 mm" in the errata
    assert ends == cases.HEIGHT_RANGE[1]


def test_curves_tell_the_same_as_boundaries(found: Reproduction) -> None:
    for one in found.sweeps:
        for x, squared in zip(one.values, one.squared, strict=True):
            if any(abs(x - edge.value) < 1e-6 for edge in one.boundaries):
                continue
            inside = tuple(any(a <= x <= b for a, b in ranges) for ranges in (one.flutter, one.divergence))
            assert unstable(squared) == inside, f"{one.key} {one.model} at {x}"


def test_offset_sweeps_are_mirror_images(found: Reproduction) -> None:
    one = found.sweep("fig13", "P")
    for squared, mirrored in zip(one.squared, one.squared[::-1], strict=True):
        np.testing.assert_allclose(np.sort_complex(squared), np.sort_complex(mirrored), rtol=1e-6, atol=1e-3)


def test_heave_stands_first(found: Reproduction) -> None:
    for model in MODELS:
        one = found.sweep("fig10", model)
        slopes = CORNER.derivatives(one.values, np.full_like(one.values, GAP), SPEED).by_height.lift
        lift = CORNER.forces(one.values, np.full_like(one.values, GAP), SPEED).lift
        np.testing.assert_allclose(one.squared[:, 0], -slopes / lift * 9.80665, rtol=1e-12)


def test_two_ways_that_disagree_are_unresolved(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mutant: the lift leg's and the lateral leg's coupling exchanged in the closed way only."""
    genuine = double_l.closed_matrices

    def exchanged(line: Line, value: object, model: Model) -> tuple[np.ndarray, np.ndarray]:
        mass, K = genuine(line, value, model)  # type: ignore[arg-type]
        K = K.copy()
        K[..., 1, 2] *= 0.9
        return mass, K

    monkeypatch.setattr(double_l, "closed_matrices", exchanged)
    one = sweep("fig10", Line(CORNER, SPEED, GAP, "height"), "P", 12e-3, 30e-3, points=11)
    assert one.agreement is Agreement.UNRESOLVED
    assert "not confirmed by the eigenvalues" in one.reason


def test_an_overlooked_band_is_unresolved(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mutant: a closed condition that never sees flutter is caught by the eigenvalues between the boundaries."""
    genuine = double_l.conditions
    monkeypatch.setattr(double_l, "conditions", lambda *a: tuple(np.abs(part) + 1e-9 for part in genuine(*a)))
    one = sweep("fig10", Line(CORNER, SPEED, GAP, "height"), "P", 12e-3, 30e-3, points=11)
    assert one.agreement is Agreement.UNRESOLVED
    assert "the eigenvalues say flutter, the conditions neither" in one.reason


def test_damping_ends_flutter_exactly_where_the_closed_form_says() -> None:
    line = Line(CORNER, SPEED, GAP, "height")
    ratio = double_l.equal_damping_that_ends_flutter(line, 0.019, "P")
    mass, K = closed_matrices(line, 0.019, "P")
    A = (K / mass[:, None])[1:, 1:]
    rate = 2.0 * ratio * math.sqrt(0.5 * np.trace(A))
    for factor, grows in ((0.999, True), (1.001, False)):
        state = np.block([[np.zeros((2, 2)), np.eye(2)], [-A, -factor * rate * np.eye(2)]])
        assert bool(np.max(np.linalg.eigvals(state).real) > 0.0) is grows


# --- Forces ----------------------------------------------------------------------------------------------------------


def test_extremes_of_the_guidance_force() -> None:
    found = guidance_extremes(CORNER, heights=cases.HEIGHT_RANGE, gaps=cases.GAP_RANGE)
    assert 1e3 * found[1].at == pytest.approx(16.89, abs=0.005)
    assert [math.isnan(one.at) for one in found] == [False, False, True, True]  # no edge, no minimum
    # Mutant: a guidance that rises over height everywhere has no maximum.
    assert math.isnan(guidance_extreme(CORNER, "height", GAP, low=5e-3, high=16.8e-3).at)


def test_reciprocity_is_measured() -> None:
    ranges = {"heights": cases.HEIGHT_RANGE, "gaps": cases.GAP_RANGE}
    assert reciprocity_residual(CORNER, **ranges) < 1e-14
    assert reciprocity_residual(Bent(1.1), **ranges) > 1e-3


def test_broken_reciprocity_is_unresolved_and_never_a_finding(evidence: Evidence) -> None:
    broken = {one.key: one for one in (*force_claims(replace(evidence, reciprocity=0.01)),
                                       *double_l_claims(replace(evidence, reciprocity=0.01)))}  # fmt: skip
    assert broken["four_stiffnesses"].verdict is ClaimVerdict.UNRESOLVED
    assert broken["classification"].verdict is ClaimVerdict.UNRESOLVED


# --- Table 1 ---------------------------------------------------------------------------------------------------------


class Table1Force(Bent):
    """Stiffnesses with k_gl = -1 N/m and k_lg = 0 that have the printed ratios, from their sum and product."""

    def __init__(self, height: float) -> None:
        width, body, a, b = double_l_geometry(GAP)
        mass_ratio = 12.0 / (width**2 + body**2)
        total, product = ((1.0 / PRINTED[height][0]) + (1.0 / PRINTED[height][1])), 1.0 / np.prod(PRINTED[height])
        self.k_gg = float(np.real(product)) / (mass_ratio * a * b)
        self.k_ll = (mass_ratio * a * b + self.k_gg - float(np.real(total))) / (mass_ratio * b * b)

    def derivatives(self, height, gap, speed):
        shape = np.shape(np.asarray(height) + np.asarray(gap))
        zero = MagnetForces(*(np.zeros(shape) for _ in range(3)))
        by_height = MagnetForces(np.full(shape, -self.k_ll), np.full(shape, -1.0), np.zeros(shape))
        by_gap = MagnetForces(np.zeros(shape), np.full(shape, -self.k_gg), np.zeros(shape))
        return MagnetDerivatives(by_height, by_gap, zero, zero, zero)


@pytest.mark.parametrize("height", PRINTED)
def test_printed_mode_vectors_come_back_from_their_stiffnesses(height: float) -> None:
    table = mode_table(Table1Force(height), height=height, gap=GAP, speed=SPEED, model="P")
    got = ratios(table)
    error = min(
        max(abs(a - b) for a, b in zip(got, order, strict=True)) for order in (PRINTED[height], PRINTED[height][::-1])
    )
    assert error < 1e-6
    assert (abs(table.squared[1].imag) > 0.0) == (height == 0.025)
    np.testing.assert_allclose(np.max(np.abs(table.vectors), axis=0), 1.0)
    # Mutant: the consistent kinematics do not have them.
    other = ratios(mode_table(Table1Force(height), height=height, gap=GAP, speed=SPEED, model="C"))
    assert max(abs(abs(a) - abs(b)) for a, b in zip(other, PRINTED[height], strict=True)) > 0.02


# --- Claims ----------------------------------------------------------------------------------------------------------


def test_verdicts_on_the_perfect_corner(found: Reproduction) -> None:
    verdicts = {claim.key: claim.verdict for claim in found.claims}
    expected = {
        "guidance_maximum": ClaimVerdict.HOLDS, "flutter_12p7": ClaimVerdict.FALSE,
        "heights_are_stable": ClaimVerdict.FALSE, "cause_of_minimum": ClaimVerdict.NOT_TESTABLE,
        "heave_damping": ClaimVerdict.NOT_TESTABLE, "pitch_square": ClaimVerdict.FALSE,
        "pitch_long": ClaimVerdict.HOLDS, "surge_exponent": ClaimVerdict.CORRECTED,
        "surge_stable": ClaimVerdict.CORRECTED, "resonance": ClaimVerdict.CORRECTED,
        "heave_uncoupled": ClaimVerdict.CORRECTED, "measured_values": ClaimVerdict.NOT_TESTABLE,
    }  # fmt: skip
    assert {key: verdicts[key] for key in expected} == expected
    assert ClaimVerdict.UNRESOLVED not in verdicts.values()
    assert len(verdicts) == len(found.claims)  # keys are unique


def test_an_unresolved_sweep_makes_its_claims_unresolved(evidence: Evidence) -> None:
    key = ("fig10", "C")
    doubtful = replace(evidence.sweeps[key], agreement=Agreement.UNRESOLVED, reason="no agreement")
    claims = {one.key: one for one in double_l_claims(replace(evidence, sweeps={**evidence.sweeps, key: doubtful}))}
    for name in ("flutter_12p7", "flutter_from_maximum", "heights_are_stable", "table_1"):
        assert claims[name].verdict is ClaimVerdict.UNRESOLVED
    assert "no agreement" in claims["flutter_12p7"].why


def test_the_cause_of_a_minimum_is_the_leg_that_moves_it(evidence: Evidence) -> None:
    def with_minima(*places: float) -> tuple:
        maxima, minima = evidence.extremes["default"][:2], evidence.extremes["default"][2:]
        return (*maxima, *(replace(one, at=at, force=1.0) for one, at in zip(minima, places, strict=True)))

    before, stays, moves = (with_minima(*p) for p in ((0.0218, 0.0238), (0.0219, 0.0239), (0.035, float("nan"))))
    for wall, floor, verdict in (
        (stays, moves, ClaimVerdict.FALSE), (moves, stays, ClaimVerdict.HOLDS), (moves, moves, ClaimVerdict.CORRECTED),
    ):  # fmt: skip
        told = force_claims(replace(evidence, extremes={"default": before, "long_wall": wall, "long_floor": floor}))
        assert next(one for one in told if one.key == "cause_of_minimum").verdict is verdict


def test_a_force_that_flutters_for_real_is_told_so() -> None:
    """Mutant of the finding: with k_gl very far from k_lg the consistent model flutters, and the verdict turns."""
    solved = replace(cases.perfect_conductor(cases.DEFAULT), force=Bent(30.0))
    one = sweep("fig10", Line(solved.force, SPEED, GAP, "height"), "C", 15e-3, 40e-3, points=11)
    assert one.flutter
    assert one.agreement is Agreement.AGREED


def test_image_theory() -> None:
    for one in image_theory.surge_thresholds():
        assert one.vehicle == pytest.approx(55.76556404461478, abs=1e-6)
        assert one.closed == pytest.approx(55.76556404461478, abs=1e-9)
    peaks = image_theory.drag_peaks()
    np.testing.assert_allclose([at for _, at, _ in peaks], [1.0, 1.42317, 1.58871], atol=1e-5)
    np.testing.assert_allclose([top for _, _, top in peaks], [0.5, 0.21683, 0.14017], atol=1e-5)
    assert image_theory.pitch_ratio(1.0) == pytest.approx(math.sqrt(1.5), rel=1e-9)
    assert abs(image_theory.pitch_ratio(1.0) - 1.4) > 0.1  # the printed value is refuted
    assert image_theory.pitch_ratio(image_theory.slenderness_of_printed_square()) == pytest.approx(1.4, abs=1e-4)
    assert min(image_theory.growth_without_air()) > 0.0


def test_words() -> None:
    assert ranges_words(((-0.0145, 0.0145),)) == "\N{MINUS SIGN}14.5 to 14.5 mm"
    assert within(((0.0193, 0.0347),), (0.019, 0.035), 1e-3)
    assert not within(((0.0172, 0.0223),), (0.019, 0.035), 1e-3)
    assert not within((), (0.019, 0.035), 1e-3)


# --- Page, files, command line ---------------------------------------------------------------------------------------


def test_everything_is_written_and_asks_nothing_of_the_network(found: Reproduction, tmp_path: Path) -> None:
    paths = write_reproduction(found, tmp_path / "out")
    assert [p.name for p in paths] == list(files.NAMES)
    page = paths[0].read_text(encoding="utf-8")
    links = re.findall(r'\b(?:href|src)="([^"]*)"', page.split('id="figure-data"')[0])
    assert links and all(link.startswith(("#", "data:")) for link in links)
    for figure in ("fig03", "fig04", "fig05", "fig06", "fig10", "fig12", "fig13", "fig14", "fig15"):
        assert f'id="figure-{figure}"' in page
    for claim in found.claims:
        assert f'id="claim-{claim.key}"' in page
    assert "omputed, not measured" in page
    record = json.loads(paths[1].read_text(encoding="utf-8"))
    assert record["kind"] == "maglev-ctrl reproduction"
    assert len(record["claims"]) == len(found.claims)
    for table in record["tables"]:
        rows = list(csv.reader(io.StringIO((tmp_path / "out" / table["file"]).read_text(encoding="utf-8"))))
        assert rows[0] == table["columns"]
        assert len(rows) > 3
        assert all(len(row) == len(rows[0]) for row in rows)


def test_a_failure_leaves_the_earlier_reproduction_as_it_was(
    found: Reproduction, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "out"
    write_reproduction(found, folder)
    (folder / "mine.txt").write_text("kept")
    before = {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()}

    def failing(*arguments: object) -> bool:
        raise OSError(28, "no space left", str(folder))

    monkeypatch.setattr(swap, "_exchange", failing)
    monkeypatch.setattr(Path, "rename", failing)  # the other way it can be done
    with pytest.raises(OSError, match="no space"):
        write_reproduction(replace(found, version="other"), folder)
    assert {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()} == before
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_a_later_reproduction_replaces_the_earlier_one_as_a_whole(found: Reproduction, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    write_reproduction(found, folder)
    (folder / "mine.txt").write_text("kept")
    write_reproduction(replace(found, tables=found.tables[:-1]), folder)
    assert {p.name for p in folder.iterdir()} == {*files.NAMES, "mine.txt"}
    assert {p.stem for p in (folder / files.DATA).iterdir()} == {table.name for table in found.tables[:-1]}
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_drawings_move_the_magnets_by_the_mode_vector(found: Reproduction) -> None:
    b = double_l_geometry(GAP)[3]
    for table in found.modes:
        for k, one in enumerate(drawings(table)):
            heave, roll, sway = one.motion
            scale = LARGEST / np.max(np.abs(table.vectors[:, k]))
            np.testing.assert_allclose(
                [heave + 1e3 * b * roll, heave - 1e3 * b * roll, sway], scale * table.vectors[:, k], atol=1e-9
            )


@pytest.fixture
def ready(found: Reproduction, monkeypatch: pytest.MonkeyPatch) -> list[dict[str, object]]:
    import maglev_ctrl.study.paper.run as module

    asked: list[dict[str, object]] = []

    def stand_in(provider: object, **how: object) -> Reproduction:
        progress = how.pop("progress")
        assert callable(progress)
        progress("half", 0.5)
        asked.append({"provider": provider, **how})
        return found

    monkeypatch.setattr(module, "reproduce", stand_in)
    return asked


def test_command_line(
    ready: list[dict[str, object]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:  # fmt: skip
    assert main(["reproduce", "--quick", "--out", str(tmp_path / "r"), "--jobs", "1"]) == 0
    assert ready == [{"provider": cases.eddy_current, "quick": True, "jobs": 1}]
    told = capsys.readouterr()
    assert "DOES NOT HOLD" in told.out and "written:" in told.out and "skipped (--quick)" in told.out
    assert "50 %  half" in told.err
    assert (tmp_path / "r" / files.PAGE).is_file()


def test_a_folder_that_cannot_be_written_is_told_before_any_work(
    ready: list[dict[str, object]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:  # fmt: skip
    file = tmp_path / "file"
    file.write_text("x")
    assert main(["reproduce", "--out", str(file)]) == 2
    assert not ready
    assert "expected a folder, got a file" in capsys.readouterr().err


def test_an_unresolved_claim_is_told_by_the_exit_status(
    found: Reproduction, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import maglev_ctrl.study.paper.run as module

    doubtful = replace(found.claims[0], verdict=ClaimVerdict.UNRESOLVED, why="two ways disagree")
    monkeypatch.setattr(module, "reproduce", lambda *a, **k: replace(found, claims=(doubtful, *found.claims[1:])))
    assert main(["reproduce", "--out", str(tmp_path / "r")]) == 1
    assert "UNRESOLVED: guidance_maximum: two ways disagree" in capsys.readouterr().out


def test_wrong_number_of_processes() -> None:
    with pytest.raises(ValueError, match="jobs: expected one or more"):
        reproduce(cases.perfect_conductor, jobs=0)
