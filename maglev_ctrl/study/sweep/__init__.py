"""Sweeps: an option's verdict and figures at many points of any quantities, on this machine or on a cluster."""
