"""What drives a channel, process by process: nodes of equal delay, and inputs referred to the guideway's rate.

With x~ = x + A^-1 E_p w the displacement enters only through its rate: x~' = A x~ + (E_v + A^-1 E_p) w' and
y = C x~ + (D_p - C A^-1 E_p) w + D_v w'. What is left of w is the static response; where it cancels over all inputs, a
displacement without variance is seen through finite windows only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.analysis.response.channels import Process, RideChannel
from maglev_ctrl.analysis.response.weighting import Weighting
from maglev_ctrl.arrays import ComplexArray, FloatArray

STILL = 1e-9
"""A static response below this share of its parts counts as none."""


@dataclass(frozen=True, eq=False, slots=True)
class Observed:
    """An output of a channel, through a weighting where there is one; `label` stands for it in results."""

    output: str
    weighting: Weighting | None = None
    label: str = ""

    @property
    def name(self) -> str:
        """The label, or the output with its weighting."""
        return self.label or (f"{self.output}.{self.weighting.name}" if self.weighting else self.output)


@dataclass(frozen=True, eq=False, slots=True)
class Source:
    """One white noise, its filter to a rate g, and the K delays at which g moves the channel.

    x~' = A x~ + sum e_k g(t - delay_k), y = C x~ + sum d_k g(t - delay_k) + s_k h(t - delay_k), h' = g. The filter is
    (A, B, C_rate, through), with `poles` and `residues`; `static` is its gain at 0 (0 where h has a variance,
    `bounded`), `early` the first slope C_rate B of its answer. `drift` (ny,) says that sum s_k is not zero, `live`
    (ny,) that an output is coupled to the inputs at all.
    """

    name: str
    A: FloatArray
    B: FloatArray
    C_rate: FloatArray
    through: float
    poles: ComplexArray
    residues: ComplexArray
    static: float
    bounded: bool
    early: float
    delays: FloatArray
    e: FloatArray
    d: FloatArray
    s: FloatArray
    drift: NDArray[np.bool_]
    live: NDArray[np.bool_]

    def rate_at(self, point: ComplexArray) -> ComplexArray:
        """Filter from white noise to rate at complex frequencies (n,)."""
        if not len(self.poles):
            return np.full(len(point), self.through, dtype=complex)
        return np.asarray(self.through + (1.0 / (point[:, None] - self.poles)) @ self.residues)


def observed_rows(channel: RideChannel, observed: Sequence[Observed]) -> list[int]:
    """Rows of the channel that are observed.

    Raises
    ------
    ValueError : an output the channel has not
    """
    for one in observed:
        if one.output not in channel.outputs:
            raise ValueError(f"observed: expected outputs of {', '.join(channel.outputs)}, got {one.output!r}")
    return [channel.outputs.index(one.output) for one in observed]


def sources(channel: RideChannel, processes: Sequence[Process]) -> tuple[Source, ...]:
    """Every process and every noise of a channel as a source.

    Raises
    ------
    ValueError : a process knows an input that the channel has not, or has none for one of the channel's
    """
    back = np.linalg.solve(channel.A, channel.E_p) if len(channel.A) else channel.E_p
    rates = channel.E_v + back
    moved = channel.C @ back
    static = channel.D_p - moved
    # What a static response is small beside: its own parts, and what the solution may be wrong by in every entry.
    doubt = _rounding(channel, np.asarray(back, dtype=np.float64)) / STILL
    size = np.abs(channel.D_p) + np.abs(channel.C) @ (np.abs(back) + doubt)
    found = [_process_source(channel, process, rates, static, size) for process in processes if np.any(process.weights)]
    return (*found, *(_noise_source(channel, index) for index in range(len(channel.noises))))


def _rounding(channel: RideChannel, back: FloatArray) -> FloatArray:
    """Bound by entries on the error of A^-1 E_p as solved: eps |A^-1| (|A| |A^-1 E_p| + |E_p|) (Skeel)."""
    if not len(channel.A):
        return np.zeros_like(back)
    reach = np.abs(channel.A) @ np.abs(back) + np.abs(channel.E_p)
    grown: FloatArray = np.abs(np.linalg.inv(channel.A)) @ reach
    return len(channel.A) * float(np.finfo(np.float64).eps) * grown


def process_weights(channel: RideChannel, process: Process) -> tuple[FloatArray, FloatArray]:
    """Delays (K,), increasing, and the mixture (nw, K) of the channel's guideway inputs that meets the process then.

    Raises
    ------
    ValueError : a process knows an input that the channel has not, or has none for one of the channel's
    """
    if set(process.names) != set(channel.guideway):
        known, got = ", ".join(channel.guideway), ", ".join(process.names)
        raise ValueError(f"process {process.name!r}: expected the inputs {known}, got {got}")
    used = [i for i in range(len(process.names)) if process.weights[i] != 0.0]
    order = sorted(used, key=lambda i: float(process.delays[i]))
    nodes: list[float] = []
    columns: list[FloatArray] = []
    # Delays nearer than rounding of their largest are one.
    near = 1e-12 * max((float(process.delays[i]) for i in used), default=0.0)
    for i in order:
        delay = float(process.delays[i])
        if not nodes or delay - nodes[-1] > near:
            nodes.append(delay)
            columns.append(np.zeros(len(channel.guideway)))
        columns[-1][channel.guideway.index(process.names[i])] = process.weights[i]
    return np.array(nodes), np.array(columns).T.reshape(len(channel.guideway), len(nodes))


def _process_source(
    channel: RideChannel, process: Process, rates: FloatArray, static: FloatArray, size: FloatArray
) -> Source:
    delays, mixture = process_weights(channel, process)
    filtered = process.shaping
    met = np.any(mixture, axis=1)
    live = _reached(channel, met)
    s = np.where(live[:, None], static @ mixture, 0.0)
    parts = (size @ np.abs(mixture)).sum(axis=1)
    drift = np.abs(s.sum(axis=1)) > STILL * parts
    s[~drift, -1] -= s[~drift].sum(axis=1)
    poles, residues = _partial_fractions(filtered.A, filtered.B, filtered.C_rate)
    through = float(filtered.D_rate[0, 0])
    bounded = filtered.C is not None
    gain = 0.0
    if not bounded:
        inner = np.linalg.solve(filtered.A, filtered.B) if len(filtered.A) else filtered.B
        gain = through - float((filtered.C_rate @ inner)[0, 0]) if len(filtered.A) else through
    return Source(
        process.name, filtered.A, filtered.B, filtered.C_rate, through, poles, residues, gain, bounded,
        float((filtered.C_rate @ filtered.B)[0, 0]) if len(filtered.A) else 0.0,
        delays, rates @ mixture, channel.D_v @ mixture, s, drift, live,
    )  # fmt: skip


def _reached(channel: RideChannel, met: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Outputs to which a path of entries that are not zero leads from the inputs met."""
    moved = np.any(channel.E_p[:, met], axis=1) | np.any(channel.E_v[:, met], axis=1)
    pattern = channel.A != 0.0
    while True:
        further = moved | (pattern & moved).any(axis=1)
        if np.array_equal(further, moved):
            break
        moved = further
    direct = np.any(channel.D_p[:, met], axis=1) | np.any(channel.D_v[:, met], axis=1)
    return np.asarray(direct | np.any(channel.C[:, moved], axis=1))


def _noise_source(channel: RideChannel, index: int) -> Source:
    outputs = len(channel.outputs)
    nothing = np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0))
    return Source(
        channel.noises[index], *nothing, 1.0, np.zeros(0, dtype=complex), np.zeros(0, dtype=complex), 0.0, True, 0.0,
        np.zeros(1), channel.E_n[:, index : index + 1], channel.D_n[:, index : index + 1], np.zeros((outputs, 1)),
        np.zeros(outputs, dtype=bool), np.ones(outputs, dtype=bool),
    )  # fmt: skip


def _partial_fractions(A: FloatArray, B: FloatArray, C: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    if not len(A):
        return np.zeros(0, dtype=complex), np.zeros(0, dtype=complex)
    poles, vectors = np.linalg.eig(A)
    try:
        residues = (C @ vectors)[0] * np.linalg.solve(vectors, B)[:, 0]
    except np.linalg.LinAlgError:
        residues = np.full(len(A), np.nan)
    return poles.astype(complex), residues.astype(complex)
