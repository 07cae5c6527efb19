"""The generalised plant of control synthesis: disturbances and commands in, performance and measurements out."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.systems.feedback import Controller


@dataclass(frozen=True, eq=False, slots=True)
class Plant:
    """One linear plant, continuous (`dt` None) or sampled every `dt` seconds.

        x' = A x + B1 w + B2 u      (x+ where sampled)
        z  = C1 x + D11 w + D12 u
        y  = C2 x + D21 w + D22 u

    `states`, `disturbances` (w), `commands` (u), `performance` (z) and `measured` (y) are names.
    """

    A: FloatArray
    B1: FloatArray
    B2: FloatArray
    C1: FloatArray
    D11: FloatArray
    D12: FloatArray
    C2: FloatArray
    D21: FloatArray
    D22: FloatArray
    states: tuple[str, ...]
    disturbances: tuple[str, ...]
    commands: tuple[str, ...]
    performance: tuple[str, ...]
    measured: tuple[str, ...]
    dt: float | None = None
    name: str = "plant"

    @classmethod
    def from_matrices(
        cls,
        A: ArrayLike,
        B1: ArrayLike,
        B2: ArrayLike,
        C1: ArrayLike,
        C2: ArrayLike | None = None,
        *,
        D11: ArrayLike | None = None,
        D12: ArrayLike | None = None,
        D21: ArrayLike | None = None,
        D22: ArrayLike | None = None,
        states: tuple[str, ...] | None = None,
        disturbances: tuple[str, ...] | None = None,
        commands: tuple[str, ...] | None = None,
        performance: tuple[str, ...] | None = None,
        measured: tuple[str, ...] | None = None,
        dt: float | None = None,
        name: str = "plant",
    ) -> Plant:
        """A plant from its matrices; without `C2` every state is measured, whatever else is left out is zero.

        Parameters
        ----------
        A, B1, B2, C1, C2 : (n, n), (n, nw), (n, nu), (nz, n), (ny, n)
        states, disturbances, commands, performance, measured : names; x1.., w1.., u1.., z1.., y1.. when left out

        Raises
        ------
        ValueError : a shape does not fit, a name is doubled, or `dt` is not positive

        Examples
        --------
        >>> plant = Plant.from_matrices([[-1.0]], [[1.0]], [[1.0]], [[1.0]])
        >>> plant.measured
        ('x1',)
        """
        a = read_only(A, name="A", shape=(None, None))
        n = a.shape[-1]
        if a.ndim != 2 or a.shape[0] != n:
            raise ValueError(f"A: expected one square matrix, got shape {a.shape}")
        b1, b2 = (read_only(x, name=k, shape=(n, None)) for k, x in (("B1", B1), ("B2", B2)))
        c1 = read_only(C1, name="C1", shape=(None, n))
        named = states if states is not None else tuple(f"x{i + 1}" for i in range(n))
        c2 = read_only(np.eye(n) if C2 is None else C2, name="C2", shape=(None, n))
        n_w, n_u, n_z, n_y = b1.shape[-1], b2.shape[-1], c1.shape[-2], c2.shape[-2]

        def through(value: ArrayLike | None, key: str, rows: int, columns: int) -> FloatArray:
            return read_only(np.zeros((rows, columns)) if value is None else value, name=key, shape=(rows, columns))

        def names(given: tuple[str, ...] | None, letter: str, count: int, key: str) -> tuple[str, ...]:
            found = given if given is not None else tuple(f"{letter}{i + 1}" for i in range(count))
            if len(found) != count or len(set(found)) != count:
                raise ValueError(f"{key}: expected {count} different names, got {found}")
            return found

        if dt is not None and not (np.isfinite(dt) and dt > 0.0):
            raise ValueError(f"dt: expected a positive sampling period in s, got {dt!r}")
        default_measured = named if C2 is None else None
        return cls(
            A=a, B1=b1, B2=b2, C1=c1, D11=through(D11, "D11", n_z, n_w), D12=through(D12, "D12", n_z, n_u),
            C2=c2, D21=through(D21, "D21", n_y, n_w), D22=through(D22, "D22", n_y, n_u),
            states=names(named, "x", n, "states"),
            disturbances=names(disturbances, "w", n_w, "disturbances"),
            commands=names(commands, "u", n_u, "commands"),
            performance=names(performance, "z", n_z, "performance"),
            measured=names(measured if measured is not None else default_measured, "y", n_y, "measured"),
            dt=dt, name=name,
        )  # fmt: skip

    @property
    def measures_states(self) -> bool:
        """Every state is measured, exactly and alone: C2 = I, D21 = 0, D22 = 0."""
        same = self.C2.shape == self.A.shape and bool(np.array_equal(self.C2, np.eye(len(self.states))))
        return same and not (np.any(self.D21) or np.any(self.D22))


def plant_fields() -> tuple[str, ...]:
    """Names of the plant's nine matrices, in order.

    Examples
    --------
    >>> plant_fields()[:3]
    ('A', 'B1', 'B2')
    """
    return tuple(field.name for field in fields(Plant))[:9]


def require_fit(plant: Plant, controller: Controller) -> None:
    """A controller takes a plant's measurements, in their order, and drives its commands at its sampling period.

    Raises
    ------
    ValueError : names or sampling periods differ
    """
    if controller.measured != plant.measured or controller.commands != plant.commands:
        raise ValueError(
            f"controller: expected {plant.measured} -> {plant.commands}, got {controller.measured} -> "
            f"{controller.commands}"
        )
    if controller.dt != plant.dt:
        raise ValueError(f"controller: expected the sampling period {plant.dt}, got {controller.dt}")


def closed_channel(plant: Plant, controller: Controller) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Closed loop from w to z of u = K y; states are the plant's, then the controller's. Returns (A, B, C, D).

    Raises
    ------
    ValueError : names or sampling periods of plant and controller do not fit
    numpy.linalg.LinAlgError : the algebraic loop I - D22 D_k is singular

    Examples
    --------
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]])
    >>> closed_channel(plant, Controller.static([[-3.0]], measured=("x1",), commands=("u1",)))[0]
    array([[-2.]])
    """
    require_fit(plant, controller)
    A_k, B_k, C_k, D_k = controller.A, controller.B, controller.C, controller.D
    loop = np.linalg.inv(np.eye(len(plant.measured)) - plant.D22 @ D_k)
    # y = loop (C2 x + D21 w + D22 C_k x_k),  u = C_k x_k + D_k y
    y_x, y_k, y_w = loop @ plant.C2, loop @ plant.D22 @ C_k, loop @ plant.D21
    u_x, u_k, u_w = D_k @ y_x, C_k + D_k @ y_k, D_k @ y_w
    A = np.block([[plant.A + plant.B2 @ u_x, plant.B2 @ u_k], [B_k @ y_x, A_k + B_k @ y_k]])
    B = np.vstack([plant.B1 + plant.B2 @ u_w, B_k @ y_w])
    C = np.hstack([plant.C1 + plant.D12 @ u_x, plant.D12 @ u_k])
    return A, B, C, plant.D11 + plant.D12 @ u_w
