"""Writes default_forces.json: the default guideway's force map at 36.1 m/s, from the finite-element solution.

    python tests/paper/data/regenerate.py

ln(-W) and ln(drag) as Chebyshev series of ln(height + shift) and ln(gap + shift), SI units; W the energy whose gradient
lift and guidance are.
"""

from __future__ import annotations

import json
from pathlib import Path

from maglev_ctrl.forces.force_map import ForceMap
from maglev_ctrl.study.paper.cases import DEFAULT, MAPPED_RANGE, eddy_current


def main() -> None:
    """Solve the default guideway and keep its map."""
    force = eddy_current(DEFAULT).force
    assert isinstance(force, ForceMap)
    body = {
        "height": MAPPED_RANGE,
        "gap": MAPPED_RANGE,
        "shift": [axis.shift for axis in force.axes[:2]],
        "log_energy": [[float(f"{c:.12g}") for c in row] for row in force.log_energy[:, :, 0]],
        "log_drag": [[float(f"{c:.12g}") for c in row] for row in force.log_drag[:, :, 0]],
    }
    file = Path(__file__).with_name("default_forces.json")
    file.write_text(json.dumps(body) + "\n", encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
