"""What went wrong with one option, in a sentence: the others go on, and the report tells why this one has no answer.

A study is hours of work on many options with solvers written by others, which fail in ways nobody listed. Whatever one
of them raises ends its own option (or one part of it) and nothing else; requirements that hang on it are NOT EVALUATED.
"""

from __future__ import annotations

import numpy as np

from maglev_ctrl.errors import MaglevError, Status
from maglev_ctrl.synthesis.result import Refused

_OWN = (MaglevError, ValueError, ArithmeticError, np.linalg.LinAlgError)
_LONGEST = 300


def sentence(fault: Exception) -> str:
    """One line about a fault, without a traceback.

    Raises
    ------
    Warning : a warning that was made an error is no fault of an option; whoever asked for it shall see it

    Examples
    --------
    >>> sentence(MemoryError())
    'the memory was not enough'
    >>> sentence(ModuleNotFoundError("No module named 'cvxpy'", name="cvxpy"))
    'cvxpy is not installed or cannot be loaded; install maglev_ctrl with all it depends on'
    >>> sentence(RuntimeError("factorisation broke down"))
    'not foreseen: RuntimeError: factorisation broke down'
    """
    if isinstance(fault, Warning):
        raise fault
    words = " ".join(f"{fault}".split())[:_LONGEST]
    if isinstance(fault, MemoryError):
        return "the memory was not enough"
    if isinstance(fault, ImportError) and fault.name:
        return f"{fault.name} is not installed or cannot be loaded; install maglev_ctrl with all it depends on"
    if isinstance(fault, ImportError):
        return words
    if isinstance(fault, _OWN):
        return f"{fault}" or type(fault).__name__
    return f"not foreseen: {type(fault).__name__}: {words}" if words else f"not foreseen: {type(fault).__name__}"


def status_of(fault: Exception) -> Status:
    """The status of a law that a fault prevented: the solver's own where it told one.

    Examples
    --------
    >>> status_of(Refused("too slow", Status.TIME_LIMIT)).name, status_of(MemoryError()).name
    ('TIME_LIMIT', 'NUMERICAL_ERROR')
    """
    if isinstance(fault, Refused):
        return fault.status
    numerical = isinstance(fault, ArithmeticError | np.linalg.LinAlgError) or not isinstance(fault, _OWN)
    return Status.NUMERICAL_ERROR if numerical else Status.INFEASIBLE
