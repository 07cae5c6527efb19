"""The paper from geometry alone: forces, eigenvalues, mode shapes, and a verdict on every claim."""
