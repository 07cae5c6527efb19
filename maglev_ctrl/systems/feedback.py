"""Controllers, closed loops and return ratios of second-order systems."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray, join_columns, join_rows, read_only
from maglev_ctrl.display import Shown
from maglev_ctrl.systems.second_order import Contribution, SecondOrderSystem


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Controller(Shown):
    """Linear controller from measured outputs y to actuator commands u: x' = A x + B y, u = C x + D y.

    The sign of the feedback is inside the matrices (a stabilising state feedback has D = -K). `measured` are names of
    outputs or states of the system, `commands` names of its inputs. `dt` is the sampling period in s of a sampled law
    (x+ = A x + B y); None in continuous time.
    """

    _told: ClassVar = ("name", "measured", "commands", "A", "dt")

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    measured: tuple[str, ...]
    commands: tuple[str, ...]
    name: str = "controller"
    dt: float | None = None

    @classmethod
    def from_matrices(
        cls,
        A: ArrayLike,
        B: ArrayLike,
        C: ArrayLike,
        D: ArrayLike,
        *,
        measured: tuple[str, ...],
        commands: tuple[str, ...],
        name: str = "controller",
        dt: float | None = None,
    ) -> Controller:
        """A controller from its matrices, shapes checked.

        Raises
        ------
        ValueError : a shape does not fit
        """
        n_x = np.atleast_2d(np.asarray(A, dtype=float)).shape[-1] if np.size(A) else 0
        shaped = {
            "A": (A, n_x, n_x), "B": (B, n_x, len(measured)),
            "C": (C, len(commands), n_x), "D": (D, len(commands), len(measured)),
        }  # fmt: skip
        arrays = {
            key: read_only(np.reshape(np.asarray(value, dtype=float), (rows, columns)) if not np.size(value) else value,
                           name=key, shape=(rows, columns))
            for key, (value, rows, columns) in shaped.items()
        }  # fmt: skip
        return cls(measured=measured, commands=commands, name=name, dt=dt, **arrays)

    @classmethod
    def static(
        cls,
        gain: ArrayLike,
        *,
        measured: tuple[str, ...],
        commands: tuple[str, ...],
        name: str = "controller",
        dt: float | None = None,
    ) -> Controller:
        """Static feedback u = gain y.

        Examples
        --------
        >>> Controller.static([[-3.0]], measured=("q1",), commands=("force",)).D
        array([[-3.]])
        """
        return cls.from_matrices(
            np.zeros((0, 0)), np.zeros((0, len(measured))), np.zeros((len(commands), 0)), gain,
            measured=measured, commands=commands, name=name, dt=dt,
        )  # fmt: skip

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the controller's states once the loop is closed."""
        return tuple(f"{self.name}.x{i + 1}" for i in range(self.A.shape[-1]))


def close_loop(system: SecondOrderSystem, controller: Controller) -> SecondOrderSystem:
    """The closed loop as a second-order system whose internal states include the controller's.

    Feedback that reaches forces without an internal state between (no actuator lag) joins M, C, K as a share
    named after the controller; feedback into actuator states joins their equations. Commands stay as inputs
    (the loop's own command plus an added one), so loops can be broken again.

    Acceleration fed back to a force without lag acts as virtual mass and joins M; this is exact.

    Raises
    ------
    ValueError : a measured name or a command is unknown to the system, or the controller is sampled

    Examples
    --------
    >>> plant = SecondOrderSystem.from_matrices([[1.0]], [[0.0]], [[4.0]], inputs=("force",), B=[[1.0]])
    >>> damper = Controller.static([[-0.5]], measured=("q1.velocity",), commands=("force",))
    >>> close_loop(plant, damper).C
    array([[0.5]])
    """
    if controller.dt is not None:
        raise ValueError(f"controller: {controller.name!r} is sampled; a vehicle's loop is closed in continuous time")
    n, n_c = len(system.dofs), len(controller.states)
    unknown = [name for name in controller.commands if name not in system.inputs]
    if unknown:
        raise ValueError(f"command: {unknown[0]!r} is not an input; the inputs are {', '.join(system.inputs)}")
    columns = [system.inputs.index(name) for name in controller.commands]
    B, B_internal = system.B[..., columns], system.B_internal[..., columns]
    H_q, H_v, H_a, H_xi, H_w, H_wv = (
        _measured_rows(system, controller.measured, key) for key in ("H_q", "H_v", "H_a", "H_internal", "H_w", "H_wv")
    )
    C_k, D_k = controller.C, controller.D
    share = Contribution(
        controller.name,
        "controller",
        M=read_only(-B @ D_k @ H_a, name="M"),
        C=read_only(-B @ D_k @ H_v, name="C"),
        K=read_only(-B @ D_k @ H_q, name="K"),
        F=read_only(join_columns([B @ D_k @ H_xi, B @ C_k]), name="F"),
    )
    grown = tuple(
        replace(c, F=read_only(join_columns([c.F, np.zeros((n, n_c))]), name="F")) for c in system.contributions
    )
    zeros_y = np.zeros((len(system.outputs), n_c))
    return SecondOrderSystem.from_matrices(
        M=system.M + share.M,
        C=system.C + share.C,
        K=system.K + share.K,
        dofs=system.dofs,
        internal=system.internal + controller.states,
        A_internal=join_rows([
            join_columns([system.A_internal + B_internal @ D_k @ H_xi, B_internal @ C_k]),
            join_columns([controller.B @ H_xi, controller.A]),
        ]),
        G_q=join_rows([system.G_q + B_internal @ D_k @ H_q, controller.B @ H_q]),
        G_v=join_rows([system.G_v + B_internal @ D_k @ H_v, controller.B @ H_v]),
        G_a=join_rows([system.G_a + B_internal @ D_k @ H_a, controller.B @ H_a]),
        F=join_columns([system.F, np.zeros((n, n_c))]) + share.F,
        inputs=system.inputs,
        B=system.B,
        B_internal=join_rows([system.B_internal, np.zeros((n_c, len(system.inputs)))]),
        guideway=system.guideway,
        K_w=system.K_w + B @ D_k @ H_w,
        C_w=system.C_w + B @ D_k @ H_wv,
        G_w=join_rows([system.G_w + B_internal @ D_k @ H_w, controller.B @ H_w]),
        G_wv=join_rows([system.G_wv + B_internal @ D_k @ H_wv, controller.B @ H_wv]),
        outputs=system.outputs,
        H_q=system.H_q,
        H_v=system.H_v,
        H_a=system.H_a,
        H_internal=join_columns([system.H_internal, zeros_y]),
        H_w=system.H_w,
        H_wv=system.H_wv,
        contributions=(*grown, share),
        ignorable=system.ignorable,
    )  # fmt: skip


def _measured_rows(system: SecondOrderSystem, names: tuple[str, ...], key: str) -> FloatArray:
    """Rows of one H matrix for named outputs or states; (..., ny, *)."""
    n, n_xi, n_w = len(system.dofs), len(system.internal), len(system.guideway)
    width = {"H_q": n, "H_v": n, "H_a": n, "H_internal": n_xi, "H_w": n_w, "H_wv": n_w}[key]
    state_groups = {
        "H_q": system.dofs,
        "H_v": tuple(f"{name}.velocity" for name in system.dofs),
        "H_internal": system.internal,
    }
    rows: list[FloatArray] = []
    for name in names:
        if name in system.outputs:
            i = system.outputs.index(name)
            rows.append(getattr(system, key)[..., i : i + 1, :])
        elif name in system.states:
            row = np.zeros((1, width))
            group = state_groups.get(key, ())
            if name in group:
                row[0, group.index(name)] = 1.0
            rows.append(row)
        else:
            raise ValueError(f"measured: {name!r} is neither an output nor a state of the system")
    return join_rows(rows) if rows else np.zeros((0, width))


def loop_matrices(
    system: SecondOrderSystem, controller: Controller
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return ratio L broken at the actuator commands, negative feedback: u = -L u; state space (A, B, C, D) of L.

    The states are those of `system`, then the controller's. 1 + L (I + L) has the closed-loop poles as zeros.
    An actuator delay inside `system` is its Pade form; exact delays are the business of `analysis.margins`.

    Raises
    ------
    ValueError : a measured name or a command is unknown to the system

    Examples
    --------
    >>> plant = SecondOrderSystem.from_matrices([[1.0]], [[0.0]], [[4.0]], inputs=("force",), B=[[1.0]])
    >>> law = Controller.static([[-0.5]], measured=("q1.velocity",), commands=("force",))
    >>> loop_matrices(plant, law)[2]
    array([[-0. ,  0.5]])
    """
    columns = [system.inputs.index(name) for name in controller.commands]
    A, B = system.state_matrix(), system.input_matrix()[..., columns]
    C, D, _ = system.output_rows(controller.measured)
    D = D[..., columns]
    n_c = len(controller.states)
    A_loop = join_rows(
        [
            join_columns([A, np.zeros((A.shape[-1], n_c))]),
            join_columns([controller.B @ C, controller.A]),
        ]
    )
    B_loop = join_rows([B, controller.B @ D])
    C_loop = -join_columns([controller.D @ C, controller.C])
    return A_loop, B_loop, C_loop, -controller.D @ D
