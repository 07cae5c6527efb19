"""The torque of a magnet that rolls with its vehicle: what leaving it out does to the roll divergence at Y* = 5 mm.

Vehicle magnets are points. A coil that tilts in its own field feels a torque besides; the Hessian of the energy in
sway, heave and roll holds all of it.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.fields.section import CrossSection
from maglev_ctrl.forces.eddy_current import EddyCurrentForce, RectangularCoil

GRAVITY = 9.80665
GAP = 5e-3
SPEED = 36.1


@pytest.fixture(scope="module")
def magnet() -> EddyCurrentForce:
    guideway = CrossSection.l_shape(leg=76.2e-3, thickness=6.35e-3, conductivity=2.5e7)
    coil = RectangularCoil(length=50.8e-3, width=25.4e-3, current=6000.0, lateral=12.7e-3, height=3.175e-3)
    return EddyCurrentForce.solve(
        guideway, (coil,), height=(20e-3, 36e-3), gap=(4.9e-3, 5.1e-3), speed=(36.0, 36.2), accuracy="draft"
    )


def stiffness(magnet: EddyCurrentForce, height: float, *, tilt: bool, mirror: float = -1.0) -> FloatArray:
    """K over heave, roll, sway of the centred double-L vehicle, geometric terms included; side 1 at +y."""
    width = 0.2286 - 2.0 * GAP
    a, b = 0.45 * width, 0.5 * (width - 0.0254)
    forces = magnet.forces(height, GAP, SPEED)
    hessian = magnet.motion_stiffness(height, GAP, SPEED, [0.0])[0, 1:, 1:].real.copy()
    if not tilt:
        hessian[2, :] = hessian[:, 2] = 0.0
    # Motion of each magnet (away from its wall, up, turning away-from-wall towards up) by heave, roll, sway.
    right = np.array([[0.0, a, 1.0], [1.0, -b, 0.0], [0.0, 1.0, 0.0]])
    left = np.array([[0.0, mirror * a, mirror], [1.0, b, 0.0], [0.0, mirror, 0.0]])
    K = -(left.T @ hessian @ left + right.T @ hessian @ right)
    K[1, 1] -= 2.0 * (a * float(forces.lift) + b * float(forces.guidance))
    return K


def divergence(magnet: EddyCurrentForce, **how: float) -> float:
    """Height at which the roll-sway stiffness loses its definiteness, mm."""
    at = brentq(lambda h: np.linalg.det(stiffness(magnet, h, **how)[1:, 1:]), 21e-3, 35.9e-3)  # type: ignore[arg-type]
    return 1e3 * float(at)


def test_tilt_moves_the_divergence_by_a_fraction_of_a_millimetre(magnet: EddyCurrentForce) -> None:
    without, along = divergence(magnet, tilt=False), divergence(magnet, tilt=True)
    assert abs(without - 32.1) < 0.3  # nested layers, an independent method, give 32.1
    assert 0.0 < along - without < 0.5


def test_neither_makes_flutter(magnet: EddyCurrentForce) -> None:
    for tilt in (False, True):
        for height in np.linspace(21e-3, 35e-3, 8):
            K = stiffness(magnet, height, tilt=tilt)
            assert np.max(np.abs(K - K.T)) < 1e-9 * np.max(np.abs(K))


def test_a_magnet_turned_the_wrong_way_round_is_caught(magnet: EddyCurrentForce) -> None:
    K = stiffness(magnet, 25e-3, tilt=True, mirror=1.0)
    assert abs(K[0, 1]) > 1e-3 * abs(K[1, 1])  # heave and roll of a mirrored vehicle are uncoupled
    assert abs(stiffness(magnet, 25e-3, tilt=True)[0, 1]) < 1e-12 * abs(K[1, 1])
