"""Weights in engineering terms: what may an output reach, what may an actuator give (Bryson's rule)."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.systems import SecondOrderSystem


@dataclass(frozen=True, eq=False, slots=True)
class OutputWeight:
    """Largest acceptable value of an output or state, in its own SI unit; its weight is 1 / allowed^2.

    Examples
    --------
    >>> OutputWeight("car.heave.acceleration", 0.3).allowed
    0.3
    """

    output: str
    allowed: float

    def __post_init__(self) -> None:
        _require_positive(self.output, self.allowed)


@dataclass(frozen=True, eq=False, slots=True)
class InputWeight:
    """Largest acceptable command of an actuator, N; its weight is 1 / allowed^2.

    Examples
    --------
    >>> InputWeight("secondary", 2000.0).actuator
    'secondary'
    """

    actuator: str
    allowed: float

    def __post_init__(self) -> None:
        _require_positive(self.actuator, self.allowed)


@dataclass(frozen=True, eq=False, slots=True)
class QuadraticWeights:
    """Cost x'Qx + u'Ru + 2 x'Nu behind a set of weights.

    `rows` (nz, nx) and `through` (nz, nu): scaled outputs z / allowed = rows x + through u; `Q`, `R`, `N` follow.
    """

    outputs: tuple[OutputWeight, ...]
    inputs: tuple[InputWeight, ...]
    rows: FloatArray
    through: FloatArray
    Q: FloatArray
    R: FloatArray
    N: FloatArray

    @property
    def commands(self) -> tuple[str, ...]:
        """Actuators that the design uses, in order."""
        return tuple(weight.actuator for weight in self.inputs)


def quadratic_weights(
    system: SecondOrderSystem, output_weights: Sequence[OutputWeight], input_weights: Sequence[InputWeight]
) -> QuadraticWeights:
    """Q, R, N of the sum of (z_i / allowed_i)^2 and (u_j / allowed_j)^2, with z = C x + D u.

    Accelerations depend on the actuator force at the same instant: D gives the cross weight N and adds to R.

    Raises
    ------
    ValueError : an unknown or doubled name (a near match is named), an empty list, or a system with batch axes

    Examples
    --------
    >>> plant = SecondOrderSystem.from_matrices([[2.0]], [[0.0]], [[8.0]], inputs=("force",), B=[[1.0]],
    ...                                         outputs=("acceleration",), H_a=[[1.0]])
    >>> cost = quadratic_weights(plant, [OutputWeight("acceleration", 0.5)], [InputWeight("force", 10.0)])
    >>> cost.N
    array([[-8.], [ 0.]])
    """
    require_single(system)
    if not output_weights or not input_weights:
        raise ValueError("weights: expected at least one output weight and one input weight")
    for weight in output_weights:
        require_known(weight.output, (*system.outputs, *system.states), what="output")
    for given in input_weights:
        require_known(given.actuator, system.inputs, what="actuator")
    require_distinct((weight.output for weight in output_weights), what="output")
    require_distinct((given.actuator for given in input_weights), what="actuator")
    columns = [system.inputs.index(given.actuator) for given in input_weights]
    C, D, _ = system.output_rows(tuple(weight.output for weight in output_weights))
    allowed = np.array([[weight.allowed] for weight in output_weights])
    rows, through = C / allowed, D[:, columns] / allowed
    effort = np.diag([1.0 / given.allowed**2 for given in input_weights])
    return QuadraticWeights(
        outputs=tuple(output_weights),
        inputs=tuple(input_weights),
        rows=read_only(rows, name="rows"),
        through=read_only(through, name="through"),
        Q=read_only(rows.T @ rows, name="Q"),
        R=read_only(effort + through.T @ through, name="R"),
        N=read_only(rows.T @ through, name="N"),
    )


def require_known(name: str, known: Sequence[str], *, what: str) -> None:
    """Refuse an unknown name and offer the nearest known one.

    Raises
    ------
    ValueError : `name` is not in `known`

    Examples
    --------
    >>> require_known("car.heav", ["car.heave", "car.pitch"], what="output")
    Traceback (most recent call last):
        ...
    ValueError: output: 'car.heav' is unknown; did you mean 'car.heave'?
    """
    if name in known:
        return
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    listed = ", ".join(known) if known else "none"
    raise ValueError(
        f"{what}: {name!r} is unknown; " + (f"did you mean {near[0]!r}?" if near else f"the names are {listed}")
    )


def require_distinct(names: Iterable[str], *, what: str) -> None:
    """Refuse a name given twice.

    Raises
    ------
    ValueError : a name occurs twice
    """
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise ValueError(f"{what}: {name!r} is given twice")
        seen.add(name)


def require_single(system: SecondOrderSystem) -> None:
    """Refuse systems with batch axes: a law is designed at one operating point.

    Raises
    ------
    ValueError : a matrix of the system has batch axes
    """
    if system.state_matrix().ndim != 2:
        raise ValueError("system: expected one operating point, got batch axes; design at one point at a time")


def _require_positive(name: str, allowed: float) -> None:
    if not (np.isfinite(allowed) and allowed > 0.0):
        raise ValueError(f"allowed: expected a positive finite value for {name!r}, got {allowed!r}")
