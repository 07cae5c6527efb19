"""The one assembly: every vehicle's M, C, K, internal states, inputs, guideway terms and outputs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import block_diag

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.errors import ModelError
from maglev_ctrl.systems import Contribution, SecondOrderSystem
from maglev_ctrl.vehicle.kinematics import Poses, poses
from maglev_ctrl.vehicle.loads import MagnetField, magnet_field
from maglev_ctrl.vehicle.operating import Equilibrium, OperatingPoint
from maglev_ctrl.vehicle.outputs import coordinate_rows, link_rows, magnet_rows, sensor_rows
from maglev_ctrl.vehicle.shares import (
    Share,
    actuator_share,
    aerodynamic_shares,
    body_shares,
    coefficient_share,
    geometry_share,
    guideway_inputs,
    magnet_shares,
    spring_damper_share,
)
from maglev_ctrl.vehicle.statics import equilibrium
from maglev_ctrl.vehicle.vehicle import Vehicle


def linearize(vehicle: Vehicle, at: Equilibrium | OperatingPoint, *, pade_order: int = 4) -> SecondOrderSystem:
    """The linear model about an equilibrium: M q'' + C q' + K q = forces (Sec. 2.3 of the theory).

    Every element adds its contribution: K = -J^T S J and C = -J^T D J of each magnet, and the geometric stiffness of
    all static point forces under the name "geometry". Outputs are the sensors, every coordinate with its velocity and
    acceleration, "<magnet>.gap", and "<link>.stroke", "<link>.stroke.velocity", "<link>.force" of connections and
    actuators (no force output for an actuator without bandwidth: its force is its command).

    Parameters
    ----------
    at : an equilibrium, or an operating point at which the magnets are trimmed (`equilibrium`, hold="height")
    pade_order : order of the Pade form of actuator delays; 0 leaves the delays out

    Raises
    ------
    ModelError : no equilibrium, or a mass matrix that is not positive definite
    OutOfDomain : outside a force model's data

    Examples
    --------
    >>> from maglev_ctrl.vehicle import Body, SpringDamper
    >>> cart = Vehicle("cart", bodies=(Body("car", 10.0),), connections=(SpringDamper("leg", "car", stiffness=40.0),),
    ...                reference_height=0.1)
    >>> linearize(cart, OperatingPoint(0.0, 0.1)).state_matrix().tolist()
    [[0.0, 1.0], [-4.0, -0.0]]
    """
    state = at if isinstance(at, Equilibrium) else equilibrium(vehicle, at)
    _check_fits(vehicle, state)
    n = len(vehicle.dofs)
    found = poses(vehicle, state.displacement)
    fields = magnet_field(vehicle, state.posture, found)
    shares = _shares(vehicle, state, found, fields, pade_order=pade_order)
    M, C, K = (np.sum([getattr(share, key) for share in shares], axis=0) for key in ("M", "C", "K"))
    _check_mass(M)
    rows = [
        *sensor_rows(vehicle, found),
        *magnet_rows(vehicle, fields),
        *(row for link in vehicle.links for row in link_rows(link, found, n)),
    ]
    internal = tuple(name for share in shares for name in share.internal)
    inputs = tuple(name for share in shares for name in share.inputs)
    guideway = _guideway_names(vehicle, shares)
    still = [not np.any(K[:, i]) and not any(row.H_q[i] for row in rows) for i in range(n)]
    ignorable = tuple(name for name, ignored in zip(vehicle.dofs, still, strict=True) if ignored)
    rows += coordinate_rows(vehicle.dofs, ignorable)
    return SecondOrderSystem.from_matrices(
        M, C, K,
        dofs=vehicle.dofs,
        internal=internal,
        A_internal=_stacked([share.A_internal for share in shares]),
        G_v=np.vstack([share.G_v for share in shares]),
        F=np.hstack([share.F for share in shares]),
        inputs=inputs,
        B=np.hstack([share.B for share in shares]),
        B_internal=_stacked([_full_inputs(share) for share in shares]),
        guideway=guideway,
        K_w=_guideway_columns([share.K_w for share in shares], guideway, n),
        C_w=_guideway_columns([share.C_w for share in shares], guideway, n),
        G_wv=_guideway_rows(shares, guideway),
        outputs=tuple(row.name for row in rows),
        H_q=np.stack([row.H_q for row in rows]),
        H_v=np.stack([row.H_v for row in rows]),
        H_a=np.stack([row.H_a for row in rows]),
        H_internal=_weights([row.internal for row in rows], internal),
        H_w=_weights([row.guideway for row in rows], guideway),
        H_wv=_weights([row.guideway_rate for row in rows], guideway),
        contributions=_contributions(shares, len(internal)),
        ignorable=ignorable,
    )  # fmt: skip


def stiffness_modulation(
    vehicle: Vehicle, at: Equilibrium | OperatingPoint, *, wavelength: float, harmonics: Sequence[float] = (1.0,)
) -> tuple[FloatArray, FloatArray]:
    """Stiffness modulated at the passing frequency W = 2 pi v / wavelength by a guideway period, for unit depth.

    Magnet i at x_i meets the guideway's pattern with its own phase: its stiffness share K_i is multiplied by
    sum over k of harmonics[k-1] cos(k (W t + 2 pi x_i / wavelength)).

    Parameters
    ----------
    wavelength : m
    harmonics : (H,) amplitudes of harmonics 1..H

    Returns
    -------
    K_cos, K_sin : (H, n, n); K(t) = K + depth * sum of (K_cos[k] cos k W t + K_sin[k] sin k W t)

    Raises
    ------
    ValueError : a wavelength that is not positive
    """
    if not (np.isfinite(wavelength) and wavelength > 0.0):
        raise ValueError(f"wavelength: expected a positive length, got {wavelength}")
    state = at if isinstance(at, Equilibrium) else equilibrium(vehicle, at)
    _check_fits(vehicle, state)
    n, orders = len(vehicle.dofs), np.arange(1, len(harmonics) + 1)
    found = poses(vehicle, state.displacement)
    stations = [magnet.position[0] for magnet in vehicle.magnets]
    stations += [vehicle.body(element.body).position[0] for element in vehicle.coefficient_elements]
    shares = [share.K for share in _magnetic_shares(vehicle, state, found, magnet_field(vehicle, state.posture, found))]
    K = np.stack(shares) if shares else np.zeros((0, n, n))
    phase = 2.0 * np.pi * orders[:, None] * np.asarray(stations) / wavelength
    amplitude = np.asarray(harmonics, dtype=np.float64)[:, None]
    K_cos = np.einsum("hm,mij->hij", amplitude * np.cos(phase), K)
    K_sin = np.einsum("hm,mij->hij", -amplitude * np.sin(phase), K)
    return read_only(K_cos, name="K_cos"), read_only(K_sin, name="K_sin")


def _magnetic_shares(vehicle: Vehicle, state: Equilibrium, found: Poses, fields: MagnetField) -> list[Share]:
    n = len(vehicle.dofs)
    return [
        *magnet_shares(vehicle, fields, n),
        *(coefficient_share(e, found, speed=state.at.speed, size=n) for e in vehicle.coefficient_elements),
    ]


def _shares(vehicle: Vehicle, state: Equilibrium, found: Poses, fields: MagnetField, *, pade_order: int) -> list[Share]:
    n = len(vehicle.dofs)
    shares = [
        *body_shares(found, n),
        *_magnetic_shares(vehicle, state, found, fields),
        *(spring_damper_share(e, found, n) for e in vehicle.connections),
        *(actuator_share(e, found, pade_order=pade_order, size=n) for e in vehicle.actuators),
        *aerodynamic_shares(vehicle, state.posture, found, n),
    ]
    if vehicle.geometric_stiffness:
        shares.append(geometry_share(vehicle, state.posture, found, fields))
    return shares


def _check_fits(vehicle: Vehicle, state: Equilibrium) -> None:
    if state.displacement.shape != (len(vehicle.dofs),):
        raise ValueError(
            f"at: expected an equilibrium of {len(vehicle.dofs)} coordinates ({', '.join(vehicle.dofs)}), "
            f"got {state.displacement.shape[0]}"
        )


def _check_mass(M: FloatArray) -> None:
    lowest = float(np.min(np.linalg.eigvalsh(0.5 * (M + M.T)))) if M.size else 1.0
    if lowest <= 0.0:
        raise ModelError(
            f"mass matrix: expected a positive definite matrix, its smallest eigenvalue is {lowest:.6g}; "
            f"give every turning body its inertia (diagonal: {np.array2string(np.diag(M), precision=6)})"
        )


def _guideway_names(vehicle: Vehicle, shares: list[Share]) -> tuple[str, ...]:
    names = {name: None for share in shares for name in (*share.K_w, *share.C_w, *share.G_wv)}
    for link in vehicle.links:
        names |= dict.fromkeys(guideway_inputs(link.name, link.to, link.direction, angular=link.angular))
    for sensor in vehicle.sensors:
        names |= dict.fromkeys(guideway_inputs(sensor.name, sensor.to, sensor.direction, angular=sensor.angular))
    return tuple(names)


def _stacked(blocks: list[FloatArray]) -> FloatArray:
    """Blocks down the diagonal; empty ones keep their rows or columns."""
    return np.asarray(block_diag(*blocks), dtype=np.float64)


def _full_inputs(share: Share) -> FloatArray:
    return share.B_internal if share.B_internal.size else np.zeros((len(share.internal), len(share.inputs)))


def _guideway_columns(parts: list[dict[str, FloatArray]], names: tuple[str, ...], rows: int) -> FloatArray:
    total = np.zeros((rows, len(names)))
    for part in parts:
        for name, column in part.items():
            total[:, names.index(name)] += column
    return total


def _guideway_rows(shares: list[Share], names: tuple[str, ...]) -> FloatArray:
    return np.vstack([_guideway_columns([share.G_wv], names, len(share.internal)) for share in shares])


def _weights(parts: list[dict[str, float]], names: tuple[str, ...]) -> FloatArray:
    total = np.zeros((len(parts), len(names)))
    for i, part in enumerate(parts):
        for name, weight in part.items():
            total[i, names.index(name)] = weight
    return total


def _contributions(shares: list[Share], n_internal: int) -> tuple[Contribution, ...]:
    contributions, start = [], 0
    for share in shares:
        F = np.zeros((share.size, n_internal))
        F[:, start : start + len(share.internal)] = share.F
        start += len(share.internal)
        contributions.append(
            Contribution(
                share.name, share.kind,
                M=read_only(share.M, name="M"), C=read_only(share.C, name="C"),
                K=read_only(share.K, name="K"), F=read_only(F, name="F"),
            )
        )  # fmt: skip
    return tuple(contributions)
