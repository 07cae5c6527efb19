"""Nonlinear time simulation of a vehicle with its full force map; import from the modules: this page loads nothing."""
