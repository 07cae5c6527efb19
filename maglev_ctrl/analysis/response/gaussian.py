"""What standard deviations of a stationary Gaussian signal say about crossings, contact, saturation and power."""

from __future__ import annotations

from math import asin, erfc, exp, expm1, pi, sqrt

SECONDS_PER_HOUR = 3600.0


def crossing_rate(deviation: float, rate: float, distance: float) -> float:
    """Rate at which a signal crosses a level outwards, 1/s: s_v / (2 pi s_x) exp(-d^2 / (2 s_x^2)).

    S. O. Rice, Bell Syst. Tech. J. 24 (1945) 46.

    Parameters
    ----------
    deviation, rate : standard deviations of the signal and of its time derivative
    distance : of the level from the mean

    Examples
    --------
    >>> round(crossing_rate(1.0, 6.283185307179586, 0.0), 12)
    1.0
    """
    if deviation == 0.0:
        return 0.0
    return rate / (2.0 * pi * deviation) * exp(-0.5 * (distance / deviation) ** 2)


def probability_per_hour(rate: float) -> float:
    """Probability of at least one event in an hour, of events that come at a rate (1/s) independently (Poisson).

    Examples
    --------
    >>> probability_per_hour(0.0), round(probability_per_hour(1.0 / 3600.0), 6)
    (0.0, 0.632121)
    """
    return -expm1(-SECONDS_PER_HOUR * rate)


def supplied_power(force: float, velocity: float, correlation: float) -> float:
    """Mean of the positive part of force times velocity, W.

    s_F s_v / pi (sqrt(1 - r^2) + r (pi / 2 + arcsin r)) for a Gaussian pair of zero mean.

    Parameters
    ----------
    force, velocity : standard deviations, N and m/s
    correlation : r, between -1 and 1

    Examples
    --------
    >>> supplied_power(2.0, 3.0, 1.0), round(supplied_power(2.0, 3.0, -1.0), 12)
    (6.0, 0.0)
    """
    r = min(1.0, max(-1.0, correlation))
    return force * velocity / pi * (sqrt(1.0 - r * r) + r * (0.5 * pi + asin(r)))


def share_beyond(deviation: float, limit: float) -> float:
    """Share of time at which a signal is beyond +-limit.

    Examples
    --------
    >>> round(share_beyond(1.0, 3.0), 6)
    0.0027
    """
    return 0.0 if deviation == 0.0 else erfc(limit / (sqrt(2.0) * deviation))
