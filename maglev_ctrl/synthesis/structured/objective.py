"""What a structured design minimises: the worst of a quantity over plants, with limits as exact penalties."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.synthesis.structured.energy import energy_piece
from maglev_ctrl.synthesis.structured.loop import Closed, Joined, close, gain_sizes, join
from maglev_ctrl.synthesis.structured.peaks import peak_pieces
from maglev_ctrl.synthesis.structured.spectral import Piece, damping_pieces, growth_pieces, growth_rates
from maglev_ctrl.synthesis.structured.structure import Structure
from maglev_ctrl.systems.plant import Plant

Quantity = Literal["decay_rate", "damping_ratio", "h2", "h_infinity"]
MARGIN = 1e-4
"""Share by which the search stays inside a limit, so that the limit itself can be proved."""


@dataclass(frozen=True, slots=True)
class Limit:
    """A bound: "decay_rate" (1/s) or "damping_ratio" at least `level`, "h2" or "h_infinity" at most `level`."""

    quantity: Quantity
    level: float


@dataclass(eq=False, slots=True)
class Objective:
    """Function of scaled parameters t, theta = size t, with exact gradients; infinite where it does not exist.

    Norms enter by their logarithm, decay as growth rate over the plant's typical rate, damping as minus the ratio.
    `weight` multiplies the excess over the limits. `frequencies` remembers the last peaks of every plant.
    """

    plants: tuple[Joined, ...]
    structure: Structure
    quantity: Quantity
    limits: tuple[Limit, ...]
    size: FloatArray
    rate: float
    weight: float = 10.0
    frequencies: list[FloatArray] = field(default_factory=list)
    evaluations: int = 0

    @classmethod
    def of(
        cls, plants: tuple[Plant, ...], structure: Structure, quantity: Quantity, limits: tuple[Limit, ...] = ()
    ) -> Objective:
        """The objective of plants and a structure, scaled."""
        joined = tuple(join(plant, structure.order) for plant in plants)
        sizes = np.log(gain_sizes(joined))
        counts = np.sum(structure.basis != 0.0, axis=(1, 2))
        size = np.exp(np.sum(np.where(structure.basis != 0.0, sizes, 0.0), axis=(1, 2)) / np.maximum(counts, 1))
        rates = [float(np.median(np.abs(np.linalg.eigvals(plant.A)))) for plant in plants]
        rate = max(max(rates), 1e-3 * max(float(np.linalg.norm(plant.A, 2)) for plant in joined), 1e-12)
        empty = [np.zeros(0) for _ in joined]
        return cls(joined, structure, quantity, limits, size, rate, frequencies=empty)

    def about(self, quantity: Quantity) -> Objective:
        """The same plants and structure with another quantity and no limits."""
        return replace(
            self, quantity=quantity, limits=(), frequencies=[np.zeros(0) for _ in self.plants], evaluations=0
        )

    def unlimited(self) -> Objective:
        """The same objective without its limits."""
        return self.about(self.quantity)

    def physical(self, value: float) -> float:
        """A value in the quantity's own unit: decay rate in 1/s, damping ratio, norm."""
        if self.quantity == "decay_rate":
            return -value * self.rate
        return (
            -value
            if self.quantity == "damping_ratio"
            else float(np.exp(min(value, 709.0)))
            if value < np.inf
            else np.inf
        )

    @property
    def lower(self) -> FloatArray:
        """Lower bounds of t."""
        return np.asarray(self.structure.lower / self.size)

    @property
    def upper(self) -> FloatArray:
        """Upper bounds of t."""
        return np.asarray(self.structure.upper / self.size)

    def growth(self, t: FloatArray) -> float:
        """Largest growth rate (1/s) over the plants."""
        worst = -np.inf
        for _, loop in self._loops(t):
            if loop is None:
                return np.inf
            worst = max(worst, float(np.max(growth_rates(_poles(loop), loop.dt))))
        return worst

    def value(self, t: FloatArray, *, ceiling: float = np.inf) -> tuple[float, FloatArray]:
        """Value and gradient; above `ceiling` only that it is above is certain."""
        self.evaluations += 1
        pieces = self._pieces(t, 0.0, ceiling)
        return pieces[0].value, pieces[0].gradient

    def pieces(self, t: FloatArray, closeness: float) -> list[Piece]:
        """Smooth pieces of the maximum within `closeness` of it (in the value's own unit), highest first."""
        self.evaluations += 1
        return self._pieces(t, closeness, np.inf)

    def _pieces(self, t: FloatArray, closeness: float, ceiling: float) -> list[Piece]:
        found: list[Piece] = []
        excess = [Piece(0.0, np.zeros(t.size)) for _ in self.limits]
        nothing = [Piece(np.inf, np.zeros(t.size))]
        for k, loop in self._loops(t):
            if loop is None:
                return nothing
            poles = _poles(loop)
            needs_stable = self.quantity in ("h2", "h_infinity") or bool(self.limits)
            if not np.all(np.isfinite(poles)) or (needs_stable and np.max(growth_rates(poles, loop.dt)) >= 0.0):
                return nothing
            try:
                found += self._measure(self.quantity, loop, poles, k, closeness, ceiling if not self.limits else np.inf)
                for i, limit in enumerate(self.limits):
                    top = self._measure(limit.quantity, loop, poles, k, 0.0, np.inf)[0]
                    over = top.value - self._level(limit)
                    if over > excess[i].value:
                        excess[i] = Piece(over, top.gradient)
            except np.linalg.LinAlgError:
                return nothing
        found.sort(key=lambda piece: -piece.value)
        top_value = found[0].value
        if not np.isfinite(top_value):
            return nothing
        added = self.weight * sum(one.value for one in excess)
        slope = np.sum([self.weight * one.gradient for one in excess], axis=0) if excess else np.zeros(t.size)
        return [Piece(p.value + added, p.gradient + slope) for p in found if p.value >= top_value - closeness]

    def excess(self, t: FloatArray) -> float:
        """Largest excess over the limits; 0 where all are kept with half the margin that the search aims at."""
        worst = 0.0
        for limit in self.limits:
            worst = max(worst, self.about(limit.quantity).value(t)[0] - self._level(limit, margin=0.5 * MARGIN))
        return worst

    def _level(self, limit: Limit, *, margin: float = MARGIN) -> float:
        if limit.quantity == "decay_rate":
            return -limit.level * (1.0 + margin) / self.rate
        if limit.quantity == "damping_ratio":
            return -limit.level * (1.0 + margin)
        return float(np.log(limit.level)) - margin

    def _measure(
        self, quantity: Quantity, loop: Closed, poles: ComplexArray, k: int, closeness: float, ceiling: float
    ) -> list[Piece]:
        if quantity == "decay_rate":
            raw = growth_pieces(loop, closeness=closeness * self.rate)
            return [Piece(p.value / self.rate, self._chain(p.gradient) / self.rate) for p in raw]
        if quantity == "damping_ratio":
            return [Piece(p.value, self._chain(p.gradient)) for p in damping_pieces(loop, closeness=closeness)]
        if quantity == "h2":
            raw = [energy_piece(loop)]
        else:
            raw, self.frequencies[k] = peak_pieces(
                loop, poles, hints=self.frequencies[k], closeness=closeness,
                ceiling=float(np.exp(min(ceiling, 600.0))),
            )  # fmt: skip
            self.frequencies[k] = self.frequencies[k][:6]
        return [
            Piece(float(np.log(p.value)), self._chain(p.gradient) / p.value)
            if 0.0 < p.value < np.inf
            else Piece(-700.0 if p.value == 0.0 else np.inf, np.zeros(self.size.size))
            for p in raw
        ]

    def _chain(self, gradient: FloatArray) -> FloatArray:
        return np.asarray(np.tensordot(self.structure.basis, gradient, axes=2) * self.size)

    def _loops(self, t: FloatArray) -> list[tuple[int, Closed | None]]:
        K = self.structure.gain(t * self.size)
        found: list[tuple[int, Closed | None]] = []
        for k, plant in enumerate(self.plants):
            try:
                loop: Closed | None = close(plant, K)
            except np.linalg.LinAlgError:
                loop = None
            if loop is not None and not np.all(np.isfinite(loop.A)):
                loop = None
            found.append((k, loop))
        return found


def _poles(loop: Closed) -> ComplexArray:
    return np.asarray(np.linalg.eigvals(loop.A), dtype=np.complex128)
