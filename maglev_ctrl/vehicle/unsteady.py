"""A vehicle whose magnets answer a motion with a dynamic stiffness Q(w) instead of their quasi-static partials.

What a magnet contributes to K, C and the guideway's columns is taken out as a whole, the drag-direction term
included, and Q put in its place: as internal states from a rational fit (`UnsteadyVehicle.augmented`), and as it
is, in the vehicle's dynamic stiffness D(s) q = 0 (`UnsteadyVehicle.dynamic_stiffness`). Magnets without a dynamic
stiffness keep their quasi-static share; so does the turning of static forces (geometric stiffness).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only_any
from maglev_ctrl.errors import ModelError
from maglev_ctrl.forces.dynamic import DynamicForceModel, stiffness_at
from maglev_ctrl.forces.rational import RationalStiffness, fit_rational
from maglev_ctrl.systems import Contribution, SecondOrderSystem
from maglev_ctrl.vehicle.assembly import linearize
from maglev_ctrl.vehicle.kinematics import stance
from maglev_ctrl.vehicle.loads import MagnetField, magnet_field
from maglev_ctrl.vehicle.magnet_response import MagnetResponse, magnet_responses, static_mismatch
from maglev_ctrl.vehicle.operating import Equilibrium, OperatingPoint
from maglev_ctrl.vehicle.shares import magnet_damping, magnet_stiffness
from maglev_ctrl.vehicle.statics import equilibrium
from maglev_ctrl.vehicle.vehicle import Vehicle

SAMPLES = 41
LOWEST, HIGHEST = 0.1, 2.0  # ends of a band that is not given, relative to the slowest and fastest mode
WELL_DAMPED = 0.5
"""Damping ratio from which a mode above the band does not count."""
STATIC_AGREEMENT = 0.02
"""Largest difference of Q(0) from the quasi-static stiffness that still counts as the same magnet (maps, meshes)."""


@dataclass(frozen=True, eq=False, slots=True)
class UnsteadyVehicle:
    """A linear vehicle with dynamic magnets, in three forms.

    `quasi_static` as `linearize` makes it (or the closed loop that was given); `rest` the same without the shares of
    the dynamic magnets; `augmented` with their rational forms as internal states "<magnet>.current1", ...
    `fits` (one per magnet) the rational forms, `band` rad/s; `static_mismatch`: largest difference between Q(0) and
    the quasi-static stiffness, relative to the largest entry.
    """

    quasi_static: SecondOrderSystem
    rest: SecondOrderSystem
    augmented: SecondOrderSystem
    responses: tuple[MagnetResponse, ...]
    fits: tuple[RationalStiffness, ...]
    band: tuple[float, float]
    static_mismatch: float

    def magnets_at(self, frequency: ArrayLike) -> ComplexArray:
        """Generalised force per displacement of all dynamic magnets together; (F, n, n) N/m.

        Parameters
        ----------
        frequency : (F,) rad/s; complex ones only where the force model takes them
        """
        w = np.atleast_1d(np.asarray(frequency))
        n = len(self.rest.dofs)
        known: dict[tuple[int, float, float | None, float], ComplexArray] = {}
        total = np.zeros((len(w), n, n), dtype=np.complex128)
        for one in self.responses:
            if one.key not in known:
                known[one.key] = stiffness_at(one.model, w, height=one.height, gap=one.gap, speed=one.speed)
            total += one.on_vehicle(known[one.key])
        return total

    def static(self) -> FloatArray:
        """The magnets' generalised force per static displacement; (n, n) N/m."""
        n = len(self.rest.dofs)
        return np.asarray(sum((one.on_vehicle(one.static).real for one in self.responses), np.zeros((n, n))))

    def dynamic_stiffness(self, s: complex) -> ComplexArray:
        """D of D(s) q = 0; (n, n). Off the imaginary axis the force model must take complex frequencies."""
        w = s / 1j
        at = np.array([w.real if s.real == 0.0 else w])
        return np.asarray(rest_stiffness(self.rest, s)[0] - self.magnets_at(at)[0])


def unsteady_vehicle(
    vehicle: Vehicle,
    at: Equilibrium | OperatingPoint,
    *,
    band: tuple[float, float] | None = None,
    tolerance: float = 1e-3,
    samples: int = SAMPLES,
    dynamic: DynamicForceModel | Mapping[str, DynamicForceModel] | None = None,
    tilt: bool = False,
    system: SecondOrderSystem | None = None,
    pade_order: int = 4,
    static_agreement: float = STATIC_AGREEMENT,
) -> UnsteadyVehicle:
    """The vehicle about an equilibrium with the dynamic stiffness of its magnets.

    Parameters
    ----------
    band : frequencies over which Q is fitted, rad/s; it should hold every mode of interest. Left out, it is found from
        the quasi-static modes (`frequency_band`)
    tolerance, samples : of the rational fit, and frequencies it samples, every second one of them held back
    dynamic : dynamic stiffness of all magnets, or by magnet; what the magnets' own force models offer when left out
    tilt : whether Q's roll row and column act on the body's roll; otherwise magnets are points. A static torque of a
        tilted magnet is not part of the equilibrium.
    system : the vehicle's linear model with a loop closed around it; `linearize` when left out
    static_agreement : largest accepted difference of Q(0) from the quasi-static stiffness, relative

    Raises
    ------
    ValueError : a band that is not one, no magnet with a dynamic stiffness, an unknown magnet, batch axes, a system
        of another vehicle
    ModelError : no equilibrium, Q(0) is not the stiffness of the quasi-static magnet, or no rational form is good
        enough
    OutOfDomain : outside a force model's data
    """
    if band is not None and not (np.isfinite(band[1]) and 0.0 < band[0] < band[1]):
        raise ValueError(f"band: expected 0 < lowest < highest frequency in rad/s, got {band}")
    state = at if isinstance(at, Equilibrium) else equilibrium(vehicle, at)
    base = system if system is not None else linearize(vehicle, state, pade_order=pade_order)
    field = magnet_field(vehicle, state.posture, stance(vehicle, state.displacement))
    responses = magnet_responses(vehicle, state, field, dynamic=dynamic, tilt=tilt)
    _check_system(base, vehicle, responses, field)
    mismatch = static_mismatch(vehicle, field, responses)
    if not mismatch <= static_agreement:
        raise ModelError(
            f"dynamic stiffness: Q(0) differs from the magnets' quasi-static stiffness by {mismatch:.3g} of its "
            f"largest entry (at most {static_agreement:.3g}): not the same magnet, or another sign convention"
        )
    band = frequency_band(base) if band is None else band
    fits = _fits(responses, band=band, tolerance=tolerance, samples=samples)
    rest = _without_magnets(base, responses)
    augmented = with_rational_magnets(base, responses, fits)
    return UnsteadyVehicle(
        quasi_static=base,
        rest=replace(rest, ignorable=augmented.ignorable),
        augmented=augmented,
        responses=responses,
        fits=fits,
        band=(float(band[0]), float(band[1])),
        static_mismatch=mismatch,
    )


def frequency_band(system: SecondOrderSystem) -> tuple[float, float]:
    """From a tenth of the slowest swinging mode to twice the fastest one that is not well damped, rad/s.

    Raises
    ------
    ValueError : no mode swings, so that a band must be given

    Examples
    --------
    >>> frequency_band(SecondOrderSystem.from_matrices([[1.0]], [[0.0]], [[25.0]]))
    (0.5, 10.0)
    """
    s = np.linalg.eigvals(system.state_matrix())
    swinging = s[(s.imag > 0.0) & (np.abs(s.real) < WELL_DAMPED * np.abs(s))]
    if not len(swinging):
        raise ValueError("band: no mode swings; give the band of frequencies in rad/s")
    return float(LOWEST * np.min(np.abs(swinging))), float(HIGHEST * np.max(np.abs(swinging)))


def rest_stiffness(system: SecondOrderSystem, s: complex) -> tuple[ComplexArray, ComplexArray]:
    """D(s) of a linear system over its coordinates, internal states eliminated, and dD/ds; (n, n) each.

    Raises
    ------
    numpy.linalg.LinAlgError : s is a pole of the internal states

    Examples
    --------
    >>> D, slope = rest_stiffness(SecondOrderSystem.from_matrices([[2.0]], [[0.5]], [[8.0]]), 2.0j)
    >>> D[0, 0], slope[0, 0]
    (np.complex128(1j), np.complex128(0.5+8j))
    """
    D = s * s * system.M + s * system.C + system.K + 0j
    slope = 2.0 * s * system.M + system.C + 0j
    if system.internal:
        resolvent = s * np.eye(len(system.internal)) - system.A_internal
        drive = system.G_q + s * system.G_v + s * s * system.G_a
        answer = np.linalg.solve(resolvent, drive)
        change = np.linalg.solve(resolvent, system.G_v + 2.0 * s * system.G_a - answer)
        D, slope = D - system.F @ answer, slope - system.F @ change
    return np.asarray(D, dtype=np.complex128), np.asarray(slope, dtype=np.complex128)


def with_rational_magnets(
    system: SecondOrderSystem, responses: tuple[MagnetResponse, ...], fits: tuple[RationalStiffness, ...]
) -> SecondOrderSystem:
    """The system with the quasi-static shares of these magnets replaced by their rational forms.

    The states of a magnet are its eddy currents: z' = p z + u' for each pole and each of its motions that can occur.
    """
    bare = _without_magnets(system, responses)
    old, n = len(bare.internal), len(bare.dofs)
    blocks = [_states(one, fit) for one, fit in zip(responses, fits, strict=True)]
    new = sum(len(block.names) for block in blocks)
    A = np.zeros((old + new, old + new))
    A[:old, :old] = bare.A_internal
    G_v, F = _padded(bare.G_v, new, axis=0), _padded(bare.F, new, axis=1)
    G_wv, K_w, C_w = _padded(bare.G_wv, new, axis=0), bare.K_w.copy(), bare.C_w.copy()
    shares = {c.name: replace(c, F=_padded(c.F, new, axis=1)) for c in bare.contributions}
    M, C, K = bare.M.copy(), bare.C.copy(), bare.K.copy()
    start = old
    for one, fit, block in zip(responses, fits, blocks, strict=True):
        here = slice(start, start + len(block.names))
        A[here, here], G_v[here] = block.A, block.input @ one.motion
        own = np.zeros((n, old + new))
        own[:, here] = one.factor * one.push.T @ block.output
        F += own
        terms = [-one.on_vehicle(part).real for part in (fit.mass, fit.damping, one.static)]
        M, C, K = M + terms[0], C + terms[1], K + terms[2]
        shares[one.name] = Contribution(one.name, "magnet", M=terms[0], C=terms[1], K=terms[2], F=own)
        for name, motion in one.felt.items():
            column = bare.guideway.index(name)
            K_w[:, column] -= one.factor * one.push.T @ one.static @ motion
            C_w[:, column] -= one.factor * one.push.T @ fit.damping @ motion
            G_wv[here, column] -= block.input @ motion
        start = here.stop
    return replace(
        bare,
        M=read_only_any(M), C=read_only_any(C), K=read_only_any(K),
        internal=bare.internal + tuple(name for block in blocks for name in block.names),
        A_internal=read_only_any(A),
        G_q=read_only_any(_padded(bare.G_q, new, axis=0)), G_v=read_only_any(G_v),
        G_a=read_only_any(_padded(bare.G_a, new, axis=0)), F=read_only_any(F),
        B_internal=read_only_any(_padded(bare.B_internal, new, axis=0)),
        K_w=read_only_any(K_w), C_w=read_only_any(C_w),
        G_w=read_only_any(_padded(bare.G_w, new, axis=0)), G_wv=read_only_any(G_wv),
        H_internal=read_only_any(_padded(bare.H_internal, new, axis=1)),
        contributions=tuple(shares[c.name] for c in bare.contributions),
        # A lateral force that quasi-static theory leaves out makes a free coordinate matter.
        ignorable=tuple(name for name in bare.ignorable if not np.any(K[:, bare.dofs.index(name)])),
    )  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class _States:
    """z' = A z + input u', force = output z of one magnet."""

    names: tuple[str, ...]
    A: FloatArray
    input: FloatArray
    output: FloatArray


def _states(one: MagnetResponse, fit: RationalStiffness) -> _States:
    moved = np.any(one.motion != 0.0, axis=1) | np.any([m != 0.0 for m in one.felt.values()] or [[False] * 4], axis=0)
    pushed = np.any(one.push != 0.0, axis=1)
    A: list[FloatArray] = []
    inputs: list[FloatArray] = []
    outputs: list[FloatArray] = []
    for pole, residue in zip(fit.poles, fit.residues, strict=True):
        for column in np.flatnonzero(moved & np.any(residue[pushed] != 0.0, axis=0)):
            drive, force = np.eye(4)[column], residue[:, column]
            if pole.imag > 0.0:
                A.append(np.array([[pole.real, -pole.imag], [pole.imag, pole.real]]))
                inputs.append(np.array([drive, np.zeros(4)]))
                outputs.append(2.0 * np.stack([force.real, -force.imag], axis=1))
            else:
                A.append(np.array([[pole.real]]))
                inputs.append(drive[None, :])
                outputs.append(force.real[:, None])
    size = sum(len(block) for block in A)
    whole, at = np.zeros((size, size)), 0
    for block in A:
        whole[at : at + len(block), at : at + len(block)] = block
        at += len(block)
    return _States(
        names=tuple(f"{one.name}.current{i + 1}" for i in range(size)),
        A=whole,
        input=np.concatenate([np.zeros((0, 4)), *inputs]),
        output=np.concatenate([np.zeros((4, 0)), *outputs], axis=1),
    )


def _check_system(
    system: SecondOrderSystem, vehicle: Vehicle, responses: tuple[MagnetResponse, ...], field: MagnetField
) -> None:
    """The shares to be taken out must be the quasi-static ones: what is not in cannot be replaced, only doubled."""
    if system.M.ndim != 2:
        raise ValueError("system: expected one system, without batch axes")
    if system.dofs != vehicle.dofs:
        raise ValueError(f"system: expected the coordinates {', '.join(vehicle.dofs)}, got {', '.join(system.dofs)}")
    K, C = magnet_stiffness(field), magnet_damping(field)
    index = {magnet.name: i for i, magnet in enumerate(vehicle.magnets)}
    shares = {c.name: c for c in system.contributions if c.kind == "magnet"}
    for one in responses:
        share = shares.get(one.name)
        if share is None or not (_same(share.K, K[index[one.name]]) and _same(share.C, C[index[one.name]])):
            raise ValueError(f"system: expected the quasi-static share of {one.name!r} at this operating point")
        if np.any(share.F != 0.0):
            raise ValueError(f"system: {one.name!r} is dynamic already")


def _same(found: FloatArray, expected: FloatArray) -> bool:
    return bool(np.allclose(found, expected, rtol=1e-9, atol=1e-12 * float(np.max(np.abs(expected), initial=0.0))))


def _fits(
    responses: tuple[MagnetResponse, ...], *, band: tuple[float, float], tolerance: float, samples: int
) -> tuple[RationalStiffness, ...]:
    w = np.geomspace(band[0], band[1], samples)
    known: dict[tuple[int, float, float | None, float], RationalStiffness] = {}
    for key in dict.fromkeys(one.key for one in responses):
        alike = [one for one in responses if one.key == key]
        one = alike[0]
        # Heave and sway are always in, because the guideway can make them.
        used = np.any([(r.push != 0.0).any(axis=1) | (r.motion != 0.0).any(axis=1) for r in alike], axis=0)
        used[1:3] = True
        keep = used[:, None] & used
        Q = stiffness_at(one.model, w, height=one.height, gap=one.gap, speed=one.speed)
        known[key] = fit_rational(
            w, np.where(keep, Q, 0.0), static=np.where(keep, one.static, 0.0), tolerance=tolerance
        )
    return tuple(known[one.key] for one in responses)


def _without_magnets(system: SecondOrderSystem, responses: tuple[MagnetResponse, ...]) -> SecondOrderSystem:
    """The system without the shares of these magnets; their contributions stay, as zeros."""
    names = {one.name for one in responses}
    K_w, C_w = system.K_w.copy(), system.C_w.copy()
    shares = []
    for share in system.contributions:
        if share.name in names and share.kind == "magnet":
            nothing = np.zeros_like(share.M)
            shares.append(replace(share, M=nothing, C=nothing, K=nothing))
        else:
            shares.append(share)
    for one in responses:
        for name in one.felt:
            K_w[:, system.guideway.index(name)], C_w[:, system.guideway.index(name)] = 0.0, 0.0
    # Added up afresh: a difference of large shares would leave their rounding behind.
    M, C, K = (read_only_any(sum(getattr(share, key) for share in shares)) for key in ("M", "C", "K"))
    return replace(system, M=M, C=C, K=K, K_w=K_w, C_w=C_w, contributions=tuple(shares))


def _padded(matrix: FloatArray, count: int, *, axis: int) -> FloatArray:
    widths = [(0, 0), (0, 0)]
    widths[axis] = (0, count)
    return np.pad(matrix, widths)
