"""Modes of a linear system: eigenvalues with error bounds, kinds of instability, labels, energy ledger.

A verdict (stable, unstable) is given only when the eigenvalues leave the imaginary axis by more than their error
bound and Lyapunov inertia, a method that needs no eigenvalue, proves the same; otherwise it is UNRESOLVED.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from enum import Enum
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.analysis.hurwitz import InertiaCertificate, lyapunov_inertia
from maglev_ctrl.analysis.ledger import Ledger, energy_ledger
from maglev_ctrl.analysis.spectrum import Spectrum, system_spectrum
from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only_any
from maglev_ctrl.display import Shown
from maglev_ctrl.errors import Agreement
from maglev_ctrl.systems import Contribution, SecondOrderSystem

NAMED_SHARE = 0.4  # a coordinate joins a label when it takes part at least this much of the leading one
LABEL_LENGTH = 3


class ModeKind(Enum):
    """What a mode does, and for a growing one, what makes it grow."""

    STABLE = "stable"
    NEUTRAL = "neutral"
    DIVERGENCE = "divergence"
    SINGLE_MODE_FLUTTER = "damping-controlled single-mode flutter"
    COUPLED_MODE_FLUTTER = "stiffness-controlled coupled-mode flutter"


class StabilityVerdict(Enum):
    """Stability of a linear system as far as two independent methods agree."""

    STABLE = "stable"
    UNSTABLE = "unstable"
    UNRESOLVED = "unresolved: the growth rate is within its error bound, or the second method does not confirm it"


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Modes(Shown):
    """Modes of one system, one per conjugate pair (Im s >= 0) and one per real eigenvalue, by rising frequency.

    `s` (m,) complex 1/s; `states`, `left` (nx, m) right and left eigenvectors, left^H states = 1 unless defective;
    `shapes` (n, m) displacements (of ignorable coordinates too), largest entry 1; `natural_frequency` |s| rad/s;
    `damping_ratio` (NaN at s = 0); `frequency` Im s / 2 pi in Hz; `participation` (n, m) columns add to 1 (or are
    zero for a mode of internal states alone); `error_bound` (m,) 1/s on |s|; `certificate` the Lyapunov inertia
    behind `verdict`; `state_matrix` (nx, nx) the modes are of.
    """

    _told: ClassVar = ("labels", "verdict", "spectral_abscissa")

    s: ComplexArray
    states: ComplexArray
    left: ComplexArray
    shapes: ComplexArray
    natural_frequency: FloatArray
    damping_ratio: FloatArray
    frequency: FloatArray
    kind: tuple[ModeKind, ...]
    labels: tuple[str, ...]
    participation: FloatArray
    ledger: Ledger
    error_bound: FloatArray
    verdict: StabilityVerdict
    certificate: InertiaCertificate
    dofs: tuple[str, ...]
    state_matrix: FloatArray

    @property
    def spectral_abscissa(self) -> float:
        """Largest growth rate Re s in 1/s."""
        return float(np.max(self.s.real))

    @property
    def stable(self) -> bool:
        """True when stability is proved by both methods; False for UNSTABLE and for UNRESOLVED."""
        return self.verdict is StabilityVerdict.STABLE

    @property
    def agreement(self) -> Agreement:
        """Whether eigenvalues and Lyapunov inertia agree on a verdict."""
        return Agreement.UNRESOLVED if self.verdict is StabilityVerdict.UNRESOLVED else Agreement.AGREED

    @property
    def critical(self) -> int:
        """Index of the mode with the largest growth rate."""
        return int(np.argmax(self.s.real))


def modes(system: SecondOrderSystem, *, relative_data_error: float = 0.0) -> Modes:
    """Modes of one system.

    Parameters
    ----------
    system : open or closed loop, without batch axes (stacks: `modes_of_stack`)
    relative_data_error : relative uncertainty of the matrix entries; widens the error bounds, and with them what
        counts as neutral or unresolved

    Raises
    ------
    ValueError : the system carries batch axes or has no state
    ModelError : the mass matrix is singular, or the contributions do not add up to the matrices

    Examples
    --------
    >>> found = modes(SecondOrderSystem.from_matrices([[1.0]], [[-0.2]], [[4.0]], dofs=("car.heave",)))
    >>> found.labels, found.kind[0].value, found.verdict.value
    (('car heave',), 'damping-controlled single-mode flutter', 'unstable')
    """
    if relative_data_error < 0.0:
        raise ValueError(f"relative_data_error: expected a number >= 0, got {relative_data_error}")
    found = system_spectrum(system, relative_data_error=relative_data_error)
    shapes, states, left = _normalised(system, found)
    A = system.state_matrix()
    ledger = energy_ledger(
        system, found.s, shapes, states[len(states) - len(system.internal) :], error=found.error_bound
    )
    share = participation_factors(states, left)
    by_dof = _by_coordinate(system, share)
    verdict, certificate = _verdict(A, found)
    with np.errstate(invalid="ignore"):
        damping_ratio = -found.s.real / np.abs(found.s)
    return Modes(
        s=found.s,
        states=_frozen_complex(states),
        left=_frozen_complex(left),
        shapes=_frozen_complex(shapes),
        natural_frequency=read_only_any(np.abs(found.s)),
        damping_ratio=read_only_any(damping_ratio),
        frequency=read_only_any(found.s.imag / (2.0 * np.pi)),
        kind=_kinds(found, ledger, shapes),
        labels=unique_labels(mode_labels(system, share)),
        participation=read_only_any(by_dof),
        ledger=ledger,
        error_bound=found.error_bound,
        verdict=verdict,
        certificate=certificate,
        dofs=system.dofs,
        state_matrix=read_only_any(A),
    )


def modes_of_stack(system: SecondOrderSystem, *, relative_data_error: float = 0.0) -> tuple[Modes, ...]:
    """Modes of every system of a stack with one leading batch axis, in order.

    Raises
    ------
    ValueError : the system does not carry exactly one batch axis

    Examples
    --------
    >>> stack = SecondOrderSystem.from_matrices([[1.0]], [[0.1]], [[[4.0]], [[9.0]]])
    >>> [round(float(m.natural_frequency[0])) for m in modes_of_stack(stack)]
    [2, 3]
    """
    return tuple(modes(one, relative_data_error=relative_data_error) for one in unstack(system))


def unstack(system: SecondOrderSystem) -> tuple[SecondOrderSystem, ...]:
    """The systems of a stack with one leading batch axis.

    Raises
    ------
    ValueError : the system does not carry exactly one batch axis

    Examples
    --------
    >>> len(unstack(SecondOrderSystem.from_matrices([[1.0]], [[0.1]], [[[4.0]], [[9.0]]])))
    2
    """
    keys = [f.name for f in fields(system) if isinstance(getattr(system, f.name), np.ndarray)]
    batch = np.broadcast_shapes(*(getattr(system, key).shape[:-2] for key in keys))
    if len(batch) != 1:
        raise ValueError(f"system: expected one batch axis, got batch shape {batch}")

    def entry(matrix: FloatArray, k: int) -> FloatArray:
        return matrix[k if matrix.shape[0] > 1 else 0] if matrix.ndim == 3 else matrix

    def share(c: Contribution, k: int) -> Contribution:
        return replace(c, M=entry(c.M, k), C=entry(c.C, k), K=entry(c.K, k), F=entry(c.F, k))

    singles = []
    for k in range(batch[0]):
        arrays: dict[str, Any] = {key: entry(getattr(system, key), k) for key in keys}
        shares = tuple(share(c, k) for c in system.contributions)
        singles.append(replace(system, contributions=shares, **arrays))
    return tuple(singles)


def spectral_abscissa(system: SecondOrderSystem) -> FloatArray:
    """Largest growth rate of every system of a stack, in 1/s; (...,). No verdict and no error bound: for sweeps.

    Raises
    ------
    ValueError : the system has no state

    Examples
    --------
    >>> stack = SecondOrderSystem.from_matrices([[1.0]], [[[0.5]], [[-0.5]]], [[4.0]])
    >>> spectral_abscissa(stack).round(12).tolist()
    [-0.25, 0.25]
    """
    return state_abscissa(system.state_matrix())


def state_abscissa(A: ArrayLike) -> FloatArray:
    """Largest real part of the eigenvalues of every matrix of a stack (..., nx, nx); (...,) 1/s.

    Raises
    ------
    ValueError : not square matrices

    Examples
    --------
    >>> float(state_abscissa([[-1.0, 5.0], [0.0, -2.0]]))
    -1.0
    """
    matrices = np.asarray(A, dtype=np.float64)
    if matrices.ndim < 2 or matrices.shape[-1] != matrices.shape[-2] or not matrices.shape[-1]:
        raise ValueError(f"A: expected shape (..., nx, nx) with nx >= 1, got {matrices.shape}")
    return np.asarray(np.max(np.linalg.eigvals(matrices).real, axis=-1), dtype=np.float64)


def participation_factors(states: ComplexArray, left: ComplexArray) -> FloatArray:
    """Share of every state in every mode, |left * right| scaled to add to 1 per mode; (nx, m).

    Independent of units, unlike the entries of a shape (Perez-Arriaga, Verghese & Schweppe 1982).

    Examples
    --------
    >>> participation_factors(np.array([[1.0], [1j]]), np.array([[0.5], [0.5j]])).ravel().tolist()
    [0.5, 0.5]
    """
    weight = np.abs(states) * np.abs(left)
    total = np.sum(weight, axis=0)
    return np.asarray(weight / np.where(total == 0.0, 1.0, total))


def mode_labels(system: SecondOrderSystem, share: FloatArray) -> tuple[str, ...]:
    """A name per mode from the participation (nx, m) of its states: "car heave", "bogie_1 heave / car pitch", ...

    Coordinates name a mode; internal states only where they hold more of it than all coordinates together.
    """
    by_dof = _by_coordinate(system, share, normalise=False)
    inner = share[len(share) - len(system.internal) :]
    from_inside = np.sum(inner, axis=0) > np.sum(by_dof, axis=0)
    by_freedom = leading_names(system.dofs, by_dof)
    if not np.any(from_inside):
        return tuple(by_freedom)
    by_inner = leading_names(system.internal, inner)
    return tuple(own if inside else outer for own, outer, inside in zip(by_inner, by_freedom, from_inside, strict=True))


def leading_names(names: tuple[str, ...], weights: FloatArray) -> list[str]:
    """The names that weigh most in each mode, from weights (names, m)."""
    # Shares equal to a tenth keep the order of the coordinates, so that twins are named alike.
    tenths = np.round(weights / np.maximum(np.max(weights, axis=0), np.finfo(float).tiny), 1)
    order = np.argsort(-tenths, axis=0, kind="stable")
    ranked = np.take_along_axis(weights, order, axis=0)
    named = ranked >= NAMED_SHARE * ranked[0]
    return [
        " / ".join(names[i].replace(".", " ") for i in order[named[:, k], k][:LABEL_LENGTH])
        for k in range(weights.shape[1])
    ]


def unique_labels(labels: tuple[str, ...]) -> tuple[str, ...]:
    """Doubled labels told apart by a number.

    Examples
    --------
    >>> unique_labels(("heave", "pitch", "heave"))
    ('heave (1)', 'pitch', 'heave (2)')
    """
    seen: dict[str, int] = {}
    numbered = []
    for label in labels:
        seen[label] = seen.get(label, 0) + 1
        numbered.append(f"{label} ({seen[label]})" if labels.count(label) > 1 else label)
    return tuple(numbered)


def _normalised(system: SecondOrderSystem, found: Spectrum) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Shapes with largest entry 1, and the eigenvectors scaled along with them."""
    kept, n = list(system.positions), len(system.dofs)
    states, left = found.right.copy(), found.left.copy()
    velocity = states[len(kept) : len(kept) + n]
    shapes = np.zeros((n, len(found.s)), dtype=np.complex128)
    shapes[kept] = states[: len(kept)]
    gone = [i for i in range(n) if i not in kept]
    moving = found.s != 0.0
    shapes[np.ix_(gone, moving)] = velocity[np.ix_(gone, moving)] / found.s[moving]
    for k in np.flatnonzero(~moving):
        # At s = 0 an ignorable coordinate drifts at a constant rate: next to that drift every displacement vanishes.
        if np.any(velocity[gone, k] != 0.0):
            shapes[:, k] = 0.0
            shapes[gone, k] = velocity[gone, k]
    largest = np.argmax(np.abs(shapes), axis=0)
    scale = shapes[largest, np.arange(len(found.s))]
    present = np.abs(scale) > 0.0
    scale = np.where(present, scale, 1.0)
    return shapes / scale, states / scale, left * scale.conj()


def _by_coordinate(system: SecondOrderSystem, share: FloatArray, *, normalise: bool = True) -> FloatArray:
    kept, n = list(system.positions), len(system.dofs)
    by_dof = share[len(kept) : len(kept) + n].copy()
    by_dof[kept] += share[: len(kept)]
    if not normalise:
        return by_dof
    total = np.sum(by_dof, axis=0)
    return np.asarray(by_dof / np.where(total == 0.0, 1.0, total))


def _kinds(found: Spectrum, ledger: Ledger, shapes: ComplexArray) -> tuple[ModeKind, ...]:
    kinds = []
    for k, s in enumerate(found.s):
        error = found.error_bound[k]
        damping, circulatory = np.sum(ledger.damping[:, k]), np.sum(ledger.circulatory[:, k])
        if abs(s.real) <= error:
            kinds.append(ModeKind.NEUTRAL)
        elif s.real < 0.0:
            kinds.append(ModeKind.STABLE)
        elif s.imag <= error:
            kinds.append(ModeKind.DIVERGENCE)
        elif np.isnan(damping) and np.any(shapes[:, k] != 0.0):
            # No element does net work, yet the mode grows: conservative forces coupled by gyroscopic ones.
            kinds.append(ModeKind.COUPLED_MODE_FLUTTER)
        else:
            coupled = circulatory > damping
            kinds.append(ModeKind.COUPLED_MODE_FLUTTER if coupled else ModeKind.SINGLE_MODE_FLUTTER)
    return tuple(kinds)


def _verdict(A: FloatArray, found: Spectrum) -> tuple[StabilityVerdict, InertiaCertificate]:
    """Eigenvalues propose, inertia disposes."""
    growth, error = found.s.real, found.error_bound
    multiplicity = np.where(found.s.imag > 0.0, 2, 1)
    if np.all(growth < -error):
        certificate = lyapunov_inertia(A)
        agreed = certificate.certified and certificate.right == 0
        return StabilityVerdict.STABLE if agreed else StabilityVerdict.UNRESOLVED, certificate
    if np.any(growth > error):
        shift = _widest_gap(growth)
        certificate = lyapunov_inertia(A, shift=shift)
        expected = int(np.sum(multiplicity[growth > shift]))
        agreed = certificate.certified and certificate.right == expected > 0
        return StabilityVerdict.UNSTABLE if agreed else StabilityVerdict.UNRESOLVED, certificate
    return StabilityVerdict.UNRESOLVED, lyapunov_inertia(A)


def _widest_gap(growth: FloatArray) -> float:
    """A line Re s = shift >= 0 left of the fastest growing eigenvalue and as far as possible from all of them."""
    levels = np.unique(np.concatenate([[0.0], growth[growth > 0.0]]))
    widest = int(np.argmax(np.diff(levels)))
    return float((levels[widest] + levels[widest + 1]) / 2.0)


def _frozen_complex(array: ComplexArray) -> ComplexArray:
    return read_only_any(np.asarray(array, dtype=np.complex128))
