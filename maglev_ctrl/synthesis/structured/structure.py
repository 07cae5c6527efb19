"""Which gains of a law may be chosen: order, sparsity, gains that are equal, fixed or bounded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import ModelError
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant


@dataclass(frozen=True, eq=False, slots=True)
class Structure:
    """Admissible laws K(theta) = base + sum of theta_i basis_i with lower <= theta <= upper.

    K (nu + order, ny + order) is the law as one matrix, [[D, C], [B, A]]: commands, then the law's own states, from
    measurements, then those states. `order` 0 is static feedback. The basis matrices share no entry.
    """

    base: FloatArray
    basis: FloatArray
    lower: FloatArray
    upper: FloatArray
    order: int

    @classmethod
    def from_mask(
        cls,
        mask: ArrayLike,
        *,
        order: int = 0,
        groups: ArrayLike | None = None,
        fixed: ArrayLike | None = None,
        lower: ArrayLike = -np.inf,
        upper: ArrayLike = np.inf,
    ) -> Structure:
        """A structure from matrices of the size of K.

        Parameters
        ----------
        mask : (nu + order, ny + order) true where the entry may be non-zero
        groups : integers of the same size; entries with the same positive integer share one gain
        fixed : the same size; a number fixes the entry (it then need not be in the mask), NaN leaves it free
        lower, upper : scalars or the same size; bounds of the free entries

        Raises
        ------
        ValueError : sizes differ, bounds cross

        Examples
        --------
        >>> both = Structure.from_mask([[1, 0], [0, 1]], groups=[[1, 0], [0, 1]], upper=0.0)
        >>> both.gain([-3.0])
        array([[-3., 0.], [ 0., -3.]])
        """
        allowed = np.asarray(mask, dtype=bool)
        if allowed.ndim != 2 or order < 0 or min(allowed.shape) < order:
            raise ValueError(f"mask: expected (nu + {order}, ny + {order}), got shape {allowed.shape}")
        shape = allowed.shape
        labels = np.zeros(shape, dtype=int) if groups is None else np.asarray(groups, dtype=int)
        given = np.full(shape, np.nan) if fixed is None else np.asarray(fixed, dtype=float)
        for key, value in (("groups", labels), ("fixed", given)):
            if value.shape != shape:
                raise ValueError(f"{key}: expected shape {shape}, got {value.shape}")
        low, high = (np.broadcast_to(np.asarray(value, dtype=float), shape) for value in (lower, upper))
        base = np.where(np.isnan(given), 0.0, given)
        free = allowed & np.isnan(given)
        members: dict[tuple[int, int, int], list[tuple[int, int]]] = {}
        for i, j in zip(*np.nonzero(free), strict=True):
            key3 = (int(labels[i, j]), 0, 0) if labels[i, j] > 0 else (0, int(i), int(j))
            members.setdefault(key3, []).append((int(i), int(j)))
        basis = np.zeros((len(members), *shape))
        bounds = np.zeros((2, len(members)))
        for k, entries in enumerate(members.values()):
            rows, columns = zip(*entries, strict=True)
            basis[k, rows, columns] = 1.0
            bounds[:, k] = np.max(low[rows, columns]), np.min(high[rows, columns])
        if np.any(bounds[0] > bounds[1]):
            raise ValueError("lower, upper: expected lower <= upper for every gain")
        for array in (base, basis, bounds):
            array.flags.writeable = False
        return cls(base, basis, bounds[0], bounds[1], order)

    @classmethod
    def full(cls, plant: Plant, *, order: int = 0) -> Structure:
        """Every measurement to every command, without bounds.

        Examples
        --------
        >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]])
        >>> Structure.full(plant, order=1).basis.shape
        (4, 2, 2)
        """
        return cls.from_mask(np.ones((len(plant.commands) + order, len(plant.measured) + order)), order=order)

    @classmethod
    def readings(
        cls,
        plant: Plant,
        reads: Mapping[str, tuple[str, ...]],
        *,
        equal: bool = False,
        lower: float = -np.inf,
        upper: float = np.inf,
    ) -> Structure:
        """Static feedback in which each command reads its own measurements only.

        Parameters
        ----------
        reads : measurements that each command may use, by name
        equal : the k-th measurement of every command has the same gain everywhere

        Raises
        ------
        ModelError : a command or a measurement the plant does not have

        Examples
        --------
        >>> plant = Plant.from_matrices(np.eye(2), np.eye(2), np.eye(2), np.eye(2))
        >>> Structure.readings(plant, {"u1": ("x1",), "u2": ("x2",)}, equal=True).gain([-1.0])
        array([[-1., 0.], [ 0., -1.]])
        """
        mask = np.zeros((len(plant.commands), len(plant.measured)), dtype=bool)
        groups = np.zeros(mask.shape, dtype=int)
        for command, measured in reads.items():
            if command not in plant.commands:
                raise ModelError(f"the plant has no command {command!r}; it has {', '.join(plant.commands)}")
            for k, name in enumerate(measured):
                if name not in plant.measured:
                    raise ModelError(
                        f"the law of {command!r} needs the sensor {name!r}, which the plant does not have; it has "
                        f"{', '.join(plant.measured)}"
                    )
                mask[plant.commands.index(command), plant.measured.index(name)] = True
                groups[plant.commands.index(command), plant.measured.index(name)] = k + 1 if equal else 0
        return cls.from_mask(mask, groups=groups, lower=lower, upper=upper)

    def gain(self, theta: ArrayLike) -> FloatArray:
        """K(theta), [[D, C], [B, A]]."""
        return np.asarray(self.base + np.tensordot(np.asarray(theta, dtype=float), self.basis, axes=1))

    def parameters(self, gain: FloatArray) -> FloatArray:
        """Parameters of the admissible law nearest to a matrix: means over equal gains, clipped to the bounds."""
        weight = np.sum(self.basis**2, axis=(1, 2))
        mean = np.tensordot(self.basis, gain - self.base, axes=2) / weight
        return np.asarray(np.clip(mean, self.lower, self.upper))

    def controller(self, gain: FloatArray, plant: Plant) -> Controller:
        """The law of a gain matrix [[D, C], [B, A]], for the plant's measurements and commands."""
        n_u, n_y = len(plant.commands), len(plant.measured)
        return Controller.from_matrices(
            gain[n_u:, n_y:], gain[n_u:, :n_y], gain[:n_u, n_y:], gain[:n_u, :n_y],
            measured=plant.measured, commands=plant.commands, name="structured", dt=plant.dt,
        )  # fmt: skip


def check_fit(structure: Structure, plants: tuple[Plant, ...]) -> None:
    """Raise where the structure and the plants do not belong together.

    Raises
    ------
    ValueError : no plant; sizes, names or sampling periods differ
    """
    if not plants:
        raise ValueError("plants: expected at least one")
    first = plants[0]
    for plant in plants:
        if (plant.measured, plant.commands, plant.dt) != (first.measured, first.commands, first.dt):
            raise ValueError(f"plants: {plant.name} and {first.name} differ in measurements, commands or sampling")
    shape = (len(first.commands) + structure.order, len(first.measured) + structure.order)
    if structure.base.shape != shape:
        raise ValueError(f"structure: expected the size {shape} of this plant's law, got {structure.base.shape}")
