"""Finders of the requirements on periodic forcing: depth survived, gain and speed margins under modulation."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal

import numpy as np

from maglev_ctrl.analysis.floquet_margins import FloquetMargins, PeriodicMargin
from maglev_ctrl.errors import Agreement
from maglev_ctrl.study.evidence import Evidence
from maglev_ctrl.study.finding import Finding, missing
from maglev_ctrl.study.records import FloquetStudy

BOTH_ENGINES = "scan seeded with the predicted tongues; both ends of the bracket verified by both Floquet engines"
NOT_STABLE = "not stable at the expected depth and the design speed"


def modulation(*, ratio: bool) -> Callable[[Evidence, str], Finding]:
    """Modulation depth survived over the map's speeds, itself or over the expected depth."""

    def find(evidence: Evidence, over: str) -> Finding:
        study = evidence.floquet
        if study is None:
            return missing(evidence.floquet_reason)
        if study.at_design.agreement is not Agreement.AGREED:
            return missing("the two Floquet engines disagree at the design point")
        if math.isnan(study.worst_depth):
            return missing("the two Floquet engines disagree where the modulation depth is decided")
        where = f"speed {study.worst_speed * 3.6:.4g} km/h, {study.worst_resonance}"
        method = "propagators and harmonic balance agree; bisection in depth"
        depth = study.worst_depth
        bound: Literal["exact", "lower", "upper"] = "exact"
        if math.isinf(depth):
            depth, bound, where = study.largest_depth, "lower", f"no instability up to depth {study.largest_depth:.3g}"
        elif np.any(study.map.unresolved):
            bound, where = "upper", f"{where}; elsewhere on the map the two engines disagree"
        if ratio and study.expected_depth == 0.0:
            return missing("the expected modulation depth is zero")
        value = depth / study.expected_depth if ratio else depth
        return Finding(value, where, method, where, bound=bound)

    return find


def floquet_gain(evidence: Evidence, over: str) -> Finding:
    """The smaller change of the gain, down or up, at which a multiplier reaches one, dB."""

    def read(study: FloquetStudy, found: FloquetMargins) -> Finding:
        if found.gain is None:
            return missing(study.margins_reason)
        return nearest(found.gain, lambda factor: abs(20.0 * math.log10(factor)), _gain_words)

    return _margin(evidence, read)


def floquet_speed(evidence: Evidence, over: str) -> Finding:
    """The smaller change of the speed, down or up, at which a multiplier reaches one, as a fraction of the speed."""

    def read(study: FloquetStudy, found: FloquetMargins) -> Finding:
        if found.speed is None:
            return Finding(0.0, "design point", BOTH_ENGINES, NOT_STABLE)
        design = found.speed[0].nominal
        return nearest(found.speed, lambda speed: abs(speed / design - 1.0), _speed_words)

    return _margin(evidence, read)


def nearest(
    margins: tuple[PeriodicMargin, ...], distance: Callable[[float], float], words: Callable[[float], str]
) -> Finding:
    """The smallest of several margins as a distance from the design; a bound where one of them is only a bound.

    A margin that is at least a and one that is exactly b > a leave the smallest between a and b: it is told as at
    least a.

    Parameters
    ----------
    distance : value of a margin -> its distance from the design
    words : value of a margin -> text
    """
    ends = [_ends(one, distance) for one in margins]
    least, most = min(low for low, _ in ends), min(high for _, high in ends)
    if least == most:
        one = margins[min(range(len(ends)), key=lambda k: ends[k][0])]
        return Finding(least, words(one.safe), BOTH_ENGINES, f"stability is lost at {words(one.safe)} ({_cause(one)})")
    decides = min(range(len(ends)), key=lambda k: ends[k][0])
    one = margins[decides]
    if least > 0.0:
        why = f"stable as far as {words(one.safe)} ({one.reason})"
        return Finding(least, words(one.safe), BOTH_ENGINES, why, bound="lower")
    if math.isfinite(most):
        why = f"nearer to the design: {one.text}"
        other = margins[min(range(len(ends)), key=lambda k: ends[k][1])]
        return Finding(most, words(other.unsafe), BOTH_ENGINES, why, bound="upper")
    return missing(one.text)


def _margin(evidence: Evidence, read: Callable[[FloquetStudy, FloquetMargins], Finding]) -> Finding:
    study = evidence.floquet
    if study is None:
        return missing(evidence.floquet_reason)
    if study.margins is None:
        return missing(study.margins_reason)
    return read(study, study.margins)


def _ends(one: PeriodicMargin, distance: Callable[[float], float]) -> tuple[float, float]:
    """Between what distances the loss lies."""
    if one.agreement is Agreement.UNRESOLVED:
        return 0.0, math.inf
    if one.bound == "upper":
        return 0.0, distance(one.unsafe)
    return distance(one.safe), math.inf if one.bound == "lower" else distance(one.safe)


def _cause(one: PeriodicMargin) -> str:
    return "unstable without modulation too" if one.unmodulated else one.tongue.name


def _gain_words(factor: float) -> str:
    return f"gain factor {factor:.4g}"


def _speed_words(speed: float) -> str:
    return f"speed {speed * 3.6:.4g} km/h"
