"""Solved forces on disk: what was kept comes back, what cannot be trusted is not used, nothing stops a study."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from maglev_ctrl.fields.coil import RectangularCoil
from maglev_ctrl.fields.response import GuidewayResponse
from maglev_ctrl.fields.section import CrossSection
from maglev_ctrl.forces import Domain, MagnetDerivatives, MagnetForces
from maglev_ctrl.forces.base import no_forces
from maglev_ctrl.forces.force_map import ForceMap
from maglev_ctrl.study import force_cache
from maglev_ctrl.study.force_cache import (
    cache_folder,
    cache_key,
    keep_map,
    keep_response,
    kept_map,
    kept_response,
)

SECTION = CrossSection.l_shape(leg=76.2e-3, thickness=6.35e-3, conductivity=2.5e7)
COIL = RectangularCoil(length=0.05, width=0.025, current=6e3, lateral=0.0127, height=3e-3)
DOMAIN = Domain(height=(0.01, 0.03), gap=(0.01, 0.02), speed=(10.0, 20.0))
KEY = "0" * 64


class Source:
    """A closed form with an energy -v / (h g)."""

    domain = DOMAIN

    def energy(self, h, g, v):
        return -v / (h * g), 1.0 / v + 0.0 * h * g

    def forces(self, h, g, v):
        return MagnetForces(lift=v / (h * h * g), guidance=v / (h * g * g), drag=1.0 / v)

    def derivatives(self, h, g, v):
        rise = MagnetForces(lift=-2 * v / (h**3 * g), guidance=-v / (h * h * g * g), drag=0.0)
        widen = MagnetForces(lift=-v / (h * h * g * g), guidance=-2 * v / (h * g**3), drag=0.0)
        rest = no_forces(rise.lift.shape)
        return MagnetDerivatives(rise, widen, rest, rest, rest)


@pytest.fixture(scope="module")
def force() -> ForceMap:
    return ForceMap.of(Source())


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(force_cache.FOLDER, str(tmp_path / "kept"))
    return tmp_path / "kept"


def response() -> GuidewayResponse:
    rng = np.random.default_rng(1)
    return GuidewayResponse(
        panels=np.array([0.0, 10.0]), wavenumbers=rng.random(3), samples=rng.random((2, 4)),
        projections=rng.random((3, 4, 5)), time_constants=rng.random((3, 5)),
        regions=(((0.0, 0.1), (0.0, 0.2)),), speeds=(1.0, 2.0), frequency=3.0,
    )  # fmt: skip


def key(**changed: object) -> str:
    given = {"section": SECTION, "coils": (COIL,), "domain": DOMAIN, "accuracy": "draft", "frequency": 1.0,
             "tolerance": 1e-2} | changed  # fmt: skip
    section, coils, domain = given.pop("section"), given.pop("coils"), given.pop("domain")
    return cache_key(section, coils, domain, **given)


def test_a_map_comes_back(force: ForceMap) -> None:
    assert kept_map(KEY) is None
    keep_map(KEY, force)
    found = kept_map(KEY)
    assert found is not None
    np.testing.assert_array_equal(found.log_energy, force.log_energy)
    assert (found.quality.nodes, found.quality.worst) == (force.quality.nodes, force.quality.worst)
    assert found.domain.gap == DOMAIN.gap
    for name in ("lift", "guidance", "drag"):
        again, before = (getattr(one.forces(0.02, 0.015, 15.0), name) for one in (found, force))
        assert again == pytest.approx(before, rel=1e-13)  # the order of summation follows the memory layout


def test_a_map_without_a_wall_comes_back_without_one(force: ForceMap) -> None:
    keep_map(KEY, replace(force, domain=Domain(height=DOMAIN.height, gap=None, speed=DOMAIN.speed)))
    found = kept_map(KEY)
    assert found is not None and found.domain.gap is None


def test_a_response_comes_back_bit_for_bit() -> None:
    keep_response(KEY, response())
    found = kept_response(KEY)
    assert found is not None
    np.testing.assert_array_equal(found.projections, response().projections)
    assert (found.regions, found.speeds, found.frequency) == (((((0.0, 0.1), (0.0, 0.2))),), (1.0, 2.0), 3.0)


@pytest.mark.parametrize(
    "changed",
    [
        {"section": CrossSection.l_shape(leg=76.2e-3, thickness=6.36e-3, conductivity=2.5e7)},
        {"section": CrossSection.l_shape(leg=76.2e-3, thickness=6.35e-3, conductivity=2.6e7)},
        {"coils": (replace(COIL, current=6001.0),)},
        {"coils": (COIL, COIL)},
        {"domain": replace(DOMAIN, speed=(10.0, 21.0))},
        {"domain": replace(DOMAIN, gap=None)},
        {"accuracy": "standard"},
        {"frequency": 2.0},
        {"tolerance": 1e-3},
    ],
)
def test_every_ingredient_changes_the_key(changed: dict[str, object]) -> None:
    assert key() == key()
    assert key(**changed) != key()


def test_a_changed_method_changes_the_key(monkeypatch: pytest.MonkeyPatch) -> None:
    before = key()
    monkeypatch.setattr(force_cache, "_method_digest", lambda: "another")
    assert key() != before


def test_damaged_and_foreign_files_are_ignored_and_replaced(force: ForceMap, folder: Path) -> None:
    keep_map(KEY, force)
    (file,) = folder.iterdir()
    whole = file.read_bytes()
    foreign = [b"", b"not a zip", whole[: len(whole) // 2], whole.replace(b"log_energy", b"log_enemas")]
    for content in foreign:
        file.write_bytes(content)
        assert kept_map(KEY) is None
    keep_map(KEY, force)
    assert kept_map(KEY) is not None
    assert [one.name for one in folder.iterdir()] == [file.name]  # no temporary files are left


def test_a_file_under_another_key_is_not_taken(force: ForceMap, folder: Path) -> None:
    keep_map(KEY, force)
    (file,) = folder.iterdir()
    file.rename(file.with_name(file.name.replace(KEY[:40], "1" * 40)))
    assert kept_map("1" * 64) is None


def test_pickled_arrays_are_never_opened(force: ForceMap, folder: Path) -> None:
    keep_map(KEY, force)
    (file,) = folder.iterdir()
    opened = folder.parent / "opened"

    class Trap:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return Path.touch, (opened,)  # type: ignore[return-value]

    with file.open("wb") as stream:
        np.savez(stream, key=np.array(KEY), log_energy=np.array([Trap()], dtype=object))
    assert kept_map(KEY) is None
    assert not opened.exists()
    pickle.loads(pickle.dumps(Trap()))  # the mutant: whoever opens it springs the trap
    assert opened.exists()


def test_a_folder_that_cannot_be_written_is_no_fault(force: ForceMap, folder: Path) -> None:
    folder.write_text("a file where the folder should be")
    keep_map(KEY, force)
    assert kept_map(KEY) is None


def test_numbers_that_are_not_finite_are_not_taken(force: ForceMap) -> None:
    broken = np.array(force.log_energy)
    broken[0, 0, 0] = np.nan
    keep_map(KEY, replace(force, log_energy=broken))
    assert kept_map(KEY) is None


def test_the_folder_is_the_users_own_unless_named(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    assert cache_folder() == folder
    monkeypatch.delenv(force_cache.FOLDER)
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", "/somewhere")
    assert cache_folder() == Path("/somewhere/maglev-ctrl")
