"""Controllers whose matrices follow a measured parameter: linear interpolation between nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.systems.feedback import Controller


@dataclass(frozen=True, eq=False, slots=True)
class ScheduledController:
    """Laws at rising `nodes` (p,) of one `parameter` (in `unit`), blended linearly between neighbours."""

    parameter: str
    unit: str
    nodes: FloatArray
    controllers: tuple[Controller, ...]

    @classmethod
    def from_nodes(
        cls, parameter: str, unit: str, nodes: ArrayLike, controllers: tuple[Controller, ...]
    ) -> ScheduledController:
        """A schedule, checked: one law at each node, all of one shape and with the same signals.

        Raises
        ------
        ValueError : nodes that do not rise, a number of laws that differs, or laws that do not match one another

        Examples
        --------
        >>> laws = tuple(Controller.static([[-k]], measured=("z",), commands=("f",)) for k in (1.0, 3.0))
        >>> float(ScheduledController.from_nodes("speed", "m/s", [20.0, 40.0], laws).at(25.0).D[0, 0])
        -1.5
        """
        places = read_only(nodes, name="nodes")
        if places.ndim != 1 or not places.size or np.any(np.diff(places) <= 0.0):
            raise ValueError(f"nodes: expected rising values, got {np.asarray(nodes).tolist()}")
        if len(controllers) != len(places):
            raise ValueError(f"controllers: expected {len(places)}, one at each node, got {len(controllers)}")
        first = controllers[0]
        for law, node in zip(controllers, places, strict=True):
            same = (law.measured, law.commands, law.dt) == (first.measured, first.commands, first.dt)
            if not same or law.A.shape != first.A.shape:
                raise ValueError(
                    f"controllers: the law at {parameter} {node:g} {unit} has other signals, states or sampling than "
                    f"the first"
                )
        return cls(parameter, unit, places, controllers)

    def at(self, value: float) -> Controller:
        """The law at a value of the parameter.

        Raises
        ------
        ValueError : the value is outside the nodes; nothing is extrapolated
        """
        low, high = float(self.nodes[0]), float(self.nodes[-1])
        if not low <= value <= high:
            raise ValueError(
                f"{self.parameter}: expected {low:g} to {high:g} {self.unit}, where laws are scheduled, got {value:g}"
            )
        right = min(max(int(np.searchsorted(self.nodes, value)), 1), max(len(self.nodes) - 1, 1))
        if len(self.nodes) == 1:
            return self.controllers[0]
        share = float((value - self.nodes[right - 1]) / (self.nodes[right] - self.nodes[right - 1]))
        return blended((self.controllers[right - 1], self.controllers[right]), (1.0 - share, share))


def blended(controllers: tuple[Controller, ...], weights: ArrayLike) -> Controller:
    """The law whose matrices are the weighted sums of the laws' matrices.

    Examples
    --------
    >>> laws = tuple(Controller.static([[-k]], measured=("z",), commands=("f",)) for k in (1.0, 3.0))
    >>> blended(laws, (0.5, 0.5)).D
    array([[-2.]])
    """
    first, shares = controllers[0], np.asarray(weights, dtype=float)
    A, B, C, D = (
        np.sum([share * getattr(law, key) for law, share in zip(controllers, shares, strict=True)], axis=0)
        for key in ("A", "B", "C", "D")
    )
    return Controller.from_matrices(
        A, B, C, D, measured=first.measured, commands=first.commands, name=first.name, dt=first.dt
    )
