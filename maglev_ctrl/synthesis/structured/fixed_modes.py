"""Modes that no law of a structure moves (Wang & Davison, IEEE TAC 18 (1973) 473): found, named."""

from __future__ import annotations

import numpy as np

from maglev_ctrl.synthesis.neutral import HiddenMode, hidden_modes
from maglev_ctrl.synthesis.structured.loop import close, felt_sizes, gain_sizes, join
from maglev_ctrl.synthesis.structured.spectral import eigenvectors, growth_rates
from maglev_ctrl.synthesis.structured.structure import Structure
from maglev_ctrl.systems.plant import Plant

_STILL = 1e-8
"""Movement, as a share of the size of the state matrix, below which a pole counts as not moved."""
_GAINS = 3


def fixed_modes(plant: Plant, structure: Structure, *, seed: int = 0) -> tuple[HiddenMode, ...]:
    """Poles that are not stable and that no random admissible gain moves, one per conjugate pair.

    A gain drawn at random moves every pole that any admissible gain moves, with probability one; three are drawn of
    each of two sizes.

    Examples
    --------
    >>> plant = Plant.from_matrices([[1.0, 0.0], [0.0, 2.0]], [[1.0], [1.0]], [[1.0], [0.0]], [[1.0, 0.0]])
    >>> [mode.label for mode in fixed_modes(plant, Structure.full(plant))]
    ['the mode at 2 rad/s (x2)']
    """
    joined = join(plant, structure.order)
    start = structure.gain(structure.parameters(structure.base))
    try:
        A = close(joined, start).A
    except np.linalg.LinAlgError:
        return ()
    poles, left, right = eigenvectors(A)
    size = max(float(np.linalg.norm(A, 2)), 1e-300)
    moved = growth_rates(poles, plant.dt) < 0.0
    rng = np.random.default_rng(seed)
    measures = (gain_sizes((joined,)), felt_sizes(joined))
    for sizes in _GAINS * measures:
        drawn = np.tensordot(
            0.3 * rng.choice([-1.0, 1.0], len(structure.basis)) * rng.uniform(0.5, 1.5, len(structure.basis)),
            structure.basis, axes=1,
        )  # fmt: skip
        K = structure.gain(structure.parameters(start + drawn * sizes))
        try:
            others = np.linalg.eigvals(close(joined, K).A)
        except np.linalg.LinAlgError:
            continue
        moved |= np.min(np.abs(poles[:, None] - others[None, :]), axis=1) > _STILL * size
    names = (*plant.states, *(f"law.x{i + 1}" for i in range(structure.order)))
    found = []
    for k in np.flatnonzero(~moved & (poles.imag >= 0.0)):
        overlap = complex(np.vdot(left[:, k], right[:, k]))
        simple = abs(overlap) > 1e-5
        share = np.abs(right[:, k]) * (np.abs(left[:, k]) if simple else 1.0)
        strongest = tuple(names[i] for i in np.argsort(-share)[:2] if share[i] > 0.3 * np.max(share))
        found.append(HiddenMode(complex(poles[k]), right[:, k], left[:, k], strongest, simple))
    return tuple(found)


def why_fixed(plant: Plant, mode: HiddenMode) -> str:
    """One sentence on a fixed mode: unseen, unmoved, or beyond the pattern of the law."""
    if plant.dt is None:
        for rows, A, cause in (
            (plant.C2, plant.A, f"no sensor among {', '.join(plant.measured)} sees it: add a sensor"),
            (plant.B2.T, plant.A.T, f"no actuator among {', '.join(plant.commands)} moves it: add an actuator"),
        ):
            if any(
                abs(one.pole - mode.pole) <= 1e-6 * (1.0 + abs(mode.pole))
                for one in hidden_modes(A, rows, plant.states)
            ):
                return (
                    f"{plant.name}: no admissible gain moves {mode.label}; {cause}, or hold or leave out this freedom"
                )
    return (
        f"{plant.name}: no gain of this pattern moves {mode.label}, which is not stable: let another command read "
        "another sensor, or give the law states of its own"
    )
