"""Gain scheduling: laws that follow an operating parameter, with a proof of what happens between its nodes."""
