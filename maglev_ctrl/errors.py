"""Faults and outcomes: what is raised, and what is returned as a value."""

from __future__ import annotations

from enum import Enum


class MaglevError(Exception):
    """Base of every fault this package raises on purpose."""


class ScenarioError(MaglevError):
    """A scenario file is wrong; the message carries file, line, column, key and what was expected."""


class ModelError(MaglevError):
    """The physics has no answer: no equilibrium, a mass matrix that is not positive definite, and so on."""


class OutOfDomain(MaglevError):
    """A force model was asked for a point outside its data; nothing is ever extrapolated."""


class NotStable(MaglevError):
    """A margin was asked of a closed loop that is not stable; margins of an unstable loop mean nothing."""


class Status(Enum):
    """Outcome of a solver; the value is advice to the user."""

    SOLVED = "solved and verified"
    ALMOST_SOLVED = "solved to reduced accuracy: read the residual before use"
    INFEASIBLE = "no solution exists: relax a requirement or add an actuator or sensor"
    UNBOUNDED = "the problem is unbounded: add a weight or a limit"
    ITERATION_LIMIT = "the iteration limit was reached: raise it or rescale the problem"
    TIME_LIMIT = "the time limit was reached: raise it or simplify the problem"
    NUMERICAL_ERROR = "numerical trouble: rescale the problem or try another solver"
    NOT_VERIFIED = "the solver reported success but an independent check disagrees: do not use"


class Verdict(Enum):
    """Three-valued verdict of a requirement; what cannot be verified is never PASS."""

    PASS = "PASS"
    FAIL = "FAIL"
    NOT_EVALUATED = "NOT EVALUATED"


class Agreement(Enum):
    """Whether two independent methods gave the same answer."""

    AGREED = "AGREED"
    UNRESOLVED = "UNRESOLVED"
