"""Magnetic forces of one magnet over a guideway."""

from __future__ import annotations

from maglev_ctrl.forces.base import AbstractForceModel, Domain, MagnetDerivatives, MagnetForces

__all__ = ["AbstractForceModel", "Domain", "MagnetDerivatives", "MagnetForces"]
