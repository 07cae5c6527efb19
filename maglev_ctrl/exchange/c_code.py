"""Sampled laws as plain C99: constant tables, one step function and one reset, no libraries and no heap.

The step computes u = C x + D y and then x+ = A x + B y, so that the command is ready as early as it can be. Numbers are
written with 17 digits, which a C compiler reads back exactly.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.systems import Controller

KEYWORDS = """
    auto break case char const continue default do double else enum extern float for goto if inline int long register
    restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
"""
LINE = 76
_SIGNS = {
    "Y": "changes from the operating point; a stroke is positive where its first end moves up or left",
    "U": "changes from the operating point; a force is positive where it pushes its first end up or left",
}


def c_source(
    controller: Controller,
    name: str,
    *,
    comment: str = "",
    origin: str = "",
    units: Mapping[str, str] | None = None,
) -> tuple[str, str]:
    """Header and source of `void <name>_step(const double *y, double *u)` and `void <name>_reset(void)`.

    Parameters
    ----------
    controller : a sampled law
    name : C identifier, the prefix of all names; the header is included as "<name>.h"
    comment, origin : put at the top of both: what the law is, and the scenario and design text it came from
    units : of measurements and commands, by their names

    Raises
    ------
    ValueError : the law is continuous, or `name` is not a C identifier

    Examples
    --------
    >>> law = Controller.static([[-3.0]], measured=("gap",), commands=("force",), dt=0.001)
    >>> header, source = c_source(law, "hover")
    >>> print(header.splitlines()[-3])
    void hover_step(const double *y, double *u);
    """
    _check(controller, name)
    header = _header(controller, name, comment, origin, units or {}, parameter=None)
    tables = {key: getattr(controller, key) for key in "ABCD"}
    body = [_top(comment, origin), f'#include "{name}.h"', ""]
    body += [_table(key, matrix) for key, matrix in tables.items() if matrix.size]
    body += [*_state(controller), _step(controller, name, parameter=None)]
    return header, "\n".join(body)


def c_scheduled_source(
    nodes: Sequence[tuple[float, Controller]],
    name: str,
    *,
    parameter: str,
    comment: str = "",
    origin: str = "",
    units: Mapping[str, str] | None = None,
) -> tuple[str, str]:
    """Header and source of `void <name>_step(double parameter, const double *y, double *u)`: a law per node.

    Between nodes the matrices A, B, C, D are blended linearly; outside the first and last node the parameter is
    clamped to them (NaN: to the first). The state is common to all nodes.

    Parameters
    ----------
    nodes : (parameter, law), ascending; laws of one size, one sampling period, the same names
    parameter : its name, for the comments; its unit may be in `units`

    Raises
    ------
    ValueError : a law is continuous, nodes are fewer than two, not ascending or do not fit together

    Examples
    --------
    >>> laws = [Controller.static([[k]], measured=("gap",), commands=("force",), dt=0.001) for k in (-3.0, -2.0)]
    >>> header, _ = c_scheduled_source(list(zip((0.0, 50.0), laws)), "hover", parameter="speed")
    >>> "void hover_step(double parameter, const double *y, double *u);" in header
    True
    """
    if len(nodes) < 2:
        raise ValueError("nodes: expected at least two; use c_source for one law")
    at = np.array([value for value, _ in nodes], dtype=float)
    laws = [law for _, law in nodes]
    for law in laws:
        _check(law, name)
    if not np.all(np.isfinite(at)) or np.any(np.diff(at) <= 0.0):
        raise ValueError(f"nodes: expected ascending finite parameters, got {at.tolist()}")
    first = laws[0]
    alike = (first.measured, first.commands, first.dt, first.A.shape)
    if any((law.measured, law.commands, law.dt, law.A.shape) != alike for law in laws):
        raise ValueError("nodes: expected laws with the same names, sampling period and number of states")
    header = _header(first, name, comment, origin, units or {}, parameter=(parameter, at))
    body = [_top(comment, origin), f'#include "{name}.h"', ""]
    body.append(f"/* nodes of {_plain(parameter)}, ascending */\n#define NODES {len(at)}")
    body.append(f"static const double node[NODES] = {{{_numbers(at)}}};\n")
    for key in "ABCD":
        stack = np.stack([getattr(law, key) for law in laws])
        if stack.size:
            body.append(_table(key, stack))
    body += [*_state(first), _step(first, name, parameter=parameter)]
    return header, "\n".join(body)


def _check(controller: Controller, name: str) -> None:
    if controller.dt is None:
        raise ValueError(f"controller: {controller.name!r} is continuous; give a sampling rate and discretise it first")
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) or name in KEYWORDS.split():
        raise ValueError(f"name: expected a C identifier, got {name!r}")
    if not (controller.measured and controller.commands):
        raise ValueError("controller: expected at least one measurement and one command")


def _header(
    law: Controller,
    name: str,
    comment: str,
    origin: str,
    units: Mapping[str, str],
    *,
    parameter: tuple[str, FloatArray] | None,
) -> str:
    upper = name.upper()
    unit = {key: f", {_plain(value)}" for key, value in units.items()}
    lines = [_top(comment, origin), f"#ifndef {upper}_H", f"#define {upper}_H", ""]
    lines.append(f"#define {upper}_DT {_number(law.dt or 0.0)} /* sampling period, s: call the step once per period */")
    lines.append("")
    for key, names, what in (("Y", law.measured, "measurements"), ("U", law.commands, "commands")):
        lines.append(f"/* {what}; {_SIGNS[key]} */")
        lines.append("enum {")
        for index, (label, full) in enumerate(zip(_labels(names), names, strict=True)):
            lines.append(f"    {upper}_{key}_{label} = {index}, /* {_plain(full)}{unit.get(full, '')} */")
        lines.append(f"    {upper}_{key}_COUNT = {len(names)}")
        lines.append("};\n")
    lines.append("/* to the state of rest; the state is at rest before the first step */")
    lines.append(f"void {name}_reset(void);\n")
    lines.append("/* one period: commands u from measurements y */")
    argument = ""
    if parameter is not None:
        label, at = parameter
        lines[-1] = (
            f"/* one period: commands u from measurements y at the parameter {_plain(label)}{unit.get(label, '')};\n"
            f"   laws are blended linearly between {len(at)} nodes and clamped to {_number(at[0])} and "
            f"{_number(at[-1])} outside */"
        )
        argument = "double parameter, "
    lines.append(f"void {name}_step({argument}const double *y, double *u);")
    lines.append("")
    lines.append("#endif")
    return "\n".join(lines) + "\n"


def _state(law: Controller) -> list[str]:
    return [f"\nstatic double x[{len(law.A)}]; /* state of the law */"] if len(law.A) else []


def _step(law: Controller, name: str, *, parameter: str | None) -> str:
    """The two functions; loops over compile-time sizes, and local results, so that y and u may share memory."""
    n, p, m = len(law.A), len(law.measured), len(law.commands)
    scheduled = parameter is not None
    argument = "double parameter, " if scheduled else ""
    lines = ["", f"void {name}_reset(void)", "{"]
    lines += ["    int i;", f"    for (i = 0; i < {n}; i++)", "        x[i] = 0.0;"] if n else []
    lines += ["}", "", f"void {name}_step({argument}const double *y, double *u)", "{"]
    lines += ["    int i, j;", f"    double command[{m}];"]
    lines += [f"    double next[{n}];"] if n else []
    if scheduled:
        lines += [
            "    int k = 0;", "    double share;",
            "    if (!(parameter > node[0]))", "        parameter = node[0];",
            "    if (parameter > node[NODES - 1])", "        parameter = node[NODES - 1];",
            "    while (k < NODES - 2 && parameter > node[k + 1])", "        k++;",
            "    share = (parameter - node[k]) / (node[k + 1] - node[k]);",
        ]  # fmt: skip
    for target, rows, matrices in (("command", m, "CD"), ("next", n, "AB")):
        if not rows:
            continue
        lines += [f"    for (i = 0; i < {rows}; i++) {{", "        double sum = 0.0;"]
        for key, columns, source in ((matrices[0], n, "x"), (matrices[1], p, "y")):
            if not columns:
                continue
            entry = f"{key}[i][j]"
            if scheduled:
                entry = f"((1.0 - share) * {key}[k][i][j] + share * {key}[k + 1][i][j])"
            lines += [f"        for (j = 0; j < {columns}; j++)", f"            sum += {entry} * {source}[j];"]
        lines += [f"        {target}[i] = sum;", "    }"]
    lines += [f"    for (i = 0; i < {m}; i++)", "        u[i] = command[i];"]
    lines += [f"    for (i = 0; i < {n}; i++)", "        x[i] = next[i];"] if n else []
    lines += ["}", ""]
    return "\n".join(lines)


def _table(key: str, matrix: FloatArray) -> str:
    shape = "".join(f"[{size}]" for size in matrix.shape)
    return f"static const double {key}{shape} = {_nested(matrix, 1)};"


def _nested(matrix: FloatArray, depth: int) -> str:
    if matrix.ndim == 1:
        return "{" + _numbers(matrix) + "}"
    indent = "    " * depth
    inner = f",\n{indent}".join(_nested(part, depth + 1) for part in matrix)
    return "{\n" + indent + inner + "\n" + "    " * (depth - 1) + "}"


def _numbers(values: FloatArray) -> str:
    lines, line = [], ""
    for text in (_number(float(value)) for value in values):
        if line and len(line) + len(text) > LINE:
            lines.append(line)
            line = ""
        line = f"{line}, {text}" if line else text
    return ",\n        ".join([*lines, line])


def _number(value: float) -> str:
    text = format(value, ".17g")
    return text if any(mark in text for mark in ".e") else f"{text}.0"


def _labels(names: Sequence[str]) -> list[str]:
    """Names as parts of identifiers, all different."""
    found: list[str] = []
    for name in names:
        label = re.sub(r"[^A-Z0-9]+", "_", name.upper()).strip("_") or "SIGNAL"
        unique, count = label, 2
        while unique in found or unique == "COUNT":
            unique, count = f"{label}_{count}", count + 1
        found.append(unique)
    return found


def _top(comment: str, origin: str) -> str:
    parts = [text for text in (comment, f"Generated from:\n{origin}" if origin else "") if text]
    if not parts:
        return "/* Sampled control law. Generated: do not edit. */"
    lines = _plain("\n\n".join(parts), keep_lines=True).splitlines()
    return "/*\n" + "\n".join(f" * {line}".rstrip() for line in lines) + "\n *\n * Generated: do not edit.\n */"


def _plain(text: str, *, keep_lines: bool = False) -> str:
    """Text that cannot end a comment, open one, or continue a line: ASCII only."""
    safe = text.replace("*/", "* /").replace("/*", "/ *").replace("\\\n", "\\ \n").replace("??/", "? ?/")
    safe = safe if keep_lines else " ".join(safe.split())
    ascii_only = safe.encode("ascii", "backslashreplace").decode("ascii")
    return "\n".join(line + " " if line.endswith("\\") else line for line in ascii_only.split("\n"))
