"""Every engine that speaks of the stability of a linear system, asked about the systems of `stress_systems`."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import stress_systems
from stress_record import RIGHT, WRONG, Family, Outcome, decision
from stress_systems import Sample

from maglev_ctrl.analysis.hurwitz import lyapunov_inertia
from maglev_ctrl.analysis.modes import StabilityVerdict, modes
from maglev_ctrl.analysis.routh import exact_root_count
from maglev_ctrl.analysis.spectrum import spectrum
from maglev_ctrl.errors import ModelError
from maglev_ctrl.synthesis.design import lyapunov_proof
from maglev_ctrl.systems import SecondOrderSystem

WORDS = {StabilityVerdict.STABLE: -1, StabilityVerdict.UNSTABLE: 1, StabilityVerdict.UNRESOLVED: None}
LARGEST_EXACT = 6


def system_of(sample: Sample) -> SecondOrderSystem:
    """The sample as a vehicle has it; a first-order one as internal states beside a damped coordinate."""
    if sample.A is None:
        return SecondOrderSystem.from_matrices(sample.M, sample.C, sample.K)
    names = tuple(f"x{i}" for i in range(len(sample.A)))
    return SecondOrderSystem.from_matrices([[1.0]], [[1.0]], [[1.0]], internal=names, A_internal=sample.A)


def outcomes(sample: Sample) -> Iterator[Outcome]:
    """What every engine says of a sample."""
    system = system_of(sample)
    try:
        yield decision("modes", sample, WORDS[modes(system).verdict])
    except ModelError as fault:  # a mass matrix that is singular as far as rounding can tell
        yield Outcome("modes", sample.family, "unresolved", sample.easy, str(fault))
        return
    if len(system.states) <= LARGEST_EXACT:
        count = exact_root_count(system)
        said = 1 if count.right else (0 if count.axis else -1)
        told = f"said {said}, truth {sample.truth}"
        yield Outcome("exact count", sample.family, RIGHT if said == sample.truth else WRONG, True, told)
    if sample.A is None:
        return
    certificate = lyapunov_inertia(sample.A)
    said = (-1 if certificate.right == 0 else 1) if certificate.certified else None
    yield decision("Lyapunov inertia", sample, said)
    found = spectrum(sample.A)
    stable, unstable = np.all(found.s.real < -found.error_bound), np.any(found.s.real > found.error_bound)
    yield decision("eigenvalues", sample, -1 if stable else (1 if unstable else None))
    positive, residual = lyapunov_proof(sample.A)
    proved = -1 if positive and residual < 1.0 else None
    if sample.truth != -1 or proved is not None:  # it proves stability alone
        verdict = decision("Lyapunov proof", sample, proved).verdict if proved else RIGHT
        yield Outcome("Lyapunov proof", sample.family, verdict, False, f"residual {residual:.1e}, truth {sample.truth}")


def _asked(make: stress_systems.Maker) -> Family:
    def family(random: np.random.Generator) -> Iterator[Outcome]:
        yield from outcomes(make(random))

    family.__name__ = make.__name__
    return family


FAMILIES: tuple[Family, ...] = tuple(_asked(make) for make in stress_systems.FAMILIES)
