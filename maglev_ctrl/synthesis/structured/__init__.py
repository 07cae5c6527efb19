"""Static, low-order and sparse output feedback by nonsmooth optimisation with exact gradients."""
