"""The one assembly: every vehicle's M, C, K, internal states, inputs, guideway terms and outputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from maglev_ctrl.arrays import FloatArray, read_only, transpose
from maglev_ctrl.errors import ModelError
from maglev_ctrl.systems import Contribution, SecondOrderSystem
from maglev_ctrl.vehicle.circuits import wired_magnets
from maglev_ctrl.vehicle.kinematics import Stance, stance
from maglev_ctrl.vehicle.loads import MagnetField, magnet_field
from maglev_ctrl.vehicle.operating import Equilibrium, OperatingPoint
from maglev_ctrl.vehicle.shares import (
    Share,
    aerodynamic_damping,
    coefficient_share,
    magnet_damping,
    magnet_stiffness,
    turning_stiffness,
)
from maglev_ctrl.vehicle.skeleton import Skeleton, skeleton
from maglev_ctrl.vehicle.statics import equilibrium
from maglev_ctrl.vehicle.vehicle import Vehicle


def linearize(vehicle: Vehicle, at: Equilibrium | OperatingPoint, *, pade_order: int = 4) -> SecondOrderSystem:
    """The linear model about an equilibrium: M q'' + C q' + K q = forces (Sec. 2.3 of the theory).

    Every element adds its contribution: K = -J^T S J and C = -J^T D J of each magnet, and the geometric stiffness of
    all static point forces under the name "geometry". Outputs are the sensors, every coordinate with its velocity and
    acceleration, "<magnet>.gap", and "<link>.stroke", "<link>.stroke.velocity", "<link>.force" of connections and
    actuators (no force output for an actuator without bandwidth: its force is its command). An electromagnet brings
    its input, and its current as a state and output where it is driven by voltage (`circuits`).

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
    here = stance(vehicle, state.displacement)
    fields = magnet_field(vehicle, state.posture, here)
    measured = [coefficient_share(e, vehicle, speed=state.at.speed) for e in vehicle.coefficient_elements]
    felt = tuple(name for share in measured for name in share.K_w)
    base = skeleton(vehicle, here, pade_order=pade_order, felt=felt)
    shares = _filled(vehicle, state, here, fields, base=base, measured=measured)
    M, C, K = (np.sum(stack, axis=0) for stack in (shares.M, shares.C, shares.K))
    _check_mass(M)
    K_w, C_w = _guideway_matrices(fields, measured, base)
    wired = wired_magnets(vehicle, state, fields, base)
    free = ~(np.any(K, axis=0) | base.read)
    ignorable = tuple(name for name, ignored in zip(vehicle.dofs, free, strict=True) if ignored)
    outputs = base.outputs.without(ignorable)
    return SecondOrderSystem.from_matrices(
        M, C, K,
        dofs=vehicle.dofs,
        internal=base.internal,
        A_internal=wired.A_internal,
        G_v=wired.G_v,
        F=np.sum(wired.F, axis=0),
        inputs=base.inputs,
        B=wired.B,
        B_internal=wired.B_internal,
        guideway=base.guideway,
        K_w=K_w,
        C_w=C_w,
        G_wv=wired.G_wv,
        outputs=outputs.names,
        H_q=outputs.H_q,
        H_v=outputs.H_v,
        H_a=outputs.H_a,
        H_internal=outputs.H_internal,
        H_w=outputs.H_w,
        H_wv=outputs.H_wv,
        contributions=_contributions(base, shares, wired.F),
        ignorable=ignorable,
    )  # fmt: skip


def stiffness_modulation(
    vehicle: Vehicle, at: Equilibrium | OperatingPoint, *, wavelength: float, harmonics: Sequence[float] = (1.0,),
    fields: MagnetField | None = None,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Stiffness modulated at the passing frequency W = 2 pi v / wavelength by a guideway period, for unit depth.

    Magnet i at x_i meets the guideway's pattern with its own phase: its stiffness share K_i is multiplied by
    sum over k of harmonics[k-1] cos(k (W t + 2 pi x_i / wavelength)).

    Parameters
    ----------
    wavelength : m
    harmonics : (H,) amplitudes of harmonics 1..H
    fields : the magnets' forces there, where they are known already

    Returns
    -------
    K_cos, K_sin : (H, n, n); K(t) = K + depth * sum of (K_cos[k] cos k W t + K_sin[k] sin k W t)

    Raises
    ------
    ValueError : a wavelength that is not positive
    """
    K, phase, amplitude = _modulated_shares(vehicle, at, wavelength, harmonics, fields)
    K_cos = np.einsum("hm,mij->hij", amplitude * np.cos(phase), K)
    K_sin = np.einsum("hm,mij->hij", -amplitude * np.sin(phase), K)
    return read_only(K_cos, name="K_cos"), read_only(K_sin, name="K_sin")


@dataclass(frozen=True, eq=False, slots=True)
class ElementModulation:
    """Modulated stiffness of every magnet and coefficient element for unit depth: `names` (E), `K_cos`, `K_sin`
    (E, H, n, n); their sums over E are those of `stiffness_modulation`.
    """

    names: tuple[str, ...]
    K_cos: FloatArray
    K_sin: FloatArray


def element_modulation(
    vehicle: Vehicle, at: Equilibrium | OperatingPoint, *, wavelength: float, harmonics: Sequence[float] = (1.0,)
) -> ElementModulation:
    """The share of each magnet and coefficient element in `stiffness_modulation`.

    Parameters
    ----------
    wavelength : m
    harmonics : (H,) amplitudes of harmonics 1..H

    Raises
    ------
    ValueError : a wavelength that is not positive

    Examples
    --------
    >>> from maglev_ctrl.forces import ImageForce
    >>> from maglev_ctrl.vehicle import models
    >>> coil = ImageForce(1e5, 1.0, 2.5e7, 0.02, 1.0)
    >>> car = models.heave_pitch_surge(20e3, pitch_inertia=1e5, spacing=6.0, force=coil, reference_height=0.1)
    >>> found = element_modulation(car, OperatingPoint(40.0, 0.1), wavelength=12.0)
    >>> found.names, np.abs(found.K_cos).max() < 1e-9 * np.abs(found.K_sin).max()     # a quarter wave before and behind
    (('magnet_front', 'magnet_rear'), np.True_)
    """
    K, phase, amplitude = _modulated_shares(vehicle, at, wavelength, harmonics)
    K_cos = np.einsum("hm,mij->mhij", amplitude * np.cos(phase), K)
    K_sin = np.einsum("hm,mij->mhij", -amplitude * np.sin(phase), K)
    names = tuple(e.name for e in vehicle.magnets) + tuple(e.name for e in vehicle.coefficient_elements)
    return ElementModulation(names, read_only(K_cos, name="K_cos"), read_only(K_sin, name="K_sin"))


def _modulated_shares(
    vehicle: Vehicle, at: Equilibrium | OperatingPoint, wavelength: float, harmonics: Sequence[float],
    fields: MagnetField | None = None,
) -> tuple[FloatArray, FloatArray, FloatArray]:  # fmt: skip
    """Stiffness (E, n, n) of the elements that meet the guideway's pattern, their phases (H, E) and amplitudes."""
    if not (np.isfinite(wavelength) and wavelength > 0.0):
        raise ValueError(f"wavelength: expected a positive length, got {wavelength}")
    state = at if isinstance(at, Equilibrium) else equilibrium(vehicle, at)
    _check_fits(vehicle, state)
    orders = np.arange(1, len(harmonics) + 1)
    if fields is None:
        fields = magnet_field(vehicle, state.posture, stance(vehicle, state.displacement))
    stations = [magnet.position[0] for magnet in vehicle.magnets]
    stations += [vehicle.body(element.body).position[0] for element in vehicle.coefficient_elements]
    measured = [coefficient_share(e, vehicle, speed=state.at.speed).K for e in vehicle.coefficient_elements]
    K = np.concatenate([magnet_stiffness(fields), np.array(measured).reshape(-1, *fields.motion.shape[2:] * 2)])
    phase = 2.0 * np.pi * orders[:, None] * np.asarray(stations) / wavelength
    return K, phase, np.asarray(harmonics, dtype=np.float64)[:, None]


@dataclass(frozen=True, eq=False, slots=True)
class _Shares:
    """M, C, K (e, n, n) of every element."""

    M: FloatArray
    C: FloatArray
    K: FloatArray


def _filled(
    vehicle: Vehicle, state: Equilibrium, here: Stance, fields: MagnetField, *, base: Skeleton, measured: list[Share]
) -> _Shares:
    """The skeleton's shares with everything that depends on the operating point put in."""
    M, C, K = base.M.copy(), base.C.copy(), base.K.copy()
    K[base.magnets], C[base.magnets] = magnet_stiffness(fields), magnet_damping(fields)
    for i, share in enumerate(measured, base.coefficients.start):
        M[i], C[i], K[i] = share.M, share.C, share.K
    C[base.air] = aerodynamic_damping(vehicle, state.posture, here)[base.draggers]
    if vehicle.geometric_stiffness:
        K[base.geometry] = turning_stiffness(vehicle, state.posture, here, fields)
    return _Shares(M, C, K)


def _guideway_matrices(fields: MagnetField, measured: list[Share], base: Skeleton) -> tuple[FloatArray, FloatArray]:
    """K_w and C_w: what the guideway's displacement and its rate push, magnets and measured coefficients put in."""
    K_w, C_w = base.K_w.copy(), base.C_w.copy()
    turned = transpose(fields.jacobian)
    for total, slope in ((K_w, fields.by_position), (C_w, fields.by_velocity)):
        push = -turned @ slope
        total[:, base.heave_columns] = push[:, :, 2].T
        total[:, base.sway_columns] = push[base.walled, :, 1].T
    for share in measured:
        for name in share.K_w:
            K_w[:, base.guideway.index(name)] += share.K_w[name]
            C_w[:, base.guideway.index(name)] += share.C_w[name]
    return K_w, C_w


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


def _contributions(base: Skeleton, shares: _Shares, F: FloatArray) -> tuple[Contribution, ...]:
    # One check of each stack is a check of every share; what is cut out of a read-only stack is read-only.
    M, C, K = (read_only(getattr(shares, key), name=key) for key in ("M", "C", "K"))
    return tuple(
        Contribution(name, kind, M=M[i], C=C[i], K=K[i], F=F[i])
        for i, (name, kind) in enumerate(zip(base.names, base.kinds, strict=True))
    )
