"""The ride of an option on the page: passengers, spectra, gaps and strokes, actuators, girders and steps."""

from maglev_ctrl.report.ride.content import ride_blocks

__all__ = ["ride_blocks"]
