"""A Dask cluster of processes that tests may kill: a scheduler on one port, workers that come and go."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

HERE = Path(__file__).parent


class LocalCluster:
    """Scheduler and workers as processes; `address` stays the same when the scheduler is started again."""

    def __init__(self, folder: Path, workers: int) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{self.port}"
        self.folder = folder
        self.log = (folder / "cluster.log").open("ab")
        self.scheduler = self.workers = None
        self.count = workers
        self.start_scheduler()
        self.start_workers()

    def start_scheduler(self) -> None:
        self.scheduler = self._start("scheduler", "--port", str(self.port))

    def start_workers(self) -> None:
        local = ["--local-directory", str(self.folder), "--nthreads", "1"]
        self.workers = [self._start("worker", self.address, *local) for _ in range(self.count)]

    def _start(self, what: str, *arguments: str) -> subprocess.Popen[bytes]:
        root = HERE.parent.parent
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(HERE), str(root)]), "OMP_NUM_THREADS": "1",
                       "OPENBLAS_NUM_THREADS": "1"}  # fmt: skip
        command = [sys.executable, "-m", f"distributed.cli.dask_{what}", *arguments, "--host", "127.0.0.1",
                   "--no-dashboard"]  # fmt: skip
        # A session of its own: a nanny and its worker are killed together, as a machine that goes away would do.
        return subprocess.Popen(command, env=environment, stdout=self.log, stderr=self.log, start_new_session=True)

    def kill(self, process: subprocess.Popen[bytes]) -> None:
        """At once, with everything it has started."""
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()

    def wait_for_workers(self, count: int, seconds: float = 60.0) -> None:
        """Until so many take part."""
        from distributed import Client

        with Client(self.address, set_as_default=False, timeout=seconds) as client:
            end = time.monotonic() + seconds
            while len(client.nthreads()) < count:
                assert time.monotonic() < end, "the workers do not come"
                time.sleep(0.1)

    def close(self) -> None:
        for process in [*self.workers, self.scheduler]:
            self.kill(process)
        self.log.close()
