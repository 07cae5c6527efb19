"""The claims of a law for one plant: decay, and peak gain or energy, as tight as they can be proved."""

from __future__ import annotations

from collections.abc import Sequence

from maglev_ctrl.errors import ModelError, Status
from maglev_ctrl.proofs.claims import EnergyClaim, GainClaim
from maglev_ctrl.proofs.makers import bounded_real_claim, decay_claim, energy_claim, tightest_claim
from maglev_ctrl.synthesis.result import Performance, Synthesis, proven, refused
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant


def proved_law(
    law: str,
    plant: Plant,
    controller: Controller,
    *,
    norm: float,
    energy: bool,
    performance: Sequence[Performance],
    notes: Sequence[str],
    status: Status = Status.SOLVED,
) -> Synthesis:
    """The design with the tightest claims that are proved: decay, and peak gain or (where `energy`) H2 norm.

    Where none of them is proved the law is kept back, with the reason for the loosest.

    Examples
    --------
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]])
    >>> law = Controller.static([[-3.0]], measured=("x1",), commands=("u1",))
    >>> found = proved_law("demo", plant, law, norm=0.5, energy=False, performance=[], notes=[])
    >>> [round(x, 6) for x in (found.claims[0].rate, found.claims[1].gamma)]
    [1.96, 0.500005]
    """
    level: EnergyClaim | GainClaim
    try:
        decay = decay_claim([plant], [controller])
        if energy:
            level = tightest_claim(energy_claim, [plant], [controller], norm)
        else:
            level = tightest_claim(bounded_real_claim, [plant], [controller], norm)
    except ModelError as error:
        return refused(law, [plant], Status.NOT_VERIFIED, f"the law is kept back: {error}")
    return proven(
        law, [plant], [controller], claims=[decay, level], performance=performance, notes=notes, status=status
    )  # fmt: skip
