"""Margins where a loop can be broken: at the plant's inputs, at its outputs (the sensors), and at both at once.

Every disk margin is given for several skews side by side, and its worst perturbation is put back into the loop: how
far the pole then lies from the axis is a number. Peaks of S come with the zones of ISO 14839-3.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from maglev_ctrl.analysis.common_delay import CommonDelay, common_delay_margin
from maglev_ctrl.analysis.disk import DiskMargin, multi_loop_disk
from maglev_ctrl.analysis.hamiltonian import PeakGain, peak_gain
from maglev_ctrl.analysis.loops import Loop, balanced
from maglev_ctrl.analysis.margins import Margins, loop_margins
from maglev_ctrl.analysis.replay import Factor, all_nominal, pole_near
from maglev_ctrl.analysis.stability_gate import close
from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.systems import Controller, SecondOrderSystem

Site = Literal["input", "output", "both"]
Zone = Literal["A", "B", "C", "D"]
ZONE_SOURCE = "ISO 14839-3:2006, Sec. 7: largest |S| at each sensor, zone limits 3, 4, 5 (9.5, 12, 14 dB)"
_ZONE_LIMITS: tuple[tuple[float, Zone], ...] = ((3.0, "A"), (4.0, "B"), (5.0, "C"))


@dataclass(frozen=True, eq=False, slots=True)
class SiteMargins:
    """Margins with the loop broken at one site.

    `margins` one channel at a time and all at once, balanced; `skewed` the disk margins of all channels at once for
    each skew in `sigmas`; `pole_distances` how far from the axis the pole lies with the worst perturbation of each
    put back, relative to its modulus (NaN where there is none); `zones` by the peak of S of every channel.
    """

    site: Site
    margins: Margins
    sigmas: tuple[float, ...]
    skewed: tuple[DiskMargin, ...]
    pole_distances: FloatArray
    zones: tuple[Zone, ...]


@dataclass(frozen=True, eq=False, slots=True)
class MarginSites:
    """Margins of one closed loop at every site, its common delay margin, and peaks of K S.

    `command_peaks` (m, p) are the largest gains from a disturbance of each measured signal to each command (command
    units per measured unit), at `command_frequencies` (rad/s).
    """

    input: SiteMargins
    output: SiteMargins
    both: SiteMargins
    common_delay: CommonDelay
    commands: tuple[str, ...]
    measured: tuple[str, ...]
    command_peaks: FloatArray
    command_frequencies: FloatArray

    @property
    def sites(self) -> tuple[SiteMargins, SiteMargins, SiteMargins]:
        """Input, output, both."""
        return self.input, self.output, self.both


def sensitivity_zone(peak: float) -> Zone:
    """Zone of ISO 14839-3 (magnetic bearings) for the largest |S| of one loop: A below 3, B below 4, C below 5, else D.

    A: newly commissioned machines; B: unrestricted long-term operation; C: limited time; D: damage must be feared.

    Raises
    ------
    ValueError : a peak that is negative or not a number

    Examples
    --------
    >>> [sensitivity_zone(peak) for peak in (1.2, 3.0, 4.9, float("inf"))]
    ['A', 'B', 'C', 'D']
    """
    if np.isnan(peak) or peak < 0.0:
        raise ValueError(f"peak: expected the largest |S|, a number that is not negative, got {peak!r}")
    return next((zone for limit, zone in _ZONE_LIMITS if peak < limit), "D")


def loop_at(system: SecondOrderSystem, controller: Controller, site: Site) -> Loop:
    """Return ratio of a closed loop broken at a site, negative feedback; its delays are those the system carries.

    States are the system's, then the controller's. Broken at both, the channels are commands and measured signals.

    Raises
    ------
    ValueError : an unknown site, a sampled controller, names the system does not have

    Examples
    --------
    >>> plant = SecondOrderSystem.from_matrices([[1.0]], [[0.0]], [[4.0]], inputs=("force",), B=[[1.0]])
    >>> law = Controller.static([[-0.5]], measured=("q1.velocity",), commands=("force",))
    >>> loop_at(plant, law, "both").channels
    ('force', 'q1.velocity')
    """
    if controller.dt is not None:
        raise ValueError(f"controller: {controller.name!r} is sampled; break its loop in discrete time")
    unknown = [name for name in controller.commands if name not in system.inputs]
    if unknown:
        raise ValueError(f"command: {unknown[0]!r} is not an input; the inputs are {', '.join(system.inputs)}")
    columns = [system.inputs.index(name) for name in controller.commands]
    A, B = system.state_matrix(), system.input_matrix()[:, columns]
    C, D, _ = system.output_rows(controller.measured)
    D = D[:, columns]
    A_k, B_k, C_k, D_k = controller.A, controller.B, controller.C, controller.D
    n, n_k, m, p = A.shape[0], A_k.shape[0], B.shape[1], C.shape[0]
    match site:
        case "input":
            return balanced(Loop.from_system(system, controller))
        case "output":
            whole = np.block([[A, B @ C_k], [np.zeros((n_k, n)), A_k]])
            into, out = np.vstack([B @ D_k, B_k]), -np.hstack([C, D @ C_k])
            return balanced(Loop(whole, into, out, -D @ D_k, controller.measured))
        case "both":
            whole = np.block([[A, np.zeros((n, n_k))], [np.zeros((n_k, n)), A_k]])
            into = np.block([[B, np.zeros((n, p))], [np.zeros((n_k, m)), B_k]])
            out = -np.block([[np.zeros((m, n)), C_k], [C, np.zeros((p, n_k))]])
            through = -np.block([[np.zeros((m, m)), D_k], [D, np.zeros((p, p))]])
            names = controller.commands + tuple(
                f"{name} (measured)" if name in controller.commands else name for name in controller.measured
            )
            return balanced(Loop(whole, into, out, through, names))
        case _:
            raise ValueError(f"site: expected input, output or both, got {site!r}")


def site_margins(loop: Loop, site: Site, *, sigmas: tuple[float, ...] = (-1.0, 0.0, 1.0)) -> SiteMargins:
    """Margins of a loop, its disk margins for several skews, the replayed poles and the zones of its peaks of S.

    Raises
    ------
    NotStable, ModelError : what `loop_margins` raises

    Examples
    --------
    >>> loop = Loop.from_transfer_function([25.0], [1.0, 10.0, 10.0, 10.0])
    >>> found = site_margins(loop, "input")
    >>> [round(disk.alpha, 4) for disk in found.skewed], found.zones
    ([0.4864, 0.4581, 0.4021], ('A',))
    """
    margins = loop_margins(loop)
    closed = close(loop)
    seeds = tuple(one.disk.frequency for one in margins.channels)
    seeds = tuple(w for w in seeds if np.isfinite(w)) if loop.dt is None else ()
    skewed = tuple(
        margins.multi_loop if sigma == margins.sigma else multi_loop_disk(closed, sigma=sigma, seeds=seeds)
        for sigma in sigmas
    )
    return SiteMargins(
        site=site,
        margins=margins,
        sigmas=sigmas,
        skewed=skewed,
        pole_distances=read_only_any(np.array([pole_distance(closed.loop, disk) for disk in skewed])),
        zones=tuple(sensitivity_zone(one.sensitivity_peak) for one in margins.channels),
    )


def pole_distance(loop: Loop, disk: DiskMargin) -> float:
    """Distance from the axis of the pole of the exact loop with the worst perturbation put back, over its modulus.

    The perturbation is its real all-pass form. NaN where nothing destabilises or the frequency is infinite.

    Raises
    ------
    ValueError : the margin is not one of all channels of the loop
    """
    if len(disk.dynamics) != len(loop.channels):
        raise ValueError(f"disk: expected a margin of {len(loop.channels)} channels, got {len(disk.dynamics)}")
    if not (np.isfinite(disk.frequency) and np.all(np.isfinite(disk.perturbation))):
        return np.nan
    factors = all_nominal(len(loop.channels))
    for k, dynamics in enumerate(disk.dynamics):
        factors[k] = Factor(disk=dynamics, sigma=disk.sigma)
    start = 1j * disk.frequency if loop.dt is None else complex(np.exp(1j * disk.frequency * loop.dt))
    pole = pole_near(loop, start, tuple(factors)).pole
    if loop.dt is not None:
        return float(abs(abs(pole) - 1.0))
    scale = abs(pole) if disk.frequency > 0.0 else float(np.max(np.abs(np.linalg.eigvals(loop.A)), initial=1.0))
    return float(abs(pole.real) / scale)


def margin_sites(
    system: SecondOrderSystem, controller: Controller, *, sigmas: tuple[float, ...] = (-1.0, 0.0, 1.0)
) -> MarginSites:
    """Margins of a closed loop at its inputs, at its outputs and at both, with the common delay margin and K S.

    Raises
    ------
    NotStable, ModelError : what `loop_margins` raises
    ValueError : what `loop_at` refuses

    Examples
    --------
    >>> plant = SecondOrderSystem.from_matrices([[1.0]], [[0.2]], [[4.0]], inputs=("force",), B=[[1.0]])
    >>> law = Controller.static([[-1.0]], measured=("q1.velocity",), commands=("force",))
    >>> found = margin_sites(plant, law)
    >>> round(found.both.skewed[1].alpha, 4) <= round(found.input.skewed[1].alpha, 4), found.input.zones
    (True, ('A',))
    """
    loops = {site: loop_at(system, controller, site) for site in ("input", "output", "both")}
    at_input, at_output, at_both = (
        site_margins(loops["input"], "input", sigmas=sigmas),
        site_margins(loops["output"], "output", sigmas=sigmas),
        site_margins(loops["both"], "both", sigmas=sigmas),
    )
    peaks = _command_peaks(loops["both"], len(controller.commands))
    return MarginSites(
        input=at_input,
        output=at_output,
        both=at_both,
        common_delay=common_delay_margin(loops["input"]),
        commands=controller.commands,
        measured=controller.measured,
        command_peaks=read_only_any(np.array([[peak.lower for peak in row] for row in peaks])),
        command_frequencies=read_only_any(np.array([[peak.frequency for peak in row] for row in peaks])),
    )


def _command_peaks(both: Loop, commands: int) -> list[list[PeakGain]]:
    """K S: with e = (u, y) and e = r - L e, the entries of (I + L)^-1 from what is added to y to u."""
    closed = close(both)
    m, total = commands, closed.D.shape[0]
    return [
        [
            peak_gain(closed.A, closed.B[:, j : j + 1], closed.C[i : i + 1], closed.D[i : i + 1, j : j + 1])
            for j in range(m, total)
        ]
        for i in range(m)
    ]
