"""Laws as small Python scripts that rebuild them with numpy and python-control and need nothing else."""

from __future__ import annotations

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.synthesis.interchange import allowed_names
from maglev_ctrl.systems import Controller


def python_source(controller: Controller, *, origin: str = "") -> str:
    """Script that makes `law`, a control.StateSpace of u = K y (the sign of the feedback is in the matrices).

    Numbers are written so that they are read back exactly. python-control does not allow dots in signal names: they
    become underscores; the tuples `MEASURED` and `COMMANDS` keep the names.

    Examples
    --------
    >>> law = Controller.static([[-3.0]], measured=("gap",), commands=("force",), dt=0.001)
    >>> "D = np.array([[-3.0]])" in python_source(law)
    True
    """
    dt = 0 if controller.dt is None else repr(float(controller.dt))
    when = "continuous time" if controller.dt is None else f"one step every {float(controller.dt)!r} s"
    lines = [f'"""Control law {_quoted(controller.name)}, {when}: x+ = A x + B y, u = C x + D y."""']
    if controller.dt is None:
        lines[0] = lines[0].replace("x+ =", "x' =")
    lines += ["", "import control", "import numpy as np", ""]
    lines.append(f"ORIGIN = {origin!r}")
    lines.append(f"MEASURED = {tuple(controller.measured)!r}")
    lines.append(f"COMMANDS = {tuple(controller.commands)!r}")
    lines += [f"{key} = {_matrix(getattr(controller, key))}" for key in "ABCD"]
    lines += [
        "",
        "law = control.ss(",
        "    A, B, C, D,",
        f"    {dt},",
        f"    inputs={allowed_names(controller.measured)!r},",
        f"    outputs={allowed_names(controller.commands)!r},",
        ")",
        "",
    ]
    return "\n".join(lines)


def _matrix(matrix: FloatArray) -> str:
    if not matrix.size:
        return f"np.zeros({tuple(int(size) for size in matrix.shape)!r})"
    rows = [f"[{', '.join(repr(float(value)) for value in row)}]" for row in matrix]
    if len(rows) == 1:
        return f"np.array([{rows[0]}])"
    return "np.array([\n    " + ",\n    ".join(rows) + ",\n])"


def _quoted(text: str) -> str:
    """Text that is safe inside a docstring."""
    return repr(text).replace('"""', "'''")
