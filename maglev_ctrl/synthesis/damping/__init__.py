"""Damping laws and damping budgets: hooked dampers, least collocated damping, cost against certified margin."""
