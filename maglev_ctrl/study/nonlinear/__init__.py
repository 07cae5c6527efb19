"""The linear verdicts of an option held against its nonlinear vehicle."""
