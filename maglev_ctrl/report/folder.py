"""Several files put into a folder together: all of them, or those of before."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path


def write_whole(made: Mapping[str, bytes], target: Path) -> tuple[Path, ...]:
    """Files by name moved into `target` when all are written, or those of before put back; other files there are kept.

    Parameters
    ----------
    made : content by file name
    target : made when it does not exist
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    staging = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
    try:
        for name, content in made.items():
            (staging / name).write_bytes(content)
        if not target.exists():
            staging.chmod(0o755)
            staging.rename(target)
        else:
            _exchange(staging, target, tuple(made))
    finally:
        shutil.rmtree(staging, ignore_errors=True)
    return tuple(target / name for name in made)


def _exchange(staging: Path, target: Path, names: Sequence[str]) -> None:
    old = Path(tempfile.mkdtemp(prefix=f".{target.name}-old-", dir=target.parent))
    earlier = {name for name in names if (target / name).exists()}
    try:
        for name in names:
            if name in earlier:
                (target / name).rename(old / name)
            (staging / name).rename(target / name)
    except BaseException:  # an interrupt too
        for name in names:
            if (old / name).exists():
                (old / name).replace(target / name)
            elif name not in earlier:
                (target / name).unlink(missing_ok=True)
        raise
    finally:
        shutil.rmtree(old, ignore_errors=True)
