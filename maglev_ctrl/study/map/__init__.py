"""Stability maps of a scenario's options over any two of its quantities."""
