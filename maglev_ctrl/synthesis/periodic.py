"""Linear-quadratic feedback of a periodic system, u = -K(t) x, with a certificate that does not trust the solver.

-P' = A'P + P A + Q - P B R^-1 B'P,   K(t) = R^-1 B'P(t),   A, B, P, K of period T; x0' P(0) x0 is the cost.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.errors import ModelError, Status
from maglev_ctrl.kernels.fourier_matrix import FourierMatrix
from maglev_ctrl.kernels.periodic_riccati import PeriodicRiccati, hidden_multipliers, periodic_riccati
from maglev_ctrl.synthesis.periodic_certificate import PeriodicCertificate, verify_periodic
from maglev_ctrl.synthesis.periodic_problem import PeriodicProblem, cost_scale, gain_of, multiplier_text

__all__ = ["PeriodicCertificate", "PeriodicProblem", "PeriodicRegulator", "periodic_lqr", "verify_periodic"]


@dataclass(frozen=True, eq=False, slots=True)
class PeriodicRegulator:
    """The law u = -gain(t) x of least cost, and how sure it is.

    `P`, `gain` Fourier series, cost from x0 at time t: x0' P(t) x0; `times` (S,) s and `P_samples` (S, n, n) as
    solved, before the series; `series_error` relative error of the series by the harmonics left out;
    `refinement_change` relative change of P(0) when the number of segments is doubled; `closure` relative mismatch of
    P after one more period; `problem` what was solved.
    """

    problem: PeriodicProblem
    P: FourierMatrix
    gain: FourierMatrix
    times: FloatArray
    P_samples: FloatArray
    series_error: float
    refinement_change: float
    closure: float
    certificate: PeriodicCertificate
    status: Status
    notes: tuple[str, ...] = ()

    def require(self) -> PeriodicRegulator:
        """This regulator where the certificate bears it out.

        Raises
        ------
        ModelError : an independent check disagrees
        """
        if self.status is not Status.SOLVED:
            raise ModelError(f"periodic regulator: {self.status.value}; {'; '.join(self.certificate.disagreements)}")
        return self


def periodic_lqr(
    problem: PeriodicProblem, *, segments: int = 64, tolerance: float = 1e-10, simulate: bool = True
) -> PeriodicRegulator:
    """The stabilising periodic state feedback of least cost.

    Segments are doubled until the harmonics of P left out and the change of P(0) are both below `tolerance`, at most
    five times; the certificate judges what comes out.

    Parameters
    ----------
    problem : system and weights
    segments : least number per period to begin with
    tolerance : relative
    simulate : whether the certificate simulates the cost, its slowest part

    Raises
    ------
    ModelError : no stabilising law exists; the multiplier that stands in the way is named
    ValueError : the system is too fast for its period

    Examples
    --------
    >>> from maglev_ctrl.systems import PeriodicSystem
    >>> mathieu = PeriodicSystem.from_matrices([[0, 1], [-1, 0]], [[[0, 0], [-0.4, 0]]], frequency=2.0)
    >>> law = periodic_lqr(PeriodicProblem.of(mathieu, [[0.0], [1.0]], np.eye(2), [[1.0]]))
    >>> law.status.name, round(law.certificate.spectral_radius, 6), law.gain(0.0).round(4)
    ('SOLVED', 0.126501, array([[0.1685, 1.2706]]))
    """
    G, Q = problem.input_weight(), FourierMatrix.of(problem.Q, frequency=problem.A.frequency)
    unmoved, unseen = hidden_multipliers(problem.A, problem.B, Q)
    if len(unmoved):
        raise ModelError(f"the inputs cannot move the motion with {multiplier_text(unmoved[0])}")
    if len(unseen):
        raise ModelError(
            f"the weights do not see the motion with {multiplier_text(unseen[0])}, which neither grows nor decays"
        )
    found, change = _converged(problem, G, Q, segments, tolerance)
    gain = gain_of(problem, found.series)
    certificate = verify_periodic(problem, found.series, gain, solver=np.exp(found.logs), simulate=simulate)
    notes: list[str] = []
    if found.final_weight:
        notes.append("a growing motion is not seen by the weights; the law only stabilises it")
    if max(found.series_error, change) > tolerance:
        notes.append(f"harmonics left out {found.series_error:.1e}, change with twice the segments {change:.1e}")
    count = len(found.P)
    return PeriodicRegulator(
        problem=problem, P=found.series, gain=gain,
        times=read_only(problem.A.period * np.arange(count) / count, name="times"),
        P_samples=read_only(found.P, name="P_samples"),
        series_error=found.series_error, refinement_change=change, closure=found.closure,
        certificate=certificate, notes=tuple(notes),
        status=Status.SOLVED if certificate.stable else Status.NOT_VERIFIED,
    )  # fmt: skip


def _converged(
    problem: PeriodicProblem, G: FourierMatrix, Q: FourierMatrix, segments: int, tolerance: float
) -> tuple[PeriodicRiccati, float]:
    """Solutions on more and more segments until two agree and the series is resolved; the last, and the change."""
    found = _solved(problem, G, Q, segments)
    change = np.inf
    for _ in range(5):
        finer = _solved(problem, G, Q, 2 * len(found.P))
        scale = cost_scale(finer.series)
        weight = np.outer(scale, scale)
        size = float(np.linalg.norm(finer.P[0] / weight))
        change = float(np.linalg.norm((finer.P[0] - found.P[0]) / weight)) / max(size, 1e-300)
        found = finer
        if max(change, found.series_error) <= tolerance:
            break
    return found, change


def _solved(problem: PeriodicProblem, G: FourierMatrix, Q: FourierMatrix, segments: int) -> PeriodicRiccati:
    found = periodic_riccati(problem.A, G, Q, segments=segments)
    return _refuse(problem, Q) if found is None else found


def _refuse(problem: PeriodicProblem, Q: FourierMatrix) -> NoReturn:
    """Say why doubling found nothing: a motion all but unmoved, or all but unseen, else the map itself."""
    unmoved, unseen = hidden_multipliers(problem.A, problem.B, Q, tolerance=1e-6)
    if len(unmoved):
        raise ModelError(f"the inputs can hardly move the motion with {multiplier_text(unmoved[0])}: no law was found")
    if len(unseen):
        raise ModelError(f"the weights hardly see the motion with {multiplier_text(unseen[0])}: no law was found")
    raise ModelError("the Hamiltonian's map over a period has multipliers on the unit circle: no stabilising law")
