"""Designs as files for other tools: C, Python, MATLAB and JSON, with their origin, and never what is not proved."""

from __future__ import annotations

import copy
import ctypes
import io
import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from design_fixture import law, small_study

from maglev_ctrl.errors import ModelError
from maglev_ctrl.proofs.file import DesignFile, from_document
from maglev_ctrl.report.design import write_design
from maglev_ctrl.report.design.exports import FALLBACK, export_design, sampled_form
from maglev_ctrl.report.design.tables import (
    gain_table,
)
from maglev_ctrl.study.design.records import DesignStudy

COMPILER = shutil.which("cc")


@pytest.fixture(scope="module")
def study() -> DesignStudy:
    return small_study()


def design_of(study: DesignStudy, name: str) -> DesignFile:
    document = law(study, name).document
    assert document is not None
    return from_document(copy.deepcopy(document))


def test_exports_carry_their_origin(study: DesignStudy) -> None:
    design = design_of(study, "lqr")
    made = {name: content for target in ("mat", "json", "c", "python") for name, content in
            export_design(design, target).items()}  # fmt: skip
    assert list(made) == ["lqr.mat", "lqr.json", "lqr.h", "lqr.c", "lqr.py", "lqr_sampled.py"]
    for name, content in made.items():
        if not name.endswith(".mat"):  # texts of MATLAB files are UTF-16
            assert study.scenario_hash.encode() in content and b"0.75 MN/m" in content, name
            assert b"sign of the feedback" in content
    assert b"a force is positive where it pushes its first end up" in made["lqr.h"]
    from scipy.io import loadmat

    read = loadmat(io.BytesIO(made["lqr.mat"]), simplify_cells=True)
    assert study.scenario_hash in read["origin"]
    names = [one["name"] for one in read["controllers"]]
    assert names == ["lqr", "lqr, sampled every 0.002 s"]
    assert np.array_equal(np.atleast_2d(read["controllers"][0]["D"]), design.controllers[0].D)
    assert read["plants"]["name"] == "design point" and read["claims"]["kind"] == "DecayClaim"
    alone = json.loads(made["lqr.json"])
    assert np.array_equal(alone["controllers"][0]["D"], design.controllers[0].D)
    assert alone["sampled"]["period"] == 0.002 and "plants" not in alone
    assert alone["origin"]["scenario"]["hash"] == study.scenario_hash


@pytest.mark.skipif(COMPILER is None, reason="there is no C compiler (cc) on this machine")
def test_scheduled_c_follows_the_parameter(study: DesignStudy, tmp_path: Path) -> None:
    design = design_of(study, "scheduled")
    for name, content in export_design(design, "c").items():
        (tmp_path / name).write_bytes(content)
    library = tmp_path / "law.so"
    flags = ["-std=c99", "-Wall", "-Werror", "-pedantic", "-shared", "-fPIC"]
    subprocess.run([COMPILER, *flags, "-o", library, tmp_path / "scheduled.c"], check=True, capture_output=True)
    step = ctypes.CDLL(str(library)).scheduled_step
    y = np.random.default_rng(1).standard_normal(len(design.controllers[0].measured))
    doubles = ctypes.POINTER(ctypes.c_double)
    gains = [one.D for one in design.controllers]
    for speed, gain in ((60.0, gains[0]), (80.0, 0.5 * (gains[0] + gains[1])), (140.0, gains[2]), (900.0, gains[2])):
        u = np.zeros(1)
        step(ctypes.c_double(speed), y.ctypes.data_as(doubles), u.ctypes.data_as(doubles))
        np.testing.assert_allclose(u, gain @ y, rtol=1e-12)
        assert not np.allclose(u, -gain @ y)


def test_scheduled_python_is_the_table(study: DesignStudy) -> None:
    design = design_of(study, "scheduled")
    made = export_design(design, "python")
    script: dict[str, object] = {}
    exec(compile(made["scheduled.py"], "scheduled.py", "exec"), script)
    at = script["law"](80.0)  # type: ignore[operator]
    np.testing.assert_allclose(at.D, 0.5 * (design.controllers[0].D + design.controllers[1].D), rtol=1e-12)
    np.testing.assert_array_equal(script["law"](140.0).D, design.controllers[2].D)  # type: ignore[operator]
    with pytest.raises(ValueError, match=r"expected 60\.0 to 140\.0, got 141"):
        script["law"](141.0)  # type: ignore[operator]
    assert json.loads(export_design(design, "json")["scheduled.json"])["schedule"]["nodes"] == [60.0, 100.0, 140.0]


def test_a_predictive_design_exports_the_law_behind_it_and_says_so(study: DesignStudy) -> None:
    design = design_of(study, "mpc")
    made = export_design(design, "c")
    assert list(made) == ["mpc_fallback.h", "mpc_fallback.c"]
    words = b" ".join(made["mpc_fallback.h"].replace(b"\n *", b"").split())
    assert FALLBACK.encode() in words and b"MPC_FALLBACK_DT 0.02" in words
    with pytest.raises(ModelError, match=r"designed for samples every 20\.0 ms and runs at no other"):
        export_design(design, "c", period=0.01)


def test_dampers_are_not_programmed(study: DesignStudy) -> None:
    with pytest.raises(ModelError, match="dampers are built, not programmed"):
        export_design(design_of(study, "dampers"), "c")
    assert list(export_design(design_of(study, "dampers"), "mat")) == ["dampers.mat"]


def test_a_sampled_loop_is_proved_before_it_is_written(study: DesignStudy) -> None:
    design = design_of(study, "worst")
    with pytest.raises(ModelError, match="C needs a sampling period, and the design has none; give one"):
        export_design(design, "c")
    held = sampled_form(design, 0.001)
    assert held is not None and "proved stable at the operating point" in held.proved
    assert list(export_design(design, "c", period=0.001)) == ["worst.h", "worst.c"]
    with pytest.raises(ModelError, match="sampled every 500 ms the loop is not stable at design point"):
        export_design(design, "c", period=0.5)
    with pytest.raises(ValueError, match="period: expected a positive time"):
        export_design(design, "json", period=-1.0)
    with pytest.raises(ValueError, match="target: expected mat, json, c, python"):
        export_design(design, "fortran")
    stored = design_of(study, "lqr")
    held = stored.extra["sampled"]["controllers"]
    held[0]["D"] = [[-value for value in row] for row in held[0]["D"]]  # a law of the wrong sign, written into the file
    with pytest.raises(ModelError, match="the loop is not stable"):
        export_design(stored, "c")


def test_signals_have_their_units(study: DesignStudy) -> None:
    design = design_of(study, "lqr")
    header = export_design(design, "c")["lqr.h"].decode()
    assert "/* car.heave, m */" in header and "/* car.heave.velocity, m/s */" in header
    assert "/* cylinder_bogie.force, N */" in header and "/* cylinder_bogie, N */" in header
    table = gain_table(law(study, "lqr"))
    assert table is not None
    units = {row[1].text: row[3].text for row in table.rows}
    assert units["car.heave"] == "N/m" and units["car.heave.velocity"] == "N/(m/s)"
    held = export_design(design_of(study, "scheduled"), "c")["scheduled.h"].decode()
    assert "parameter speed, m/s" in held


def test_names_become_identifiers(study: DesignStudy) -> None:
    design = design_of(study, "worst")
    for name, wanted in (("H-inf, 2", "H_inf_2"), ("2nd", "law_2nd"), ("while", "law_while"), ("../x", "x")):
        assert list(export_design(replace(design, name=name), "c", period=0.001)) == [f"{wanted}.h", f"{wanted}.c"]


def test_the_folder(study: DesignStudy, tmp_path: Path) -> None:
    unstable = law(study, "lqr")
    document = copy.deepcopy(unstable.document)
    assert document is not None
    for one in document["extra"]["sampled"]["controllers"]:
        one["D"] = [[-value for value in row] for row in one["D"]]
    paths = write_design(replace(study, options=(replace(unstable, document=document), law(study, "mpc"))), tmp_path)
    assert [path.name for path in paths] == ["design.html", "design.pdf", "design.json", "export"]
    assert sorted(path.name for path in (tmp_path / "export").iterdir()) == [
        "lqr.json", "lqr.mat", "lqr.py",
        "mpc_fallback.c", "mpc_fallback.h", "mpc_fallback.json", "mpc_fallback.mat", "mpc_fallback.py",
    ]  # fmt: skip
    text = (tmp_path / "export" / "mpc_fallback.py").read_text(encoding="utf-8")
    assert study.created in text  # when it was made is part of the origin
    made = subprocess.run(
        [sys.executable, str(tmp_path / "export" / "lqr.py")], capture_output=True, text=True, check=False
    )
    assert made.returncode == 0, made.stderr


def test_no_export_overwrites_another(study: DesignStudy, tmp_path: Path) -> None:
    one, other = law(study, "lqr"), law(study, "worst")
    assert other.document is not None
    named = replace(other, document={**other.document, "name": "lqr_sampled"})
    write_design(replace(study, options=(one, named)), tmp_path)
    names = sorted(path.name for path in (tmp_path / "export").iterdir())
    assert [name for name in names if name.endswith(".py")] == ["lqr.py", "lqr_sampled.py", "lqr_sampled_law.py"]
    text = (tmp_path / "export" / "lqr_sampled.py").read_text(encoding="utf-8")
    assert "one step every 0.002 s" in text  # still the sampled form of lqr
