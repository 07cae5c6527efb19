"""A control law whose matrices follow an operating parameter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.errors import OutOfDomain
from maglev_ctrl.systems.feedback import Controller


@dataclass(frozen=True, eq=False, slots=True)
class ScheduledController:
    """Controllers at rising values of `parameter` (SI `unit`), their matrices interpolated linearly between.

    All controllers have the same names, order and sampling period; use `at` for the law at a value.
    """

    parameter: str
    unit: str
    nodes: FloatArray
    controllers: tuple[Controller, ...]

    @classmethod
    def of(
        cls, parameter: str, unit: str, nodes: ArrayLike, controllers: tuple[Controller, ...]
    ) -> ScheduledController:
        """A schedule, checked.

        Raises
        ------
        ValueError : fewer than two nodes, nodes that do not rise, or controllers that do not fit together
        """
        values = read_only(nodes, name="nodes", shape=(None,))
        if values.ndim != 1 or len(values) < 2 or np.any(np.diff(values) <= 0.0):
            raise ValueError("nodes: expected two or more rising values")
        if len(controllers) != len(values):
            raise ValueError(f"controllers: expected {len(values)}, one per node, got {len(controllers)}")
        first = controllers[0]
        for other in controllers[1:]:
            alike = (first.measured, first.commands, first.dt) == (other.measured, other.commands, other.dt)
            if not alike or first.A.shape != other.A.shape:
                raise ValueError("controllers: expected the same names, order and sampling period at every node")
        return cls(parameter, unit, values, tuple(controllers))

    def at(self, value: float) -> Controller:
        """The law at a value of the parameter.

        Raises
        ------
        OutOfDomain : outside the nodes

        Examples
        --------
        >>> laws = tuple(Controller.static([[k]], measured=("y",), commands=("u",)) for k in (-1.0, -3.0))
        >>> float(ScheduledController.of("speed", "m/s", [10.0, 20.0], laws).at(15.0).D[0, 0])
        -2.0
        """
        low, high = float(self.nodes[0]), float(self.nodes[-1])
        slack = 1e-9 * (high - low)
        if not low - slack <= value <= high + slack:
            raise OutOfDomain(
                f"{self.parameter} {value:.6g} {self.unit} is outside the schedule, {low:.6g} to {high:.6g} {self.unit}"
            )
        place = int(np.clip(np.searchsorted(self.nodes, value) - 1, 0, len(self.nodes) - 2))
        width = float(self.nodes[place + 1] - self.nodes[place])
        share = float(np.clip((value - self.nodes[place]) / width, 0.0, 1.0))
        first, second = self.controllers[place : place + 2]
        blended = [
            (1.0 - share) * getattr(first, key) + share * getattr(second, key) for key in ("A", "B", "C", "D")
        ]
        return Controller.from_matrices(
            *blended, measured=first.measured, commands=first.commands, name=first.name, dt=first.dt
        )
