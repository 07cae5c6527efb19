"""Exports against the law itself: compiled C, MATLAB files read back, Python scripts run."""

from __future__ import annotations

import ctypes
import io
import shutil
import subprocess

import numpy as np
import pytest

from maglev_ctrl.exchange.c_code import c_scheduled_source, c_source
from maglev_ctrl.exchange.matlab import mat_bytes
from maglev_ctrl.exchange.python_code import python_source
from maglev_ctrl.proofs.claims import DecayClaim, EllipsoidClaim, GainClaim
from maglev_ctrl.synthesis.interchange import from_python_control, to_python_control
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant

COMPILER = shutil.which("cc")
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="there is no C compiler (cc) on this machine")
DOUBLES = ctypes.POINTER(ctypes.c_double)


def _law(seed=0, n=4, dt=1e-3, p=3, m=2):
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((n, n))
    A *= 0.95 / max(np.max(np.abs(np.linalg.eigvals(A))), 1e-3) if n else 1.0
    return Controller.from_matrices(
        A, rng.standard_normal((n, p)), rng.standard_normal((m, n)) * 1e4, rng.standard_normal((m, p)),
        measured=("gap", "gap.rate", "gap rate")[:p], commands=("coil 1", "coil 2")[:m], name="hover", dt=dt,
    )  # fmt: skip


def _library(tmp_path, header, source, name="hover"):
    (tmp_path / f"{name}.h").write_text(header, encoding="ascii")
    (tmp_path / f"{name}.c").write_text(source, encoding="ascii")
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O2", "-ffp-contract=off", "-shared", "-fPIC"]
    out = tmp_path / f"{name}.so"
    subprocess.run([COMPILER, *flags, "-o", out, tmp_path / f"{name}.c"], check=True, capture_output=True)
    return ctypes.CDLL(str(out))


def _run(function, y, m, *before):
    u = np.zeros(m)
    function(*(ctypes.c_double(x) for x in before), y.ctypes.data_as(DOUBLES), u.ctypes.data_as(DOUBLES))
    return u


@needs_compiler
@pytest.mark.parametrize("n", [0, 1, 4])
def test_a_thousand_steps_of_c_are_those_of_the_law(tmp_path, n):
    law = _law(n=n)
    library = _library(tmp_path, *c_source(law, "hover", comment="a law", origin="scenario */ text\nline \\"))
    rng = np.random.default_rng(1)
    measured = rng.standard_normal((1000, 3))
    for turn in range(2):  # the second time after a reset
        state, worst, mutant = np.zeros(n), 0.0, 0.0
        for y in measured:
            expected = law.C @ state + law.D @ y
            found = _run(library.hover_step, y, 2)
            worst = max(worst, np.linalg.norm(found - expected) / np.linalg.norm(expected))
            mutant = max(mutant, np.linalg.norm(found - expected[::-1]) / np.linalg.norm(expected))
            state = law.A @ state + law.B @ y
        assert worst < 1e-12, turn
        assert mutant > 1e-3
        library.hover_reset()


@needs_compiler
def test_measurements_and_commands_may_share_memory(tmp_path):
    law = _law(p=2)
    library = _library(tmp_path, *c_source(law, "hover"))
    shared = np.array([0.3, -0.7])
    expected = law.D @ shared
    library.hover_step(shared.ctypes.data_as(DOUBLES), shared.ctypes.data_as(DOUBLES))
    np.testing.assert_allclose(shared, expected, rtol=1e-12)


@needs_compiler
def test_a_scheduled_law_blends_and_clamps(tmp_path):
    at, laws = [10.0, 20.0, 50.0], [_law(seed) for seed in range(3)]
    header, source = c_scheduled_source(list(zip(at, laws, strict=True)), "hover", parameter="speed",
                                        units={"speed": "m/s"})  # fmt: skip
    library = _library(tmp_path, header, source)
    rng = np.random.default_rng(2)
    state = np.zeros(4)
    for _ in range(1000):
        y, parameter = rng.standard_normal(3), rng.choice([-5.0, 10.0, 20.0, 50.0, 99.0, rng.uniform(5.0, 60.0)])
        A, B, C, D = (
            np.array([[np.interp(parameter, at, [getattr(law, key)[i, j] for law in laws])
                       for j in range(getattr(laws[0], key).shape[1])] for i in range(getattr(laws[0], key).shape[0])])
            for key in "ABCD"
        )  # fmt: skip
        expected = C @ state + D @ y
        found = _run(library.hover_step, y, 2, parameter)
        assert np.linalg.norm(found - expected) <= 1e-12 * np.linalg.norm(expected)
        state = A @ state + B @ y
        if np.linalg.norm(state) > 1e6:
            state = np.zeros(4)
            library.hover_reset()
    library.hover_reset()
    assert np.all(np.isfinite(_run(library.hover_step, np.ones(3), 2, np.nan)))
    assert "speed, m/s" in header and "blended linearly" in header and "clamped to 10.0 and 50.0" in header


@needs_compiler
def test_a_scheduled_static_law_compiles(tmp_path):
    laws = [Controller.static([[k]], measured=("gap",), commands=("coil",), dt=0.1) for k in (1.0, 3.0)]
    library = _library(tmp_path, *c_scheduled_source([(0.0, laws[0]), (1.0, laws[1])], "hover", parameter="speed"))
    assert _run(library.hover_step, np.array([2.0]), 1, 0.25)[0] == pytest.approx(3.0, rel=1e-15)


def test_the_header_names_signals_units_and_period():
    header, source = c_source(_law(), "hover", comment="pitch law", origin="scenario 3f2a \u03b1", units={"gap": "m"})
    assert "HOVER_Y_GAP = 0, /* gap, m */" in header
    assert "HOVER_Y_GAP_RATE = 1, /* gap.rate */" in header
    assert "HOVER_Y_GAP_RATE_2 = 2, /* gap rate */" in header
    assert "HOVER_U_COIL_2 = 1" in header
    assert "#define HOVER_DT 0.001" in header
    for text in (header, source):
        assert "scenario 3f2a \\u03b1" in text and "pitch law" in text and text.isascii()
    assert "malloc" not in source


@pytest.mark.parametrize(
    ("act", "words"),
    [
        (lambda: c_source(_law(dt=None), "hover"), "give a sampling rate and discretise it first"),
        (lambda: c_source(_law(), "2fast"), "C identifier"),
        (lambda: c_source(_law(), "while"), "C identifier"),
        (lambda: c_scheduled_source([(0.0, _law())], "hover", parameter="v"), "at least two"),
        (lambda: c_scheduled_source([(1.0, _law()), (0.0, _law())], "hover", parameter="v"), "ascending"),
        (lambda: c_scheduled_source([(0.0, _law()), (1.0, _law(n=2))], "hover", parameter="v"), "same names"),
        (lambda: mat_bytes([]), "at least one law"),
    ],
)
def test_what_cannot_be_exported_is_said(act, words):
    with pytest.raises(ValueError, match=words):
        act()


def _plant():
    rng = np.random.default_rng(3)
    return Plant.from_matrices(
        rng.standard_normal((2, 2)), rng.standard_normal((2, 1)), rng.standard_normal((2, 2)),
        rng.standard_normal((1, 2)), rng.standard_normal((3, 2)), dt=1e-3, commands=("coil 1", "coil 2"),
        measured=("gap", "gap.rate", "gap rate"), states=("gap", "rate"),
    )  # fmt: skip


def test_a_matlab_file_is_read_back():
    from scipy.io import loadmat

    law, plant, rng = _law(), _plant(), np.random.default_rng(4)
    claims = [
        DecayClaim((0,), (0,), 1.5, rng.standard_normal((2, 6, 6))),
        GainClaim((0,), (0,), 2.0, rng.standard_normal((1, 6, 6)), disturbances=("w1",)),
        EllipsoidClaim((0,), (0,), rng.standard_normal((1, 6, 6)), (3.0, 4.0)),
    ]
    data = mat_bytes([law, _law(1, dt=None)], plants=[plant], claims=claims, origin="hover.toml 3f2a")
    found = loadmat(io.BytesIO(data), simplify_cells=False)
    first, second = (found["controllers"][i, 0][0, 0] for i in range(2))
    for key in "ABCD":
        np.testing.assert_array_equal(first[key], getattr(law, key))
    assert [str(x[0]) for x in first["measured"][:, 0]] == list(law.measured)
    assert first["dt"][0, 0] == 1e-3 and second["dt"][0, 0] == 0.0
    one = found["plants"][0, 0][0, 0]
    np.testing.assert_array_equal(one["B2"], plant.B2)
    np.testing.assert_array_equal(one["D21"], plant.D21)
    assert str(one["states"][1, 0][0]) == "rate"
    kinds = [str(found["claims"][i, 0][0, 0]["kind"][0]) for i in range(3)]
    assert kinds == ["DecayClaim", "GainClaim", "EllipsoidClaim"]
    np.testing.assert_array_equal(found["claims"][0, 0][0, 0]["P"][:, :, 1], claims[0].P[1])
    assert found["claims"][0, 0][0, 0]["rate"][0, 0] == 1.5
    assert found["claims"][0, 0][0, 0]["plants"][0, 0] == 1.0
    assert str(found["origin"][0]) == "hover.toml 3f2a"
    assert data == mat_bytes([law, _law(1, dt=None)], plants=[plant], claims=claims, origin="hover.toml 3f2a")


@pytest.mark.parametrize(("n", "dt"), [(4, 1e-3), (0, 1e-3), (2, None)])
def test_a_python_script_rebuilds_the_law(n, dt):
    law = _law(n=n, dt=dt)
    content: dict[str, object] = {}
    exec(python_source(law, origin='say """x""" \\ \n end'), content)
    rebuilt = content["law"]
    for key in "ABCD":
        np.testing.assert_array_equal(getattr(rebuilt, key), getattr(law, key))
    assert rebuilt.dt == (0 if dt is None else dt)
    assert content["MEASURED"] == law.measured and content["COMMANDS"] == law.commands
    assert content["ORIGIN"] == 'say """x""" \\ \n end'
    assert rebuilt.input_labels == ["gap", "gap_rate", "gap rate"]


def test_python_control_and_back():
    law, plant = _law(), _plant()
    back = from_python_control(to_python_control(law), measured=law.measured, commands=law.commands)
    for key in "ABCD":
        np.testing.assert_array_equal(getattr(back, key), getattr(law, key))
    assert back.dt == law.dt
    whole = to_python_control(plant)
    np.testing.assert_array_equal(whole.B, np.hstack([plant.B1, plant.B2]))
    assert whole.input_labels == ["w1", "coil 1", "coil 2"]
    assert from_python_control(to_python_control(_law(dt=None))).dt is None
