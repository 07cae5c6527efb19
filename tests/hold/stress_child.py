"""One answer of every engine, as a document: run in processes with other kernels, threads, seeds of hashes, locales.

    python tests/hold/stress_child.py

Prints an object of name -> {"verdict": word, "figures": [numbers], "within": relative error}. `within` is what rounding
may do by the conditioning of the answer: the rounding unit times the condition, times a hundred for the operations.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from maglev_ctrl.analysis.floquet import floquet
from maglev_ctrl.analysis.loops import Loop
from maglev_ctrl.analysis.margins import loop_margins
from maglev_ctrl.analysis.modes import modes
from maglev_ctrl.analysis.norms import h2_norm, h_infinity_norm
from maglev_ctrl.analysis.plane_records import MapAxis
from maglev_ctrl.analysis.stability_plane import stability_plane
from maglev_ctrl.study.tuning.search import search
from maglev_ctrl.synthesis.h_infinity import h_infinity_synthesis
from maglev_ctrl.synthesis.riccati import riccati_continuous
from maglev_ctrl.synthesis.structured.design import structured_design
from maglev_ctrl.synthesis.structured.structure import Structure
from maglev_ctrl.systems import PeriodicSystem, SecondOrderSystem
from maglev_ctrl.systems.plant import Plant

UNIT = float(np.finfo(float).eps)


def answer(verdict: object, figures: Any, condition: float = 1.0) -> dict[str, Any]:
    """A word and numbers, known to a hundred rounding units times the condition."""
    return {"verdict": str(verdict), "figures": _flat(figures), "within": 100.0 * UNIT * condition}


def _flat(figures: Any) -> list[float]:
    array = np.asarray(figures).ravel()
    if np.iscomplexobj(array):
        array = np.concatenate([array.real, array.imag])
    return [float(x) for x in array]


def answers() -> dict[str, dict[str, Any]]:
    """All of them."""
    random = np.random.default_rng(8)
    T = random.standard_normal((6, 6))
    M, K = T @ T.T + np.eye(6), np.diag(np.arange(1.0, 7.0) ** 2) + 0.1 * T
    system = SecondOrderSystem.from_matrices(M, 0.05 * K, K)
    found = modes(system)
    told = {"modes": answer(found.verdict, found.s, float(np.linalg.cond(found.states)) * 30.0)}
    loop = Loop(
        [[0.0, 1.0], [-4.0, -0.5]], [[0.0], [1.0]], [[2.0, 1.5]], [[0.0]], ("u",), delays=[0.02]
    )  # fmt: skip
    margins = loop_margins(loop).channels[0]
    values = [margins.phase.value, margins.delay.value, margins.modulus.value, margins.disk.alpha]
    # Margins are polished to about the root of the rounding unit in their frequency, and flat there.
    told["margins"] = answer(margins.verified, values, 1e5)
    hill = floquet(PeriodicSystem.from_matrices([[0, 1], [-1, -0.1]], [[[0, 0], [-0.4, 0]]], frequency=2.0))
    told["Floquet"] = answer((hill.stable, hill.agreement.value), hill.exponents.real, 1e3)
    A, B, C = np.array([[0.0, 1.0], [-9.0, -0.06]]), np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]])
    told["norms"] = answer("", [norm(A, B, C, [[0.0]]).value for norm in (h2_norm, h_infinity_norm)], 1e6)

    def family(x: float, y: float) -> PeriodicSystem:
        return PeriodicSystem.from_matrices([[0, 1], [-1, -0.02]], [[[0, 0], [-y, 0]]], frequency=x)

    axes = MapAxis("frequency", np.linspace(1.5, 2.5, 41), reciprocal=True), MapAxis("depth", np.linspace(0, 0.2, 9))
    for threads in (1, 2):
        plane = stability_plane(family, *axes, threads=threads, checks=4)
        told[f"map, {threads} threads"] = answer(plane.state.tolist(), plane.growth, 1e6)
    law = riccati_continuous(A, B, np.eye(2), [[1.0]])
    told["Riccati"] = answer(law.status.name, law.P, law.condition)
    plant = Plant.from_matrices(A, B, B, [[1.0, 0.0], [0.0, 0.0]], D12=[[0.0], [1.0]])
    design = h_infinity_synthesis(plant)
    # The infimum is bracketed to 1e-9 or so, and the law backs off from wherever in it.
    told["H-infinity"] = answer(design.synthesis.status.name, design.synthesis.controller.D, 1e6)
    made = structured_design([plant], Structure.full(plant), objective="h2", starts=2, seed=3)
    # A descent stops where the slope is flat to about the root of the rounding unit.
    told["structured"] = answer(made.status.name, made.controller.D, 1e9)
    told["search"] = answer("", _searched(5), 1.0)
    return told


def _searched(seed: int) -> Sequence[Any]:
    from types import SimpleNamespace

    def assess(place: tuple[float, ...]) -> Any:
        x = np.asarray(place)
        score = np.array([float(np.sum(x**2)), float(np.sum((x - 1.0) ** 2))])
        return SimpleNamespace(score=score, total=0.0)

    found = search(
        assess, upper=[1.0, 1.0], integral=[False, False], objectives=2, population=8, generations=4, seed=seed,
        start=[0.5, 0.5], time_limit=None, tell=lambda generation, count: None,
    )  # fmt: skip
    return found.places


if __name__ == "__main__":
    print(json.dumps(answers()))
