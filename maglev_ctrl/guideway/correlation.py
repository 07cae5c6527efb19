"""What the elements of one vehicle meet of one track: delays along the wheelbase, and what left and right share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only
from maglev_ctrl.guideway.spectra import Roughness


@dataclass(frozen=True, eq=False, slots=True)
class TrackInputs:
    """Guideway inputs as delayed mixtures of the independent processes vertical, cross level and lateral.

    Input i is vertical[i] z(t - delays[i]) + cross_level[i] phi(t - delays[i]) + lateral[i] u(t - delays[i]), with z,
    phi and u what the foremost place meets: m, rad and m.

    Parameters
    ----------
    names : (k,) of the inputs
    delays : (k,) s, not negative, 0 at the foremost place
    vertical, lateral : (k,) weights
    cross_level : (k,) weights, m

    Raises
    ------
    ValueError : wrong shapes, or a negative delay
    """

    names: tuple[str, ...]
    delays: FloatArray
    vertical: FloatArray
    cross_level: FloatArray
    lateral: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        count = len(self.names)
        for label in ("delays", "vertical", "cross_level", "lateral"):
            value = read_only(getattr(self, label), name=label)
            if value.shape != (count,):
                raise ValueError(f"{label}: expected shape ({count},), one for every name, got {value.shape}")
            object.__setattr__(self, label, value)
        if np.any(self.delays < 0.0):
            raise ValueError(f"delays: expected none negative, got {self.delays.tolist()}")

    @property
    def mixing(self) -> FloatArray:
        """(k, 3) weights onto (vertical, cross level, lateral), without the delays."""
        return read_only(np.column_stack([self.vertical, self.cross_level, self.lateral]), name="mixing")

    def transfer(self, frequency: ArrayLike) -> ComplexArray:
        """(..., k, 3) from (vertical, cross level, lateral) to the inputs at frequencies (...) rad/s, delays exact."""
        w = np.asarray(frequency, dtype=np.float64)[..., None, None]
        return np.asarray(np.exp(-1j * w * self.delays[:, None]) * self.mixing)


def track_inputs(names: Sequence[str], places: ArrayLike, *, speed: float) -> TrackInputs:
    """Delays and weights of guideway inputs at their places on the vehicle, at a speed.

    A place x forward and y to the left meets at time t the place v t + x of the track: the vertical displacement there
    is z + y phi with the cross level phi, the lateral one u. The rear lags the front by the wheelbase over the speed.

    Parameters
    ----------
    names : (k,) "heave@<element>" or "sway@<element>"
    places : (k, 2) x, y of each, m
    speed : v, m/s

    Raises
    ------
    ValueError : a name that is neither, a name twice, wrong shapes, or a speed that is not positive

    Examples
    --------
    >>> inputs = track_inputs(["heave@front", "heave@rear", "sway@rear"], [[10, 1], [-10, 1], [-10, 1]], speed=100.0)
    >>> inputs.delays.tolist(), inputs.mixing.tolist()
    ([0.0, 0.2, 0.2], [[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    """
    if not (np.isfinite(speed) and speed > 0.0):
        raise ValueError(f"speed: expected a positive number (m/s), got {speed}")
    labels = tuple(names)
    if not labels:
        raise ValueError("names: expected at least one guideway input, got none")
    if len(set(labels)) != len(labels):
        raise ValueError(f"names: expected every one once, got {labels}")
    place = read_only(places, name="places")
    if place.shape != (len(labels), 2):
        raise ValueError(f"places: expected shape ({len(labels)}, 2), x and y of every name, got {place.shape}")
    kinds = [one.partition("@")[0] for one in labels]
    wrong = [one for one, kind in zip(labels, kinds, strict=True) if kind not in ("heave", "sway") or "@" not in one]
    if wrong:
        raise ValueError(f'names: expected "heave@<element>" or "sway@<element>", got {wrong[0]!r}')
    heave = np.array([kind == "heave" for kind in kinds], dtype=np.float64)
    return TrackInputs(
        labels,
        delays=(np.max(place[:, 0]) - place[:, 0]) / speed,
        vertical=heave,
        cross_level=heave * place[:, 1],
        lateral=1.0 - heave,
    )


def coherence(
    vertical: Roughness, cross_level: Roughness, wavenumber: ArrayLike, *, left: float, right: float
) -> FloatArray:
    """Squared coherence (...) of the vertical displacements at two sides of the track, at wave numbers (...) rad/m.

    With S_z and S_c independent the cross density is S_z + y_l y_r S_c: 1 on one side, and where the vertical part
    vanishes; 0 where S_z = b^2 S_c at y = +-b.

    Parameters
    ----------
    vertical : S_z, m^2/(rad/m)
    cross_level : S_c, rad^2/(rad/m)
    left, right : y of the two sides, m

    Examples
    --------
    >>> from maglev_ctrl.guideway.spectra import inverse_square
    >>> round(float(coherence(inverse_square(4e-6), inverse_square(1e-6), 1.0, left=1.0, right=-1.0)), 12)
    0.36
    """
    first, second = vertical.density(wavenumber), cross_level.density(wavenumber)
    shared = first + left * right * second
    return np.asarray(shared**2 / ((first + left**2 * second) * (first + right**2 * second)))
