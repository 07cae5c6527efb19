"""What the claims of a design leave unsaid: plants and laws of which no claim tells that the loop is stable."""

from __future__ import annotations

from collections.abc import Sequence

from maglev_ctrl.proofs.claims import Claim, DecayClaim, ParameterClaim, RegionClaim
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant


def tells_stability(claim: Claim) -> bool:
    """Whether the claim, if it holds, says that its loops are stable.

    Bounds on norms, ellipsoids and segments do: their inequalities hold a Lyapunov matrix. A decay rate below zero does
    not, nor does a region, which may reach to the right.

    Examples
    --------
    >>> import numpy as np
    >>> tells_stability(DecayClaim((0,), (0,), -1.0, np.ones((1, 1, 1))))
    False
    """
    if isinstance(claim, DecayClaim | ParameterClaim):
        return claim.rate >= 0.0
    return not isinstance(claim, RegionClaim)


def uncovered(claims: Sequence[Claim], plants: Sequence[Plant], controllers: Sequence[Controller]) -> tuple[str, ...]:
    """Sentences on every plant and every law that no claim of stability speaks of.

    Examples
    --------
    >>> import numpy as np
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]], name="500 km/h")
    >>> law = Controller.static([[-3.0]], measured=("x1",), commands=("u1",))
    >>> uncovered([DecayClaim((0,), (0,), 1.0, np.ones((1, 1, 1)))], [plant, plant], [law])
    ("no claim says that the loop at plant 2 ('500 km/h') is stable",)
    """
    said = [claim for claim in claims if tells_stability(claim)]
    seen = {index for claim in said for index in claim.plants}
    used = {index for claim in said for index in claim.controllers}
    found = [
        f"no claim says that the loop at plant {i + 1} ({plant.name!r}) is stable"
        for i, plant in enumerate(plants)
        if i not in seen
    ]
    found += [f"no claim speaks of law {j + 1} ({law.name!r})" for j, law in enumerate(controllers) if j not in used]
    return tuple(found)


def spoken_of(claim: Claim, plants: Sequence[Plant]) -> str:
    """The operating points of a claim by their names, the first and the last where there are many.

    Examples
    --------
    >>> import numpy as np
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]], name="500 km/h")
    >>> spoken_of(DecayClaim((0,), (0,), 1.0, np.ones((1, 1, 1))), [plant])
    '500 km/h'
    """
    names = [plants[i].name for i in dict.fromkeys(claim.plants)]
    return "; ".join(names) if len(names) <= 3 else f"{names[0]}; {names[1]}; ... {names[-1]} ({len(names)})"
