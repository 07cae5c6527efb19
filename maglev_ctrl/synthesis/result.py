"""The gate every synthesis leaves by: a controller with claims that hold, or a reason and no controller."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from maglev_ctrl.errors import ModelError, Status
from maglev_ctrl.proofs.claims import Claim, Proof
from maglev_ctrl.proofs.prove import prove
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant

AGREEMENT = 1e-5
"""Relative difference allowed between a reported and a recomputed norm."""


class Refused(ModelError):
    """A synthesis came to no law; `status` is what the solver, or the check of what it said, came to.

    Examples
    --------
    >>> Refused("no law: the time was up", Status.TIME_LIMIT).status.name
    'TIME_LIMIT'
    """

    def __init__(self, message: str, status: Status) -> None:
        super().__init__(message)
        self.status = status

    def __reduce__(self) -> tuple[type[Refused], tuple[str, Status]]:
        return type(self), (str(self), self.status)


@dataclass(frozen=True, eq=False, slots=True)
class Performance:
    """One number a design is judged by: what the solver reported and what independent code found of the closed loop.

    `quantity` in words ("H-infinity norm"); `reported` NaN where the solver reports none.
    """

    quantity: str
    reported: float
    recomputed: float
    unit: str = ""


@dataclass(frozen=True, eq=False, slots=True)
class Synthesis:
    """What a synthesis on plants hands back; `controllers` is empty unless every claim was proved.

    `plants` the vertices (one for a nominal design); `controllers` one law, or one per plant for a scheduled law.
    """

    law: str
    plants: tuple[Plant, ...]
    controllers: tuple[Controller, ...]
    status: Status
    message: str
    performance: tuple[Performance, ...] = ()
    claims: tuple[Claim, ...] = ()
    proofs: tuple[Proof, ...] = ()
    notes: tuple[str, ...] = field(default=())

    @property
    def controller(self) -> Controller:
        """The one law of the design.

        Raises
        ------
        ModelError : there is none, or there are several
        """
        if len(self.controllers) != 1:
            raise ModelError(f"{self.law}: {len(self.controllers)} laws; {self.status.value}; {self.message}")
        return self.controllers[0]

    def require(self) -> Synthesis:
        """This synthesis where it succeeded.

        Raises
        ------
        ModelError : no controller was returned, with the reason
        """
        if not self.controllers:
            raise Refused(f"{self.law}: {self.status.value}; {self.message}", self.status)
        return self


def proven(
    law: str,
    plants: Sequence[Plant],
    controllers: Sequence[Controller],
    *,
    claims: Sequence[Claim],
    performance: Sequence[Performance] = (),
    notes: Sequence[str] = (),
    status: Status = Status.SOLVED,
) -> Synthesis:
    """Let a design through if every claim is proved and every reported number is found again; else keep the law back.

    Parameters
    ----------
    claims : at least one; a design without a claim is not let through
    performance : a reported number that is not NaN has to be found again within `AGREEMENT`, and to be finite
    status : SOLVED, or ALMOST_SOLVED where the solver said so

    Examples
    --------
    >>> import numpy as np
    >>> from maglev_ctrl.proofs.claims import DecayClaim
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]])
    >>> law = Controller.static([[-3.0]], measured=("x1",), commands=("u1",))
    >>> proven("demo", [plant], [law], claims=[DecayClaim((0,), (0,), 1.0, np.ones((1, 1, 1)))]).status.name
    'SOLVED'
    """
    proofs = tuple(prove(claim, plants, controllers) for claim in claims)
    failed = [f"{proof.statement}: {proof.reason}" for proof in proofs if not proof.holds]
    failed += [
        f"{one.quantity}: the solver reported {one.reported:.6g}, the closed loop has {one.recomputed:.6g}"
        for one in performance
        if one.reported == one.reported and not _same(one)
    ]
    if not proofs:
        failed.append("the design carries no claim")
    kept = () if failed else tuple(controllers)
    return Synthesis(
        law=law, plants=tuple(plants), controllers=kept, status=Status.NOT_VERIFIED if failed else status,
        message="; ".join(failed), performance=tuple(performance), claims=tuple(claims), proofs=proofs,
        notes=tuple(notes),
    )  # fmt: skip


def refused(law: str, plants: Sequence[Plant], status: Status, message: str) -> Synthesis:
    """No controller, and why.

    Examples
    --------
    >>> refused("demo", [], Status.INFEASIBLE, "no input").controllers
    ()
    """
    return Synthesis(law=law, plants=tuple(plants), controllers=(), status=status, message=message)


def _same(one: Performance) -> bool:
    """Both are finite and agree: a loop of infinite norm agrees with nothing."""
    if not (math.isfinite(one.reported) and math.isfinite(one.recomputed)):
        return False
    return abs(one.reported - one.recomputed) <= AGREEMENT * abs(one.recomputed)
