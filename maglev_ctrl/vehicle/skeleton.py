"""What the linear model keeps at every operating point: bodies, connections, actuators, names and outputs.

Magnets and their circuits, measured coefficients, air drag and turning forces are left blank in it; `assembly` fills
them in. In the reference posture, where a study meets most of its operating points, it is remembered per vehicle.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate, pairwise

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.systems.second_order import ContributionKind
from maglev_ctrl.vehicle.circuits import magnet_share
from maglev_ctrl.vehicle.kinematics import Stance, level_stance
from maglev_ctrl.vehicle.outputs import OutputRow, coordinate_rows, link_rows, magnet_rows, sensor_rows
from maglev_ctrl.vehicle.shares import Share, actuator_share, body_shares, guideway_inputs, spring_damper_share
from maglev_ctrl.vehicle.structure import KEPT
from maglev_ctrl.vehicle.vehicle import Vehicle


@dataclass(frozen=True, eq=False, slots=True)
class OutputTable:
    """Output matrices, (outputs, *) each; displacements of all coordinates are in, ignorable or not."""

    names: tuple[str, ...]
    H_q: FloatArray
    H_v: FloatArray
    H_a: FloatArray
    H_internal: FloatArray
    H_w: FloatArray
    H_wv: FloatArray

    def without(self, names: tuple[str, ...]) -> OutputTable:
        """The table without some of its outputs."""
        if not names:
            return self
        kept = [i for i, name in enumerate(self.names) if name not in names]
        matrices = (self.H_q, self.H_v, self.H_a, self.H_internal, self.H_w, self.H_wv)
        return OutputTable(tuple(self.names[i] for i in kept), *(matrix[kept] for matrix in matrices))


@dataclass(frozen=True, eq=False, slots=True)
class Skeleton:
    """Shares of e elements, stacked: `M`, `C`, `K` (e, n, n) and `F` (e, n, n_xi), blank where `assembly` fills in.

    Elements stand in the order bodies, magnets, coefficient elements, connections, actuators, air drag, geometry;
    `magnets`, `coefficients`, `air`, `geometry` say where. `draggers` are the air drags that have an element.
    `heave_columns` (m,) and `sway_columns` (of the magnets `walled`) are the magnets' columns of `K_w` and `C_w`.
    `read` (n,): the position of a coordinate enters an output of something other than the coordinate itself.
    """

    names: tuple[str, ...]
    kinds: tuple[ContributionKind, ...]
    M: FloatArray
    C: FloatArray
    K: FloatArray
    F: FloatArray
    magnets: slice
    coefficients: slice
    air: slice
    geometry: slice
    draggers: NDArray[np.int64]
    internal: tuple[str, ...]
    A_internal: FloatArray
    G_v: FloatArray
    inputs: tuple[str, ...]
    B: FloatArray
    B_internal: FloatArray
    guideway: tuple[str, ...]
    K_w: FloatArray
    C_w: FloatArray
    G_wv: FloatArray
    heave_columns: NDArray[np.int64]
    walled: NDArray[np.int64]
    sway_columns: NDArray[np.int64]
    outputs: OutputTable
    read: NDArray[np.bool_]


def skeleton(vehicle: Vehicle, here: Stance, *, pade_order: int, felt: tuple[str, ...]) -> Skeleton:
    """The fixed part of the linear model in a stance.

    Parameters
    ----------
    felt : guideway inputs of the coefficient elements, which depend on the speed
    """
    return _level(vehicle, pade_order, felt) if here.level else _built(vehicle, here, pade_order, felt)


@lru_cache(maxsize=KEPT)
def _level(vehicle: Vehicle, pade_order: int, felt: tuple[str, ...]) -> Skeleton:
    return _built(vehicle, level_stance(vehicle), pade_order, felt)


def _built(vehicle: Vehicle, here: Stance, pade_order: int, felt: tuple[str, ...]) -> Skeleton:
    n, connections = len(vehicle.dofs), len(vehicle.connections)
    draggers = [i for i, air in enumerate(vehicle.aerodynamics) if air.drag_factor > 0.0]
    groups: list[list[Share]] = [
        body_shares(vehicle, here),
        [magnet_share(magnet, n) for magnet in vehicle.magnets],
        [Share(element.name, "magnet", n) for element in vehicle.coefficient_elements],
        [spring_damper_share(e, row) for e, row in zip(vehicle.connections, here.stroke, strict=False)],
        [
            actuator_share(e, row, pade_order=pade_order)
            for e, row in zip(vehicle.actuators, here.stroke[connections:], strict=False)
        ],
        [Share(vehicle.aerodynamics[i].name, "aerodynamics", n) for i in draggers],
        [Share("geometry", "geometry", n)] if vehicle.geometric_stiffness else [],
    ]
    shares = [share for group in groups for share in group]
    parts = [slice(a, b) for a, b in pairwise([0, *accumulate(len(group) for group in groups)])]
    internal = tuple(name for share in shares for name in share.internal)
    guideway = _guideway_names(vehicle, shares, felt)
    walled = [i for i, magnet in enumerate(vehicle.magnets) if magnet.side != 0]
    table, read = _outputs(vehicle, here, internal, guideway)
    return Skeleton(
        names=tuple(share.name for share in shares),
        kinds=tuple(share.kind for share in shares),
        M=read_only_any([share.M for share in shares]),
        C=read_only_any([share.C for share in shares]),
        K=read_only_any([share.K for share in shares]),
        F=read_only_any(_own_columns(shares, n, len(internal))),
        magnets=parts[1],
        coefficients=parts[2],
        air=parts[5],
        geometry=parts[6],
        draggers=read_only_any(np.array(draggers, dtype=np.int64)),
        internal=internal,
        A_internal=read_only_any(_stacked([share.A_internal for share in shares])),
        G_v=read_only_any(np.vstack([share.G_v for share in shares])),
        inputs=tuple(name for share in shares for name in share.inputs),
        B=read_only_any(np.hstack([share.B for share in shares])),
        B_internal=read_only_any(_stacked([_full_inputs(share) for share in shares])),
        guideway=guideway,
        K_w=read_only_any(_guideway_columns([share.K_w for share in shares], guideway, n)),
        C_w=read_only_any(_guideway_columns([share.C_w for share in shares], guideway, n)),
        G_wv=read_only_any(
            np.vstack([_guideway_columns([share.G_wv], guideway, len(share.internal)) for share in shares])
        ),
        heave_columns=_places([f"heave@{magnet.name}" for magnet in vehicle.magnets], guideway),
        walled=read_only_any(np.array(walled, dtype=np.int64)),
        sway_columns=_places([f"sway@{vehicle.magnets[i].name}" for i in walled], guideway),
        outputs=table,
        read=read,
    )


def _outputs(
    vehicle: Vehicle, here: Stance, internal: tuple[str, ...], guideway: tuple[str, ...]
) -> tuple[OutputTable, NDArray[np.bool_]]:
    links = len(vehicle.links)
    rows = [
        *sensor_rows(vehicle, here.stroke[links:]),
        *magnet_rows(vehicle, here.magnet_motion),
        *(row for link, stroke in zip(vehicle.links, here.stroke, strict=False) for row in link_rows(link, stroke)),
    ]
    read = np.array([any(row.H_q[i] for row in rows) for i in range(len(vehicle.dofs))])
    rows += coordinate_rows(vehicle.dofs)
    return _output_table(rows, internal, guideway), read_only_any(read)


def _output_table(rows: list[OutputRow], internal: tuple[str, ...], guideway: tuple[str, ...]) -> OutputTable:
    return OutputTable(
        tuple(row.name for row in rows),
        H_q=read_only_any([row.H_q for row in rows]),
        H_v=read_only_any([row.H_v for row in rows]),
        H_a=read_only_any([row.H_a for row in rows]),
        H_internal=_weights([row.internal for row in rows], internal),
        H_w=_weights([row.guideway for row in rows], guideway),
        H_wv=_weights([row.guideway_rate for row in rows], guideway),
    )


def _guideway_names(vehicle: Vehicle, shares: list[Share], felt: tuple[str, ...]) -> tuple[str, ...]:
    names: list[str] = []
    for magnet in vehicle.magnets:
        names += [f"heave@{magnet.name}"] + [f"sway@{magnet.name}"] * (magnet.side != 0)
    names += felt
    names += [name for share in shares for name in (*share.K_w, *share.C_w, *share.G_wv)]
    for element in (*vehicle.links, *vehicle.sensors):
        names += guideway_inputs(element.name, element.to, element.direction, angular=element.angular)
    return tuple(dict.fromkeys(names))


def _places(wanted: list[str], names: tuple[str, ...]) -> NDArray[np.int64]:
    return read_only_any(np.array([names.index(name) for name in wanted], dtype=np.int64))


def _own_columns(shares: list[Share], n: int, n_internal: int) -> FloatArray:
    """F of every share over all internal states; (e, n, n_xi)."""
    found = np.zeros((len(shares), n, n_internal))
    start = 0
    for i, share in enumerate(shares):
        found[i, :, start : start + len(share.internal)] = share.F
        start += len(share.internal)
    return found


def _stacked(blocks: list[FloatArray]) -> FloatArray:
    """Blocks down the diagonal; empty ones keep their rows or columns."""
    found = np.zeros((sum(len(block) for block in blocks), sum(block.shape[1] for block in blocks)))
    row = column = 0
    for block in blocks:
        found[row : row + len(block), column : column + block.shape[1]] = block
        row, column = row + len(block), column + block.shape[1]
    return found


def _full_inputs(share: Share) -> FloatArray:
    return share.B_internal if share.B_internal.size else np.zeros((len(share.internal), len(share.inputs)))


def _guideway_columns(parts: list[dict[str, FloatArray]], names: tuple[str, ...], rows: int) -> FloatArray:
    total = np.zeros((rows, len(names)))
    for part in parts:
        for name, column in part.items():
            total[:, names.index(name)] += column
    return total


def _weights(parts: list[dict[str, float]], names: tuple[str, ...]) -> FloatArray:
    total = np.zeros((len(parts), len(names)))
    for i, part in enumerate(parts):
        for name, weight in part.items():
            total[i, names.index(name)] = weight
    return read_only_any(total)
