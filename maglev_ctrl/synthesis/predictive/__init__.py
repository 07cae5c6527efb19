"""Model predictive control: quadratic programs checked step by step, with a proved law to fall back on."""
