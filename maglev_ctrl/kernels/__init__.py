"""Array-only numerics without domain words: propagators, periodic products, Hill matrices, Chebyshev interpolation."""

from maglev_ctrl.kernels.chebyshev import ChebyshevSeries, chebyshev_series
from maglev_ctrl.kernels.checks import check_periodic
from maglev_ctrl.kernels.hill import HillSpectrum, hill_matrix, hill_pair, hill_spectrum
from maglev_ctrl.kernels.periodic_qr import PeriodicMultipliers, periodic_multipliers
from maglev_ctrl.kernels.piecewise import piecewise_error, piecewise_propagators
from maglev_ctrl.kernels.scaling import balance, eigen_triplets, rescale
from maglev_ctrl.kernels.taylor import (
    TaylorPlan,
    monodromy_over_depths,
    propagators_over_depths,
    taylor_plan,
    tree_product,
)

__all__ = [
    "ChebyshevSeries",
    "HillSpectrum",
    "PeriodicMultipliers",
    "TaylorPlan",
    "balance",
    "check_periodic",
    "chebyshev_series",
    "eigen_triplets",
    "hill_matrix",
    "hill_pair",
    "hill_spectrum",
    "monodromy_over_depths",
    "periodic_multipliers",
    "piecewise_error",
    "piecewise_propagators",
    "propagators_over_depths",
    "rescale",
    "taylor_plan",
    "tree_product",
]
