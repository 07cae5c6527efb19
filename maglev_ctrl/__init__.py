"""maglev_ctrl: control design and stabilization workbench for maglev vehicles.

Names are loaded on first use, so that `import maglev_ctrl` and the command line stay quick.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from maglev_ctrl._version import __version__

_HOMES = {
    "SecondOrderSystem": "maglev_ctrl.systems",
    "Controller": "maglev_ctrl.systems",
    "PeriodicSystem": "maglev_ctrl.systems",
    "close_loop": "maglev_ctrl.systems",
    "modulate": "maglev_ctrl.systems",
    "ImageForce": "maglev_ctrl.forces",
    "TabulatedForce": "maglev_ctrl.forces",
    "CoefficientTable": "maglev_ctrl.forces",
    "Body": "maglev_ctrl.vehicle",
    "Magnet": "maglev_ctrl.vehicle",
    "SpringDamper": "maglev_ctrl.vehicle",
    "Actuator": "maglev_ctrl.vehicle",
    "Sensor": "maglev_ctrl.vehicle",
    "Vehicle": "maglev_ctrl.vehicle",
    "OperatingPoint": "maglev_ctrl.vehicle",
    "equilibrium": "maglev_ctrl.vehicle",
    "linearize": "maglev_ctrl.vehicle",
    "modes": "maglev_ctrl.analysis.modes",
    "floquet": "maglev_ctrl.analysis.floquet",
    "loop_margins": "maglev_ctrl.analysis.margins",
    "to_python_control": "maglev_ctrl.synthesis.interchange",
    "from_python_control": "maglev_ctrl.synthesis.interchange",
    "loop_from_python_control": "maglev_ctrl.synthesis.interchange",
    "to_dataset": "maglev_ctrl.report.notebook",
    "to_frame": "maglev_ctrl.report.notebook",
    "load": "maglev_ctrl.scenario",
    "run": "maglev_ctrl.study",
}

__all__ = ["__version__", *_HOMES]


def __getattr__(name: str) -> Any:
    """Load a public name from its home on first use.

    Raises
    ------
    AttributeError : the package has no such public name
    """
    if name not in _HOMES:
        raise AttributeError(f"module 'maglev_ctrl' has no attribute {name!r}")
    # `modes` and `floquet` are functions whose modules carry the same name inside `analysis`, never here.
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
