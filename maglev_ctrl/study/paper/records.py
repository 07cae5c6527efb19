"""What a reproduction of the paper is made of: cases, sweeps, boundaries found in two ways, claims with verdicts."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Literal, Protocol

from numpy.typing import ArrayLike

from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.errors import Agreement
from maglev_ctrl.forces import AbstractForceModel

Model = Literal["P", "C", "CG"]
Instability = Literal["flutter", "divergence"]
Parameter = Literal["height", "lateral_offset"]

MODELS: tuple[Model, ...] = ("P", "C", "CG")


class ClaimVerdict(Enum):
    """What became of a claim of the paper."""

    HOLDS = "HOLDS"
    CORRECTED = "HOLDS WITH CORRECTION"
    FALSE = "DOES NOT HOLD"
    NOT_TESTABLE = "NOT TESTABLE"
    UNRESOLVED = "UNRESOLVED"


class UnsteadyForce(Protocol):
    """What is asked of a force model beyond quasi-static theory: its response to an oscillating magnet."""

    def motion_stiffness(self, height: float, gap: float, speed: float, frequency: ArrayLike) -> ComplexArray:
        """Complex stiffness (F, 4, 4) in surge, sway away from the wall, heave, roll at frequencies in rad/s."""
        ...


@dataclass(frozen=True, slots=True)
class GuidewayCase:
    """Geometry of the L-shaped guideway and how the magnet's height is measured: what the paper leaves open.

    Parameters
    ----------
    name, label : short and in words
    thickness : of both legs, m
    wall, floor : lengths of the inner faces of the lateral leg and of the lift leg, m
    conductivity : S/m
    loop_height : from the point where the height is measured up to the equivalent loop, m
    question : "" for the default, else what the case answers
    """

    name: str
    label: str
    thickness: float
    wall: float
    floor: float
    conductivity: float
    loop_height: float
    question: Literal["", "sensitivity", "edge"] = ""


@dataclass(frozen=True, eq=False, slots=True)
class SolvedCase:
    """A case with its forces.

    `force` over height and gap at the paper's speed; `any_speed` over speed too; `unsteady` where the model has it.
    `method` says in words where the numbers come from and how accurate they are.
    """

    case: GuidewayCase
    force: AbstractForceModel
    any_speed: AbstractForceModel | None
    unsteady: UnsteadyForce | None
    method: str


@dataclass(frozen=True, eq=False, slots=True)
class DataTable:
    """The numbers behind one figure: a column per quantity, its unit in the heading."""

    name: str
    columns: tuple[str, ...]
    rows: FloatArray


@dataclass(frozen=True, slots=True)
class Boundary:
    """Where an instability begins or ends as the parameter rises, found from two independent sides.

    `value` from the closed condition, `eigenvalue` from the eigenvalues of the assembled vehicle; m.
    """

    kind: Instability
    begins: bool
    value: float
    eigenvalue: float


@dataclass(frozen=True, eq=False, slots=True)
class EigenSweep:
    """Squared frequencies of the undamped double-L vehicle over a parameter.

    `values` (n,) m; `squared` (n, 3) complex omega^2 in 1/s^2, each column one mode followed by continuity: the paper's
    first (heave), second and third;
    `flutter`, `divergence` intervals of the parameter in m; `agreement` of the two ways, with the `reason` when they
    disagree.
    """

    key: str
    model: Model
    parameter: Parameter
    height: float | None
    gap: float
    values: FloatArray
    squared: ComplexArray
    boundaries: tuple[Boundary, ...]
    flutter: tuple[tuple[float, float], ...]
    divergence: tuple[tuple[float, float], ...]
    agreement: Agreement
    reason: str


@dataclass(frozen=True, eq=False, slots=True)
class ModeTable:
    """Mode vectors (v1, v2, v3) of Table 1 at one height: `vectors` (3, 3), a column per mode, largest modulus 1."""

    height: float
    model: Model
    squared: ComplexArray
    vectors: ComplexArray


@dataclass(frozen=True, slots=True)
class Extreme:
    """A maximum or minimum of the guidance force along a line; `at` is NaN where there is none inside the range."""

    kind: Literal["maximum", "minimum"]
    along: Literal["height", "gap"]
    fixed: float
    at: float
    force: float


@dataclass(frozen=True, slots=True)
class SensitivityRow:
    """What one changed assumption does to the stability boundaries; ranges in m, empty where there is none."""

    label: str
    reference_forces: tuple[float, float, float]
    flutter: dict[str, tuple[tuple[float, float], ...]]
    divergence: dict[str, tuple[tuple[float, float], ...]]
    agreement: Agreement


@dataclass(frozen=True, eq=False, slots=True)
class SpeedStudy:
    """Drag over speed and damping from unsteady forces at one place; NaN where the force model does not tell.

    `speed` (n,) m/s, `drag` (n,) N, `peak` m/s; `unsteady_speed` (k,), `damping` (k, 3) Im Q / w of surge, sway and
    heave in N s/m at `frequency` rad/s; positive is negative damping.
    """

    height: float
    gap: float
    speed: FloatArray
    lift: FloatArray
    drag: FloatArray
    peak: float
    frequency: float
    unsteady_speed: FloatArray
    damping: FloatArray


@dataclass(frozen=True, slots=True)
class Claim:
    """One claim of the paper and what became of it.

    `reduced` is what the paper's own equations give, `consistent` what the corrected ones give.
    """

    key: str
    where: str
    quote: str
    reduced: str
    consistent: str
    verdict: ClaimVerdict
    why: str


@dataclass(frozen=True, eq=False, slots=True)
class Reproduction:
    """Everything `maglev-ctrl reproduce` computes."""

    solved: SolvedCase
    quick: bool
    assumptions: tuple[str, ...]
    tables: tuple[DataTable, ...]
    extremes: dict[str, tuple[Extreme, ...]]
    sweeps: tuple[EigenSweep, ...]
    modes: tuple[ModeTable, ...]
    speeds: SpeedStudy | None
    sensitivity: tuple[SensitivityRow, ...]
    claims: tuple[Claim, ...]
    notes: tuple[str, ...]
    version: str
    created: str
    seconds: float

    def table(self, name: str) -> DataTable:
        """The data behind a figure by its name.

        Raises
        ------
        KeyError : no such table
        """
        for table in self.tables:
            if table.name == name:
                return table
        raise KeyError(name)

    def sweep(self, key: str, model: Model) -> EigenSweep:
        """The sweep of a figure with one model.

        Raises
        ------
        KeyError : no such sweep
        """
        for sweep in self.sweeps:
            if sweep.key == key and sweep.model == model:
                return sweep
        raise KeyError(f"{key}, {model}")
