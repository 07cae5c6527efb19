"""Control design: Riccati equations, linear-quadratic laws, sky-hook damping, and certificates of closed loops."""
