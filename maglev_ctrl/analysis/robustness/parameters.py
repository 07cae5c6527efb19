"""Physical parameters known only within a spread, and the exact share each has in a linear model.

A relative change d of a parameter changes M, C, K, F, B by d times its share, exactly; a lag or a delay of an actuator
divides the equations of its internal states by 1 + d. `perturbed_system` puts changes in by assembling the model again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.systems import Contribution, SecondOrderSystem
from maglev_ctrl.vehicle.pade import pade_delay

ParameterKind = Literal[
    "magnetic_force", "mass", "inertia", "payload", "stiffness", "damping", "actuator_lag", "actuator_delay"
]
_TURNING = ("roll", "pitch", "yaw")
_DEFAULT_SHARES = {
    "magnetic_force": "magnet", "mass": "body", "inertia": "body", "payload": "body", "stiffness": "spring_damper",
    "damping": "spring_damper",
}  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class UncertainParameter:
    """A physical parameter that may lie anywhere within +- `spread` of its nominal value.

    Parameters
    ----------
    name : what a report calls it
    kind : what it acts on, relative to nominal:
        "magnetic_force" stiffness, damping and force per current of magnets (the circuit and the static load stay);
        "mass", "inertia" the share of bodies in their translations, in their turnings; "payload" both in proportion
        (the trim does not follow);
        "stiffness", "damping" of connections; "actuator_lag" one over the bandwidth; "actuator_delay" the delay
    spread : largest relative change (0.05 is 5 %); s for an actuator delay with `unit` "s"
    members : names of shares (bodies, magnets, connections) or actuators that change together; left out, all there are

    Raises
    ------
    ValueError : an unknown kind or unit, a spread that is not positive

    Examples
    --------
    >>> UncertainParameter("magnets", "magnetic_force", 0.05).members
    ()
    """

    name: str
    kind: ParameterKind
    spread: float
    members: tuple[str, ...] = ()
    unit: Literal["relative", "s"] = "relative"

    def __post_init__(self) -> None:
        if self.kind not in get_args(ParameterKind):
            raise ValueError(f"kind: expected one of {', '.join(get_args(ParameterKind))}, got {self.kind!r}")
        if not (np.isfinite(self.spread) and self.spread > 0.0):
            raise ValueError(f"spread: expected a positive number, got {self.spread!r}")
        if self.unit not in ("relative", "s") or (self.unit == "s" and self.kind != "actuator_delay"):
            raise ValueError(f"unit: expected 'relative', or 's' for an actuator delay, got {self.unit!r}")


@dataclass(frozen=True, eq=False, slots=True)
class ParameterShare:
    """What one parameter changes: M, C, K (n, n), F (n, k), B (n, nu), rows of the outputs, per unit relative change.

    `slow` are internal states whose equation is divided by 1 + change; `spread` is relative.
    """

    M: FloatArray
    C: FloatArray
    K: FloatArray
    F: FloatArray
    B: FloatArray
    H_q: FloatArray
    H_v: FloatArray
    H_internal: FloatArray
    slow: tuple[int, ...]
    spread: float


def parameter_share(plant: SecondOrderSystem, parameter: UncertainParameter) -> ParameterShare:
    """The exact share of a parameter in a linear model.

    Raises
    ------
    ValueError : a member is no share or actuator of the plant, or the parameter changes nothing

    Examples
    --------
    >>> plant = SecondOrderSystem.from_matrices([[2.0]], [[0.1]], [[8.0]])
    >>> parameter_share(plant, UncertainParameter("k", "stiffness", 0.1, ("matrices",))).K
    array([[8.]])
    """
    n, n_xi, n_u, n_y = (len(group) for group in (plant.dofs, plant.internal, plant.inputs, plant.outputs))
    zero = {
        "M": np.zeros((n, n)), "C": np.zeros((n, n)), "K": np.zeros((n, n)), "F": np.zeros((n, n_xi)),
        "B": np.zeros((n, n_u)), "H_q": np.zeros((n_y, n)), "H_v": np.zeros((n_y, n)),
        "H_internal": np.zeros((n_y, n_xi)),
    }  # fmt: skip
    slow: tuple[int, ...] = ()
    spread = parameter.spread
    if parameter.kind in ("actuator_lag", "actuator_delay"):
        slow, nominal = _slow_states(plant, parameter)
        if parameter.unit == "s":
            spread = spread / nominal
    else:
        for share in _members(plant, parameter):
            _add(zero, plant, share, parameter)
    if not slow and not any(np.any(zero[key]) for key in ("M", "C", "K", "F", "B")):
        raise ValueError(f"{parameter.name}: {parameter.kind} of {_named(parameter)} changes nothing in this model")
    arrays = {key: read_only(value, name=key) for key, value in zero.items()}
    return ParameterShare(slow=slow, spread=float(spread), **arrays)


def perturbed_system(
    plant: SecondOrderSystem, parameters: Sequence[UncertainParameter], changes: ArrayLike
) -> SecondOrderSystem:
    """The plant assembled again with every parameter changed by its relative change (0.05: 5 % more).

    Raises
    ------
    ValueError : one change for each parameter is expected; a lag or delay cannot fall to zero

    Examples
    --------
    >>> plant = SecondOrderSystem.from_matrices([[2.0]], [[0.1]], [[8.0]])
    >>> softer = perturbed_system(plant, [UncertainParameter("k", "stiffness", 0.1, ("matrices",))], [-0.5])
    >>> softer.K
    array([[4.]])
    """
    given = read_only(changes, name="changes", shape=(len(parameters),))
    matrices = {key: getattr(plant, key).copy() for key in ("M", "C", "K", "F", "B", "H_q", "H_v", "H_internal")}
    inner = {
        key: getattr(plant, key).copy() for key in ("A_internal", "G_q", "G_v", "G_a", "B_internal", "G_w", "G_wv")
    }
    for parameter, change in zip(parameters, given, strict=True):
        share = parameter_share(plant, parameter)
        for key, value in matrices.items():
            value += change * getattr(share, key)
        if share.slow and change <= -1.0:
            raise ValueError(f"{parameter.name}: a lag or delay cannot fall to zero (relative change {change:g})")
        for value in inner.values():
            value[list(share.slow)] /= 1.0 + change
    all_of = {key: read_only(value, name=key) for key, value in (matrices | inner).items()}
    whole = Contribution("matrices", "other", *(all_of[key] for key in ("M", "C", "K", "F")))
    changed: dict[str, Any] = {"contributions": (whole,), **all_of}
    return replace(plant, **changed)


def _named(parameter: UncertainParameter) -> str:
    return ", ".join(parameter.members) or "all there are"


def _members(plant: SecondOrderSystem, parameter: UncertainParameter) -> list[Contribution]:
    kind = _DEFAULT_SHARES[parameter.kind]
    if not parameter.members:
        return [share for share in plant.contributions if share.kind == kind]
    known = {share.name: share for share in plant.contributions}
    missing = [name for name in parameter.members if name not in known]
    if missing:
        raise ValueError(f"{parameter.name}: {missing[0]!r} is no share of the model; there are {', '.join(known)}")
    return [known[name] for name in parameter.members]


def _add(
    total: dict[str, FloatArray], plant: SecondOrderSystem, share: Contribution, parameter: UncertainParameter
) -> None:
    turning = np.array([name.rpartition(".")[2] in _TURNING for name in plant.dofs])
    both_turn, both_move = np.outer(turning, turning), np.outer(~turning, ~turning)
    force = [i for i, name in enumerate(plant.outputs) if name == f"{share.name}.force"]
    match parameter.kind:
        case "magnetic_force":
            total["K"] += share.K
            total["C"] += share.C
            total["F"] += share.F
            for i in (i for i, name in enumerate(plant.inputs) if name == f"{share.name}.current"):
                total["B"][:, i] += plant.B[:, i]
        case "mass":
            total["M"] += share.M * both_move
        case "inertia":
            total["M"] += share.M * both_turn
        case "payload":
            total["M"] += share.M
        case "stiffness":
            total["K"] += share.K
            total["H_q"][force] += plant.H_q[force]
        case _:
            total["C"] += share.C
            total["F"] += share.F
            total["H_v"][force] += plant.H_v[force]
            total["H_internal"][force] += plant.H_internal[force]


def _slow_states(plant: SecondOrderSystem, parameter: UncertainParameter) -> tuple[tuple[int, ...], float]:
    """Internal states of the actuators' lags or delays, and the nominal delay in s (the longest)."""
    lag = parameter.kind == "actuator_lag"
    names = parameter.members or tuple(dict.fromkeys(_actuator_of(name, lag=lag) for name in plant.internal)) or ("",)
    chosen: list[int] = []
    nominal = []
    for actuator in (name for name in names if name or parameter.members):
        states = [i for i, name in enumerate(plant.internal) if _actuator_of(name, lag=lag) == actuator]
        if not states:
            what = "bandwidth" if lag else "delay (in its Pade form)"
            raise ValueError(f"{parameter.name}: {actuator!r} is no actuator with a {what} in this model")
        chosen += states
        if not lag:
            unit = pade_delay(1.0, len(states))[0]
            nominal.append(float(np.trace(unit) / np.trace(plant.A_internal[np.ix_(states, states)])))
    if parameter.unit == "s" and nominal and np.ptp(nominal) > 1e-9 * max(nominal):
        raise ValueError(f"{parameter.name}: a spread in s needs actuators of one delay, got {sorted(set(nominal))} s")
    return tuple(chosen), max(nominal, default=np.nan)


def _actuator_of(state: str, *, lag: bool) -> str:
    """The actuator an internal state belongs to, or an empty text."""
    actuator, _, what = state.rpartition(".")
    fits = what == "force" if lag else what.startswith("delay") and what[5:].isdigit()
    return actuator if fits else ""
