"""H2 synthesis by two Riccati equations: the smallest energy of the response, by state feedback or output feedback.

Doyle, Glover, Khargonekar & Francis, IEEE Trans. Autom. Control 34 (1989) 831; sampled: Chen & Francis, Optimal
Sampled-Data Control Systems (1995), chapter 6. The optimum is attained: infimum and norm are one number for a regular
plant. In continuous time the loop must not pass disturbances straight through; a feedthrough D11 that the law can
cancel, D11 + D12 D_k D21 = 0, is cancelled.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.linalg import LinAlgError

from maglev_ctrl.analysis.hamiltonian import balanced_realisation
from maglev_ctrl.analysis.norms import h2_norm
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import ModelError, Status
from maglev_ctrl.synthesis.h_infinity_claims import proved_law
from maglev_ctrl.synthesis.h_infinity_laws import continuous_plant, measuring_states
from maglev_ctrl.synthesis.regular import defects, enlarged, require_movable
from maglev_ctrl.synthesis.result import Performance, Synthesis, refused
from maglev_ctrl.synthesis.riccati import riccati_continuous
from maglev_ctrl.synthesis.riccati_discrete import riccati_discrete
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant, closed_channel

STATE_LAW = "H2 state feedback"
OUTPUT_LAW = "H2 output feedback"
SHARES = (1e-2, 1e-3, 1e-4)
"""Sizes of what is added to a singular plant; the smallest that is solved makes the law."""
NOTHING = 1e-9
"""A norm below this share of the plant's own is rounding."""


DOUBT = 1e-6
"""Two methods for the norm of the closed loop may differ by this share at most."""


@dataclass(frozen=True, eq=False, slots=True)
class H2Design:
    """A proved law, `optimum` as the Riccati equations give it and `norm` as the closed loop has it.

    For a singular plant the optimum is that of the enlarged plants: `optima` for each of `shares`.
    """

    synthesis: Synthesis
    optimum: float
    norm: float
    shares: tuple[float, ...] = ()
    optima: tuple[float, ...] = ()

    @property
    def controller(self) -> Controller:
        """The law.

        Raises
        ------
        ModelError : there is none, with the reason
        """
        return self.synthesis.require().controller


@dataclass(frozen=True, eq=False, slots=True)
class _Law:
    matrices: tuple[FloatArray, FloatArray, FloatArray, FloatArray]
    optimum: float
    almost: str


def h2_state_feedback(plant: Plant) -> H2Design:
    """Static feedback of all states with the smallest H2 norm from disturbances to performance.

    Parameters
    ----------
    plant : its measurements are not used; D11 must be zero in continuous time

    Examples
    --------
    >>> plant = Plant.from_matrices([[0.0]], [[1.0]], [[1.0]], [[1.0], [0.0]], D12=[[0.0], [1.0]])
    >>> design = h2_state_feedback(plant)  # P = 1, u = -x
    >>> round(design.optimum, 9), round(float(design.controller.D[0, 0]), 9)
    (1.0, -1.0)
    """
    states = measuring_states(plant)
    if plant.dt is None and np.any(plant.D11):
        return _none(STATE_LAW, states, Status.INFEASIBLE, "the feedthrough D11 is not zero: the H2 norm is infinite")
    return _design(STATE_LAW, states, output=False)


def h2_output_feedback(plant: Plant) -> H2Design:
    """Dynamic feedback of the measurements with the smallest H2 norm; as many states as the plant.

    Parameters
    ----------
    plant : any D12, D21, D22; in continuous time D11 zero or cancelled by feedthrough of the law

    Examples
    --------
    >>> plant = Plant.from_matrices([[0.0]], [[1.0, 0.0]], [[1.0]], [[1.0], [0.0]], [[1.0]],
    ...                             D12=[[0.0], [1.0]], D21=[[0.0, 1.0]])
    >>> round(h2_output_feedback(plant).optimum ** 2, 9)  # 1 for control and 1 for estimation
    2.0
    """
    return _design(OUTPUT_LAW, plant, output=True)


def h2_synthesis(plant: Plant) -> Synthesis:
    """State feedback where every state is measured, else output feedback.

    Examples
    --------
    >>> plant = Plant.from_matrices([[0.0]], [[1.0]], [[1.0]], [[1.0], [0.0]], D12=[[0.0], [1.0]])
    >>> h2_synthesis(plant).law
    'H2 state feedback'
    """
    design = h2_state_feedback(plant) if plant.measures_states else h2_output_feedback(plant)
    return design.synthesis


def _design(law: str, plant: Plant, *, output: bool) -> H2Design:
    try:
        require_movable(plant, output=output)
        found = defects(plant if plant.dt is None else continuous_plant(plant), output=output)
        pose = _output_law if output else _state_law
        made: list[tuple[float, _Law]] = []
        if not found.any and (one := pose(plant)) is not None:
            made = [(0.0, one)]
        if not made:
            found = found if found.any else replace(found, unclear=True)
            solved = ((share, pose(enlarged(plant, found, share))) for share in SHARES)
            made = [(share, one) for share, one in solved if one is not None]
    except ModelError as error:
        return _none(law, plant, Status.INFEASIBLE, str(error))
    except LinAlgError as fault:
        told = f"the algebra of the law failed ({fault}): change the plant a little"
        return _none(law, plant, Status.NUMERICAL_ERROR, told)
    if not made:
        return _none(law, plant, Status.NUMERICAL_ERROR, "the Riccati equations were not solved: rescale the plant")
    told = ", ".join(f"{one.optimum:.7g} at {size:g}" for size, one in made)
    first: H2Design | None = None
    for share, best in reversed(made):
        notes = [f"Riccati equation: {best.almost}"] if best.almost else []
        if found.any:
            notes += [
                f"the plant is singular: {'; '.join(found.sentences)}",
                f"small outputs and disturbances are added, {share:g} of the plant's own scale for the law; the "
                f"optimum is at most {told}",
            ]
        design = _checked(law, plant, best, notes, made if found.any else [])
        if design.synthesis.controllers:
            return design
        first = first or design
    return first or _none(law, plant, Status.NUMERICAL_ERROR, "the Riccati equations were not solved")


def _checked(law: str, plant: Plant, best: _Law, notes: list[str], made: list[tuple[float, _Law]]) -> H2Design:
    A, B, C, D = best.matrices
    if A.size:
        A, B, C = balanced_realisation(A, B, C)
    controller = Controller.from_matrices(
        A, B, C, D, measured=plant.measured, commands=plant.commands, name="h2", dt=plant.dt
    )
    again = h2_norm(*closed_channel(plant, controller), dt=plant.dt)
    shares, optima = tuple(share for share, _ in made), tuple(one.optimum for _, one in made)
    # Of a singular plant the law may do better than the enlarged plant it was made for.
    optimum = min([best.optimum, *optima])
    own = float(np.linalg.norm(plant.B1)) * float(np.linalg.norm(plant.C1))
    message = ""
    if not np.isfinite(again.value):
        message = f"the closed loop has no H2 norm: {again.message}"
        if plant.dt is None and np.any(plant.D11):
            message = "D11 is cancelled up to rounding only, and any feedthrough left has no H2 norm: filter z or w"
    elif again.value > NOTHING * own and again.difference > DOUBT:
        message = f"H2 norm of the closed loop: {again.message}"
    if message:
        return H2Design(refused(law, [plant], Status.NOT_VERIFIED, message), optimum, again.value, shares, optima)
    # The enlarged plant's optimum bounds the norm from above; only a regular plant attains it.
    reported = np.nan if made or again.value <= NOTHING * own else best.optimum
    synthesis = proved_law(
        law, plant, controller, norm=max(again.value, NOTHING * own), energy=True, notes=notes,
        performance=[Performance("H2 norm", reported, again.value)],
        status=Status.ALMOST_SOLVED if best.almost else Status.SOLVED,
    )  # fmt: skip
    return H2Design(synthesis, optimum, again.value, shares, optima)


@dataclass(frozen=True, eq=False, slots=True)
class _Half:
    """One equation, of control or (transposed) of estimation: solution, feedback and what rounding did to it."""

    X: FloatArray
    feedback: FloatArray
    almost: str


def _half(A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, dt: float | None) -> _Half | None:
    solve = riccati_continuous if dt is None else riccati_discrete
    solution = solve(A, B, C.T @ C, D.T @ D, C.T @ D)
    if solution.status not in (Status.SOLVED, Status.ALMOST_SOLVED):
        return None
    return _Half(solution.P, -solution.gain, solution.message if solution.status is Status.ALMOST_SOLVED else "")


def _state_law(plant: Plant) -> _Law | None:
    control = _half(plant.A, plant.B2, plant.C1, plant.D12, plant.dt)
    if control is None:
        return None
    energy = float(np.trace(plant.B1.T @ control.X @ plant.B1))
    if plant.dt is not None:
        energy += float(np.linalg.norm(plant.D11)) ** 2
    n, m = len(plant.states), len(plant.commands)
    matrices = (np.zeros((0, 0)), np.zeros((0, n)), np.zeros((m, 0)), control.feedback)
    return _Law(matrices, float(np.sqrt(max(energy, 0.0))), control.almost)


def _output_law(plant: Plant) -> _Law | None:
    """u = F x^ + L0 (y - C2 x^) (L0 in sampled time alone), on top of the feedthrough that cancels D11."""
    direct, plant = _cancelled(plant)
    dt = plant.dt
    control = _half(plant.A, plant.B2, plant.C1, plant.D12, dt)
    estimation = _half(plant.A.T, plant.C2.T, plant.B1.T, plant.D21.T, dt)
    if control is None or estimation is None:
        return None
    X, Y, F, L = control.X, estimation.X, control.feedback, estimation.feedback.T
    price = plant.D12.T @ plant.D12
    if dt is None:
        L0: FloatArray = np.zeros((len(plant.commands), len(plant.measured)))
        energy = float(np.trace(plant.B1.T @ X @ plant.B1)) + float(np.trace(price @ F @ Y @ F.T))
    else:
        price = price + plant.B2.T @ X @ plant.B2
        seen = plant.D21 @ plant.D21.T + plant.C2 @ Y @ plant.C2.T
        F0 = -np.linalg.solve(price, plant.B2.T @ X @ plant.B1 + plant.D12.T @ plant.D11)
        L0 = np.asarray(np.linalg.solve(seen, (F @ Y @ plant.C2.T + F0 @ plant.D21.T).T).T, dtype=np.float64)
        full = np.linalg.norm(plant.D11) ** 2 + np.trace(plant.B1.T @ X @ plant.B1) - np.trace(F0.T @ price @ F0)
        error = F @ Y @ F.T + F0 @ F0.T - L0 @ seen @ L0.T
        energy = float(full + np.trace(price @ error))
    A_k = plant.A + plant.B2 @ F + L @ plant.C2 - plant.B2 @ L0 @ plant.C2
    B_k, C_k = plant.B2 @ L0 - L, F - L0 @ plant.C2
    D_k = L0 + direct
    # D22: the formula is for y - D22 u; the loop around it is closed last.
    loop = np.eye(len(plant.measured)) + plant.D22 @ D_k
    noise, signal = np.linalg.norm(plant.D21, axis=1), np.linalg.norm(plant.C2, axis=1)
    unit = np.maximum(np.where(noise > 0.0, noise, signal), 1e-300)
    if np.linalg.cond(loop * unit / unit[:, None]) > 1e10:
        raise LinAlgError
    back = np.linalg.inv(loop)
    matrices = A_k - B_k @ back @ plant.D22 @ C_k, B_k @ back, C_k - D_k @ back @ plant.D22 @ C_k, D_k @ back
    almost = "; ".join(told for told in (control.almost, estimation.almost) if told)
    return _Law(matrices, float(np.sqrt(max(energy, 0.0))), almost)


def _cancelled(plant: Plant) -> tuple[FloatArray, Plant]:
    """Feedthrough of the law that cancels D11 in continuous time, and the plant with it in place (D22 apart).

    Raises
    ------
    ModelError : no feedthrough cancels D11
    """
    direct: FloatArray = np.zeros((len(plant.commands), len(plant.measured)))
    if plant.dt is not None or not np.any(plant.D11):
        return direct, plant
    direct = -np.linalg.pinv(plant.D12) @ plant.D11 @ np.linalg.pinv(plant.D21)
    left = plant.D11 + plant.D12 @ direct @ plant.D21
    if np.linalg.norm(left) > 1e-12 * np.linalg.norm(plant.D11):
        raise ModelError("no feedthrough of the law cancels D11: the H2 norm is infinite; filter z or w")
    shifted = replace(
        plant, A=plant.A + plant.B2 @ direct @ plant.C2, B1=plant.B1 + plant.B2 @ direct @ plant.D21,
        C1=plant.C1 + plant.D12 @ direct @ plant.C2, D11=np.zeros_like(left),
    )  # fmt: skip
    return direct, shifted


def _none(law: str, plant: Plant, status: Status, message: str) -> H2Design:
    return H2Design(refused(law, [plant], status, message), np.nan, np.nan)
