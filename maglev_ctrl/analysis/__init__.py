"""Stability analysis: modes and their energy ledger, tracks, boundaries, Floquet theory, margins.

Import from the modules (`maglev_ctrl.analysis.modes`, ...): this page loads nothing.
"""
