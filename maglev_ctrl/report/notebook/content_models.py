"""What a notebook shows of models and laws: systems, controllers, designs, vehicles, scenarios."""

from __future__ import annotations

from typing import Final

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import Agreement, Verdict
from maglev_ctrl.report.content_option import controller_table
from maglev_ctrl.report.model import Banner, Block, Bullets, Cell, Paragraph, Table, cell, row
from maglev_ctrl.report.notebook.charts import eigenvalue_chart
from maglev_ctrl.report.notebook.content import MOST_ROWS, blocks_of, fact_table, figure, left_out
from maglev_ctrl.report.style import ABSENT, number
from maglev_ctrl.report.values import with_prefix
from maglev_ctrl.scenario.scenario_schema import Scenario
from maglev_ctrl.scenario.words import describe_option
from maglev_ctrl.synthesis.design import Certificate, Design
from maglev_ctrl.systems import Controller, PeriodicSystem, SecondOrderSystem
from maglev_ctrl.vehicle.vehicle import Vehicle

_MOST_COLUMNS: Final = 8


@blocks_of.register
def _system(system: SecondOrderSystem) -> list[Block]:
    batch = np.broadcast_shapes(*(getattr(system, key).shape[:-2] for key in ("M", "C", "K")))
    facts: list[tuple[str, str | Verdict]] = [
        ("Coordinates", _names(system.dofs)), ("Internal states", _names(system.internal)),
        ("Inputs", _names(system.inputs)), ("Guideway displacements", _names(system.guideway)),
        ("Outputs", _names(system.outputs)), ("Ignorable coordinates", _names(system.ignorable)),
        ("Shares", _names(tuple(share.name for share in system.contributions))),
    ]  # fmt: skip
    if batch:
        facts.append(("Stack", " x ".join(str(size) for size in batch)))
    blocks: list[Block] = [fact_table("Second-order system M q'' + C q' + K q = forces, left-hand side", facts)]
    if batch or len(system.dofs) > _MOST_COLUMNS:
        return blocks
    for key, words, unit in (("M", "Mass", "kg, kg m²"), ("C", "Damping", "N s/m"), ("K", "Stiffness", "N/m")):
        blocks.append(
            _matrix(f"{words} matrix {key} ({unit} and their rotational kin)", system.dofs, getattr(system, key))
        )
    return blocks


def _names(names: tuple[str, ...]) -> str:
    shown = ", ".join(names[:MOST_ROWS])
    return f"{len(names)}: {shown}{', ...' if len(names) > MOST_ROWS else ''}" if names else "none"


def _matrix(
    caption: str, names: tuple[str, ...], matrix: FloatArray, *, columns: tuple[str, ...] | None = None
) -> Table:
    heads = ("", *(columns if columns is not None else names))
    rows = tuple(
        row(name, *(number(float(value), digits=4) for value in line)) for name, line in zip(names, matrix, strict=True)
    )
    return Table(caption, heads, rows, right=tuple(range(1, len(heads))))


@blocks_of.register
def _periodic(system: PeriodicSystem) -> list[Block]:
    size = float(np.linalg.norm(system.A_0))
    rows = tuple(
        row(str(k + 1), number(float(np.linalg.norm(cosine)) / size), number(float(np.linalg.norm(sine)) / size))
        for k, (cosine, sine) in enumerate(zip(system.A_cos, system.A_sin, strict=True))
    ) if system.A_cos.ndim == 3 and size > 0.0 else ()  # fmt: skip
    frequency = float(np.max(system.frequency))
    facts: list[tuple[str, str | Verdict]] = [
        ("States", _names(system.states) if system.states else str(system.A_0.shape[-1])),
        ("Frequency", number(frequency / (2.0 * np.pi), "Hz")), ("Period", number(2.0 * np.pi / frequency, "s")),
    ]  # fmt: skip
    blocks: list[Block] = [fact_table("Periodic system x' = A(t) x", facts)]
    heads = ("Harmonic", "Cosine part over mean", "Sine part over mean")
    return [*blocks, Table("Size of the modulation (Frobenius norms)", heads, rows, right=(1, 2))] if rows else blocks


@blocks_of.register
def _controller(law: Controller) -> list[Block]:
    facts: list[tuple[str, str | Verdict]] = [
        ("Measures", _names(law.measured)), ("Commands", _names(law.commands)), ("Order", str(len(law.states))),
        ("Sampling", "continuous time" if law.dt is None else f"every {number(law.dt, 's')}"),
    ]  # fmt: skip
    blocks: list[Block] = [fact_table(f"Controller {law.name}: u = K y, the sign of the feedback is inside", facts)]
    if law.states:
        return blocks
    if law.D.shape[1] <= _MOST_COLUMNS:
        return [*blocks, _matrix("Gains (SI)", law.commands, law.D, columns=law.measured)]
    pairs = sorted(np.argwhere(law.D), key=lambda place: -abs(float(law.D[place[0], place[1]])))
    rows = tuple(
        row(law.commands[i], law.measured[j], number(float(law.D[i, j]), digits=5)) for i, j in pairs[:MOST_ROWS]
    )
    caption = f"Gains (SI), largest first{left_out(len(pairs))}"
    return [*blocks, Table(caption, ("Command", "Measured", "Gain"), rows, right=(2,))]


@blocks_of.register
def _certificate(found: Certificate) -> list[Block]:
    told = "; ".join(found.disagreements) or "; ".join(found.methods)
    facts: list[tuple[str, str | Verdict]] = [
        ("Spectral abscissa", number(found.spectral_abscissa, "1/s")),
        ("Lyapunov proof residual (proof below 1)", number(found.lyapunov_residual)),
        ("Two closings: relative difference of eigenvalues", number(found.eigenvalue_difference)),
        ("Least singular value of I + D", number(found.smallest_return_difference)), ("Checks", told),
    ]  # fmt: skip
    return [_proof_banner("Closed loop", found), fact_table("Evidence about the closed loop", facts),
            *_poles(found, "the closed loop")]  # fmt: skip


def _proof_banner(what: str, found: Certificate) -> Banner:
    """Proved, refuted, or neither: what the checks do not agree on is not told as a failure."""
    if found.stable:
        return Banner(Verdict.PASS, f"{what}: proved stable.")
    if found.agreed is Agreement.AGREED:
        return Banner(Verdict.FAIL, f"{what}: not stable.")
    return Banner(Verdict.NOT_EVALUATED, f"{what}: UNRESOLVED: {'; '.join(found.disagreements)}.")


def _poles(found: Certificate, what: str) -> list[Block]:
    poles = found.closed_loop_eigenvalues
    return figure(eigenvalue_chart(poles, (), key="closed-loop", what=what)) if poles.size else []


@blocks_of.register
def _design(design: Design) -> list[Block]:
    blocks: list[Block] = [_proof_banner(design.law, design.certificate), controller_table(design, design.name)]
    if design.synthesis is not None and design.synthesis.proofs:
        rows = tuple(
            (cell(proof.statement), cell(Verdict.PASS if proof.holds else Verdict.FAIL), cell(number(proof.margin)),
             cell(proof.method if proof.holds else proof.reason))
            for proof in design.synthesis.proofs
        )  # fmt: skip
        blocks.append(Table("Claims and their proofs", ("Claim", "Proved", "Margin", "By"), rows, right=(2,)))
    blocks += [Bullets(design.notes)] if design.notes else []
    return [*blocks, *_poles(design.certificate, f"the loop closed with {design.name}")]


@blocks_of.register
def _vehicle(vehicle: Vehicle) -> list[Block]:
    bodies = tuple(
        row(body.name, number(body.mass, "kg", digits=4), ", ".join(body.dofs), _place(body.position))
        for body in vehicle.bodies[:MOST_ROWS]
    )  # fmt: skip
    blocks: list[Block] = [
        Table(f"Bodies of {vehicle.name}{left_out(len(vehicle.bodies))}; together "
              f"{number(vehicle.mass, 'kg', digits=4)}", ("Body", "Mass", "Moves in", "At (m)"), bodies, right=(1,))
    ]  # fmt: skip
    rows: list[tuple[Cell, ...]] = [
        row(m.name, "magnet", m.body, ABSENT, number(m.count), ABSENT) for m in vehicle.magnets
    ]
    for one in vehicle.connections:
        rate = f"{with_prefix(one.stiffness, 'N/m')}, {with_prefix(one.damping, 'N s/m')}"
        rows.append(row(one.name, "spring-damper", one.body, one.to, ABSENT, rate))
    for actuator in vehicle.actuators:
        limit = ABSENT if actuator.force_limit is None else f"limit {with_prefix(actuator.force_limit, 'N')}"
        rows.append(row(actuator.name, "actuator", actuator.body, actuator.to, ABSENT, limit))
    rows += [row(s.name, f"sensor of {s.kind}", s.body, s.to or ABSENT, ABSENT, ABSENT) for s in vehicle.sensors]
    if rows:
        heads = ("Element", "Kind", "On", "To", "Count", "Values")
        caption = f"Elements{left_out(len(rows))}; reference height {number(1e3 * vehicle.reference_height, 'mm')}"
        blocks.append(Table(caption, heads, tuple(rows[:MOST_ROWS]), right=(4,)))
    return blocks


def _place(position: tuple[float, ...]) -> str:
    return ", ".join(number(float(value)) for value in position)


@blocks_of.register
def _scenario(scenario: Scenario) -> list[Block]:
    at = scenario.operating
    facts: list[tuple[str, str | Verdict]] = [
        ("Design speed", number(at.speed * 3.6, "km/h")), ("Height", number(1e3 * at.height, "mm")),
        ("Forces", scenario.forces.model), ("Requirements", str(len(scenario.judged))),
        ("Periodic forcing", "yes" if scenario.periodic is not None else "none asked for"),
    ]  # fmt: skip
    options = tuple(
        row(option.name, option.label, "; ".join(describe_option(scenario, option))) for option in scenario.options
    )
    words = " ".join(scenario.description.split())
    told: list[Block] = [Paragraph(words if len(words) <= 600 else f"{words[:597]}...")] if words else []
    limits = tuple(row(one.name, one.quantity) for one in scenario.judged)
    return [
        fact_table(scenario.title, facts), *told,
        Table("Suspension options", ("Name", "Label", "What it is"), options),
        *([Table("Requirements", ("Name", "Quantity"), limits)] if limits else []),
    ]  # fmt: skip
