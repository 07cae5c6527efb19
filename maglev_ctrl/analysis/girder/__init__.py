"""Girders: the response to spans that sag, steps and joints, and girders that bend under the vehicle."""
