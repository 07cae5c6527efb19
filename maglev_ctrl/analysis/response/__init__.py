"""Response to a random guideway: exact variances, ride comfort, gaps, strokes, and what actuators have to give."""
