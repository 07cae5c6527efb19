"""The numbers behind the eigenvalue figures, Table 1 and the figures over speed, one column a quantity."""

from __future__ import annotations

import numpy as np

from maglev_ctrl.arrays import read_only_any
from maglev_ctrl.study.paper.double_l import root
from maglev_ctrl.study.paper.records import MODELS, DataTable, EigenSweep, ModeTable, SpeedStudy


def eigen_table(sweep: EigenSweep) -> DataTable:
    """omega_R + i omega_I = sqrt(lambda) of the three modes over a sweep.

    Parameters
    ----------
    sweep : of one figure with one model
    """
    omega = root(sweep.squared)
    columns = ["h (mm)" if sweep.parameter == "height" else "lateral offset (mm)"]
    values = [1e3 * sweep.values]
    for k in range(omega.shape[1]):
        columns += [f"mode {k + 1} omega_R (1/s)", f"mode {k + 1} omega_I (1/s)"]
        values += [omega[:, k].real, omega[:, k].imag]
    return DataTable(f"{sweep.key}_model_{sweep.model}", tuple(columns), read_only_any(np.column_stack(values)))


def mode_data_table(modes: tuple[ModeTable, ...]) -> DataTable:
    """Table 1: one row per height, model and mode; the model by its number in P, C, CG."""
    columns = ["h (mm)", "model (0 P, 1 C, 2 CG)", "mode", "omega^2 re (1/s^2)", "omega^2 im (1/s^2)"]
    columns += [f"v{i} {part}" for i in (1, 2, 3) for part in ("re", "im")]
    rows = []
    for table in modes:
        for k in range(3):
            parts = [part for entry in table.vectors[:, k] for part in (entry.real, entry.imag)]
            square = table.squared[k]
            rows.append([1e3 * table.height, MODELS.index(table.model), k + 1, square.real, square.imag, *parts])
    return DataTable("table1_mode_vectors", tuple(columns), read_only_any(np.array(rows)))


def speed_tables(speeds: SpeedStudy | None) -> tuple[DataTable, ...]:
    """Forces over speed and unsteady damping; none where the force model knows one speed only."""
    if speeds is None:
        return ()
    forces = DataTable(
        "forces_over_speed", ("v (m/s)", "F_L (N)", "F_D (N)"),
        read_only_any(np.column_stack([speeds.speed, speeds.lift, speeds.drag])),
    )  # fmt: skip
    if not speeds.unsteady_speed.size:
        return (forces,)
    columns = ("v (m/s)", "c surge (N s/m)", "c sway (N s/m)", "c heave (N s/m)")
    damping = np.column_stack([speeds.unsteady_speed, speeds.damping])
    return forces, DataTable("unsteady_damping_over_speed", columns, read_only_any(damping))
