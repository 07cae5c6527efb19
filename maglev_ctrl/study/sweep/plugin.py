"""What a Dask worker is given of a sweep; apart, because its base class belongs to Dask."""

from __future__ import annotations

from typing import Any

from distributed import WorkerPlugin

from maglev_ctrl.study.sweep import worker as worker_side


class TaskPlugin(WorkerPlugin):  # type: ignore[misc]
    """Makes a worker ready for the blocks of one sweep, and ready for others afterwards."""

    def __init__(self, prepared: worker_side.Prepared) -> None:
        self.prepared = prepared

    def setup(self, worker: Any) -> None:
        """Called by Dask on every worker, those that come later too."""
        worker_side.take(self.prepared)

    def teardown(self, worker: Any) -> None:
        """Called by Dask when the sweep is over."""
        worker_side.forget(self.prepared)
