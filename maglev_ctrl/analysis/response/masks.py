"""Power spectral densities against masks, looked at closely enough that no resonance is missed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from maglev_ctrl.analysis.response.channels import Process, RideChannel
from maglev_ctrl.analysis.response.frequency import response_edges, spectral_density
from maglev_ctrl.analysis.response.records import PsdMask
from maglev_ctrl.analysis.response.sources import Observed
from maglev_ctrl.arrays import FloatArray, read_only

PER_DECADE = 120


def worst_over_mask(
    channel: RideChannel, processes: Sequence[Process], output: str, mask: PsdMask
) -> tuple[float, float, int]:
    """Largest ratio of an output's density to a mask, its frequency (Hz), and how many frequencies were looked at.

    The grid has `PER_DECADE` points a decade, points around every resonance and four for every beat of the longest
    delay; the five highest peaks are then closed in on.

    Raises
    ------
    ValueError : the channel has no such output

    Examples
    --------
    >>> from maglev_ctrl.analysis.response.channels import Signal, ride_channel, track_processes
    >>> from maglev_ctrl.guideway.correlation import track_inputs
    >>> from maglev_ctrl.guideway.shaping import shaping_filter
    >>> from maglev_ctrl.guideway.spectra import inverse_square
    >>> from maglev_ctrl.systems import SecondOrderSystem
    >>> cart = SecondOrderSystem.from_matrices([[1.0]], [[1e-3]], [[(2 * np.pi) ** 2]], guideway=("heave@leg",),
    ...     K_w=[[(2 * np.pi) ** 2]], outputs=("a",), H_a=[[1.0]])
    >>> rough = shaping_filter(inverse_square(1e-6), speed=100.0)
    >>> track = track_processes(track_inputs(["heave@leg"], [[0.0, 0.0]], speed=100.0), vertical=rough)
    >>> flat = PsdMask("flat", "vertical", [0.5, 2.0], [1.0, 1.0])
    >>> round(worst_over_mask(ride_channel(cart, None, [Signal.of("a")]), track, "a", flat)[1], 6)
    1.0
    """
    points = np.asarray(mask.frequency, dtype=np.float64)
    low, high = float(points[0]), float(points[-1])
    watched = [Observed(output)]

    def ratio(frequency: FloatArray) -> FloatArray:
        return np.asarray(spectral_density(channel, processes, watched, frequency)[0] / mask.at(frequency))

    steps = int(np.ceil(PER_DECADE * np.log10(high / low))) + 2
    near = response_edges(channel, processes, watched, band=(low, high)) / (2.0 * np.pi)
    pieces = [np.geomspace(low, high, steps), points]
    pieces += [near[:-1] + share * np.diff(near) for share in (0.0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875)]
    grid = np.unique(np.clip(np.concatenate(pieces), low, high))
    values = ratio(grid)
    best = int(np.argmax(values))
    worst, at, looked = float(values[best]), float(grid[best]), len(grid)
    inner = np.concatenate([[-np.inf], values, [-np.inf]])
    tops = np.flatnonzero((values >= inner[:-2]) & (values >= inner[2:]))
    for top in tops[np.argsort(-values[tops])][:5]:
        left, right = grid[max(top - 1, 0)], grid[min(top + 1, len(grid) - 1)]
        for _ in range(6):
            fine = np.linspace(left, right, 17)
            found = ratio(fine)
            looked += len(fine)
            k = int(np.argmax(found))
            if found[k] > worst:
                worst, at = float(found[k]), float(fine[k])
            left, right = fine[max(k - 1, 0)], fine[min(k + 1, 16)]
    return worst, at, looked


def third_octave_grid(low: float, high: float, *, per_band: int = 10) -> FloatArray:
    """Frequencies (Hz) from the lower edge of the one-third-octave band of `low` to the upper edge of that of `high`.

    Bands are those of base ten (IEC 61260-1), centres 10^(n/10), edges 10^((2n +- 1)/20); every band holds a whole
    number of steps, `per_band`.

    Raises
    ------
    ValueError : frequencies that are not positive and in order

    Examples
    --------
    >>> third_octave_grid(1.0, 1.0, per_band=2).round(4).tolist()
    [0.8913, 1.0, 1.122]
    """
    if not 0.0 < low <= high or per_band < 1:
        raise ValueError(f"low, high: expected 0 < low <= high in Hz, got {low} and {high}")
    first, last = (round(10.0 * np.log10(f)) for f in (low, high))
    count = (last - first + 1) * per_band
    return read_only(10.0 ** (np.linspace(2 * first - 1, 2 * last + 1, count + 1) / 20.0), name="grid")
