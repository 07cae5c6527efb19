"""Designs of a scenario: every option with a law or a damping budget, made, proved, sampled and shown."""
