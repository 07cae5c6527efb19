"""Scheduled laws as a Python script: the table over the parameter, and the law at any value between its ends."""

from __future__ import annotations

from collections.abc import Sequence

from maglev_ctrl.proofs.file import Schedule
from maglev_ctrl.systems import Controller


def python_schedule(laws: Sequence[Controller], schedule: Schedule, *, name: str, origin: str = "") -> str:
    """Script with the stacked matrices A, B, C, D over `NODES` and `law(value)`, a control.StateSpace of u = K y.

    Numbers are written so that they are read back exactly. Outside the nodes nothing is extrapolated: `law` raises.

    Examples
    --------
    >>> laws = [Controller.static([[k]], measured=("gap",), commands=("force",)) for k in (-3.0, -2.0)]
    >>> script = python_schedule(laws, Schedule("speed", "m/s", (10.0, 50.0)), name="hover")
    >>> "NODES = np.array([10.0, 50.0])" in script
    True
    """
    first = laws[0]
    dt = "0" if first.dt is None else repr(float(first.dt))
    when = "continuous time" if first.dt is None else f"one step every {dt} s"
    place = f"{schedule.parameter} ({schedule.unit})"
    lines = [f'"""Control law {_safe(name)} over {_safe(place)}, {when}; u = K y, linear between the nodes."""', ""]
    lines += ["import control", "import numpy as np", "", f"ORIGIN = {origin!r}", f"PARAMETER = {place!r}"]
    lines += [f"MEASURED = {tuple(first.measured)!r}", f"COMMANDS = {tuple(first.commands)!r}"]
    lines.append(f"NODES = np.array({[float(node) for node in schedule.nodes]!r})")
    for key in "ABCD":
        shape = (len(laws), *getattr(first, key).shape)
        stack = ",\n    ".join(repr(getattr(law, key).tolist()) for law in laws)
        lines.append(f"{key} = np.array([\n    {stack},\n]).reshape({shape!r})")
    lines += [
        "", "",
        "def law(value):",
        f'    """The law at one value of {_safe(place)}."""',
        "    if not NODES[0] <= value <= NODES[-1]:",
        '        raise ValueError(f"expected {NODES[0]} to {NODES[-1]}, got {value}")',
        "    k = min(int(np.searchsorted(NODES, value, side='right')), len(NODES) - 1)",
        "    share = (value - NODES[k - 1]) / (NODES[k] - NODES[k - 1])",
        "    a, b, c, d = ((1.0 - share) * one[k - 1] + share * one[k] for one in (A, B, C, D))",
        f"    return control.ss(a, b, c, d, {dt})",
        "",
    ]  # fmt: skip
    return "\n".join(lines)


def _safe(text: str) -> str:
    return text.replace("\\", " ").replace('"', "'")
