"""Blocks that take a known time or end their process: what executors of sweeps are tested with."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from maglev_ctrl.study.sweep.records import SweepBlock


@dataclass(frozen=True)
class Sleep:
    """Every block sleeps; the first process to reach `deadly` dies of it, `times` times, noted in a folder."""

    seconds: float
    deadly: int = -1
    times: int = 1
    notes: str = ""

    def __call__(self, index: int) -> SweepBlock:
        if index == self.deadly:
            for k in range(self.times):
                try:
                    (Path(self.notes) / f"died-{k}").touch(exist_ok=False)
                except FileExistsError:
                    continue
                os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(self.seconds)
        return SweepBlock(index, np.array([[float(index)]]), np.zeros((1, 1, 1)), (), self.seconds)


@dataclass(frozen=True)
class Work:
    """Every block keeps a processor busy."""

    seconds: float

    def __call__(self, index: int) -> SweepBlock:
        started = time.perf_counter()
        matrix = np.random.default_rng(index).normal(size=(12, 12))
        while time.perf_counter() - started < self.seconds:
            np.linalg.eigvals(matrix)
        return SweepBlock(index, np.array([[float(index)]]), np.zeros((1, 1, 1)), (), time.perf_counter() - started)
