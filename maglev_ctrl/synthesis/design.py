"""What a synthesis hands back: the controller, how it was found, and a certificate that does not trust the solver."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.linalg import solve_continuous_lyapunov
from scipy.optimize import linear_sum_assignment

from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only_any
from maglev_ctrl.display import Shown
from maglev_ctrl.errors import Agreement, ModelError, NotStable, Status
from maglev_ctrl.kernels import scaling
from maglev_ctrl.synthesis.extended import Extended
from maglev_ctrl.synthesis.result import Synthesis
from maglev_ctrl.synthesis.riccati import RiccatiSolution
from maglev_ctrl.synthesis.weights import QuadraticWeights, require_single
from maglev_ctrl.systems import Controller, SecondOrderSystem, close_loop, loop_matrices
from maglev_ctrl.systems.scheduled import ScheduledController

METHODS = (
    "eigenvalues of the closed second-order system",
    "eigenvalues of A - B (I + D)^-1 C of the return ratio",
    "Lyapunov equation with residual in extended precision",
)


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Certificate(Shown):
    """Independent evidence about a closed loop.

    `closed_loop_eigenvalues` 1/s; `matrix_difference` and `eigenvalue_difference` relative differences of the two
    closings; `lyapunov_positive` the solution Y of A'Y + Y A = -I is positive definite; `lyapunov_residual` spectral
    bound of its residual, a proof of stability where below 1; `smallest_return_difference` least singular value of
    I + D of the algebraic loop; `refined_abscissa` of a second plant (higher Pade order), None without one; `agreed`
    whether all methods tell the same story.
    """

    _told: ClassVar = ("stable", "spectral_abscissa", "agreed", "lyapunov_residual")

    closed_loop_eigenvalues: ComplexArray
    spectral_abscissa: float
    matrix_difference: float
    eigenvalue_difference: float
    lyapunov_positive: bool
    lyapunov_residual: float
    smallest_return_difference: float
    refined_abscissa: float | None
    methods: tuple[str, ...]
    agreed: Agreement
    disagreements: tuple[str, ...]

    @property
    def stable(self) -> bool:
        """Stable by eigenvalues and by the Lyapunov proof, and all methods agree."""
        proven = self.lyapunov_positive and self.lyapunov_residual < 1.0
        return self.agreed is Agreement.AGREED and self.spectral_abscissa < 0.0 and proven


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Design(Shown):
    """A control law with its origin: `riccati` and `weights` are empty where the law has none, `notes` tell choices.

    `synthesis` holds the claims about the loop and their proofs; `schedule` the law over an operating parameter, of
    which `controller` is the one at the design point.
    """

    _told: ClassVar = ("name", "law", "status", "controller", "certificate")

    name: str
    law: str
    controller: Controller
    status: Status
    riccati: tuple[RiccatiSolution, ...]
    weights: QuadraticWeights | None
    certificate: Certificate
    notes: tuple[str, ...] = ()
    synthesis: Synthesis | None = None
    schedule: ScheduledController | None = None

    def require(self) -> Design:
        """This design where it is solved and its closed loop is proven stable.

        Raises
        ------
        ModelError : the solver failed or an independent check disagrees
        NotStable : the closed loop is not stable
        """
        if self.status not in (Status.SOLVED, Status.ALMOST_SOLVED):
            raise ModelError(f"design {self.name!r}: {self.status.value}")
        if self.certificate.agreed is not Agreement.AGREED:
            raise ModelError(f"design {self.name!r}: unresolved; {'; '.join(self.certificate.disagreements)}")
        if not self.certificate.stable:
            abscissa = self.certificate.spectral_abscissa
            raise NotStable(f"design {self.name!r}: the closed loop has a pole with real part {abscissa:.3g}")
        return self


def verify(
    system: SecondOrderSystem,
    controller: Controller,
    *,
    refined: SecondOrderSystem | None = None,
    tolerance: float = 1e-7,
) -> Certificate:
    """Judge a closed loop by three methods that share nothing but the plant.

    Parameters
    ----------
    system : the plant, one operating point
    refined : the same plant with a higher Pade order; the verdict and the rightmost pole must not depend on it
    tolerance : relative difference of matched eigenvalues, to the largest modulus, that still counts as agreement

    Raises
    ------
    ValueError : unknown names, batch axes, or a controller that measures states of the Pade form with `refined`
    ModelError : the algebraic loop is singular

    Examples
    --------
    >>> plant = SecondOrderSystem.from_matrices([[1.0]], [[0.0]], [[4.0]], inputs=("force",), B=[[1.0]])
    >>> law = Controller.static([[-0.8]], measured=("q1.velocity",), commands=("force",))
    >>> certificate = verify(plant, law)
    >>> certificate.stable, round(certificate.spectral_abscissa, 9)
    (True, -0.4)
    """
    require_single(system)
    first, second, least = _both_closings(system, controller)
    poles, others = (np.asarray(np.linalg.eigvals(x), dtype=np.complex128) for x in (first, second))
    size = max(float(np.max(np.abs(poles), initial=0.0)), 1e-300)
    matrix_difference = float(np.linalg.norm(first - second) / max(float(np.linalg.norm(first)), 1e-300))
    difference = _matched_difference(poles, others) / size
    positive, residual = lyapunov_proof(first)
    abscissa, other = (float(np.max(x.real, initial=-np.inf)) for x in (poles, others))
    proven = positive and residual < 1.0
    told: list[str] = []
    # A nearly defective pole may split by the root of the rounding; equal matrices then settle the question.
    if difference > tolerance and matrix_difference > 1e-12:
        told.append(f"the two closings differ by {difference:.1e} in their eigenvalues")
    if (abscissa < 0.0) != (other < 0.0):
        told.append("the two closings differ about stability")
    if proven != (abscissa < 0.0):
        told.append("the Lyapunov proof and the eigenvalues differ about stability")
    refined_abscissa = None if refined is None else _refined_abscissa(refined, controller)
    if refined_abscissa is not None and not _same_verdict(abscissa, refined_abscissa):
        told.append(f"a finer plant moves the spectral abscissa from {abscissa:.3g} to {refined_abscissa:.3g}")
    return Certificate(
        closed_loop_eigenvalues=read_only_any(poles),
        spectral_abscissa=abscissa,
        matrix_difference=matrix_difference,
        eigenvalue_difference=difference,
        lyapunov_positive=positive,
        lyapunov_residual=residual,
        smallest_return_difference=least,
        refined_abscissa=refined_abscissa,
        methods=METHODS if refined is None else (*METHODS, "plant with a higher Pade order"),
        agreed=Agreement.UNRESOLVED if told else Agreement.AGREED,
        disagreements=tuple(told),
    )


def lyapunov_proof(A: FloatArray) -> tuple[bool, float]:
    """Whether Y of A'Y + Y A = -I is positive definite, and a bound of its residual; below 1 it proves stability.

    A'Y + Y A = -I + E with |E| < 1 and Y > 0 is Lyapunov's condition whatever solver made Y. A is balanced first, and
    the residual is formed in extended precision.

    Examples
    --------
    >>> lyapunov_proof(np.array([[-1.0, 5.0], [0.0, -2.0]]))[0]
    True
    >>> lyapunov_proof(np.array([[0.1]]))[0]
    False
    """
    balanced = scaling.rescale(A, scaling.balance(A))
    one = np.eye(A.shape[0])
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("error")  # the solver warns where poles mirror each other: nothing is proven then
        try:
            Y: FloatArray = np.asarray(solve_continuous_lyapunov(balanced.T, -one), dtype=float)
            rest = _lyapunov_residual(balanced, Y)
            Y = Y - np.asarray(solve_continuous_lyapunov(balanced.T, rest), dtype=float)
        except (np.linalg.LinAlgError, ValueError, RuntimeWarning):
            return False, np.inf
    Y = 0.5 * (Y + Y.T)
    if not np.all(np.isfinite(Y)):
        return False, np.inf
    residual = float(np.linalg.norm(_lyapunov_residual(balanced, Y)))
    lowest, highest = np.linalg.eigvalsh(Y)[[0, -1]]
    return bool(lowest > 4.0 * A.shape[0] * np.finfo(float).eps * max(abs(lowest), abs(highest))), residual


def worst(*statuses: Status) -> Status:
    """The first status that is not SOLVED, failures before reduced accuracy.

    Examples
    --------
    >>> worst(Status.SOLVED, Status.ALMOST_SOLVED).name
    'ALMOST_SOLVED'
    """
    failed = [s for s in statuses if s not in (Status.SOLVED, Status.ALMOST_SOLVED)]
    almost = [s for s in statuses if s is Status.ALMOST_SOLVED]
    return (failed + almost + [Status.SOLVED])[0]


def _both_closings(system: SecondOrderSystem, controller: Controller) -> tuple[FloatArray, FloatArray, float]:
    try:
        first = close_loop(system, controller).state_matrix()
    except np.linalg.LinAlgError:
        raise ModelError("controller: the acceleration feedback cancels the mass") from None
    A, B, C, D = loop_matrices(system, controller)
    difference = np.eye(D.shape[-1]) + D
    least = float(np.linalg.svd(difference, compute_uv=False)[-1])
    if least <= 1e-12:
        raise ModelError("controller: the algebraic loop I + D is singular; the loop has no solution")
    return first, A - B @ np.linalg.solve(difference, C), least


def _matched_difference(first: ComplexArray, second: ComplexArray) -> float:
    if not first.size:
        return 0.0
    distance = np.abs(first[:, None] - second[None, :])
    rows, columns = linear_sum_assignment(distance)
    return float(np.max(distance[rows, columns]))


def _lyapunov_residual(A: FloatArray, Y: FloatArray) -> FloatArray:
    forward = Extended.of(Y) @ Extended.of(A)
    return (forward + forward.T + Extended.of(np.eye(A.shape[0]))).high


def _refined_abscissa(refined: SecondOrderSystem, controller: Controller) -> float:
    require_single(refined)
    inside = [name for name in controller.measured if re.search(r"\.delay\d+$", name)]
    if inside:
        raise ValueError(
            f"refined: the controller measures {inside[0]!r}, a state of one Pade order; such a law has no finer plant"
        )
    return float(np.max(np.linalg.eigvals(close_loop(refined, controller).state_matrix()).real))


def _same_verdict(abscissa: float, refined: float) -> bool:
    return (abscissa < 0.0) == (refined < 0.0) and abs(abscissa - refined) <= 0.02 * max(abs(abscissa), abs(refined))
