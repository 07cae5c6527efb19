"""Several files put into a folder together: all of them, or those of before."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from maglev_ctrl.errors import ScenarioError


def write_whole(made: Mapping[str, bytes], target: Path, *, replaced: Sequence[str] = ()) -> tuple[Path, ...]:
    """Files moved into `target` when all are written, or those of before put back; other files there are kept.

    Everything is made in a temporary folder beside `target`: a failure or an interrupt leaves it as it was.

    Parameters
    ----------
    made : content by file name, or by "folder/file" for a folder that is exchanged as a whole
    target : made when it does not exist
    replaced : names of an earlier run that go even where none of their name is made now

    Returns
    -------
    paths of what stands in `target` now, folders for their files, in the order of `made`
    """
    names = tuple(dict.fromkeys(name.partition("/")[0] for name in made))
    target.parent.mkdir(parents=True, exist_ok=True)
    staging = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
    try:
        for name, content in made.items():
            (staging / name).parent.mkdir(exist_ok=True)
            (staging / name).write_bytes(content)
        if target.exists():
            _exchange(staging, target, made=names, every=tuple(dict.fromkeys((*names, *replaced))))
        else:
            staging.chmod(0o755)
            staging.rename(target)
    finally:
        shutil.rmtree(staging, ignore_errors=True)
    return tuple(target / name for name in names)


def _exchange(staging: Path, target: Path, *, made: Sequence[str], every: Sequence[str]) -> None:
    old = Path(tempfile.mkdtemp(prefix=f".{target.name}-old-", dir=target.parent))
    earlier = {name for name in every if (target / name).exists()}
    try:
        for name in every:
            if name in earlier:
                (target / name).rename(old / name)
            if name in made:
                (staging / name).rename(target / name)
    except BaseException:  # an interrupt too
        for name in every:
            moved_away = (old / name).exists()
            if (target / name).exists() and (moved_away or name not in earlier):
                (target / name).replace(staging / name)
            if moved_away:
                (old / name).replace(target / name)
        raise
    finally:
        shutil.rmtree(old, ignore_errors=True)


def require_writable(folder: Path, *, results: str = "") -> None:
    """Find out before minutes of work whether results can be written; nothing is left behind.

    Parameters
    ----------
    results : what they are, in the words of the message

    Raises
    ------
    ScenarioError : it is a file, or it or the folder it stands in cannot be written
    """
    if folder.exists() and not folder.is_dir():
        purpose = f" for the {results}" if results else ""
        raise ScenarioError(f"{folder}: expected a folder{purpose}, got a file; choose another with --out")
    # Results are made beside their folder and moved into place, so both have to be writable.
    for place in {_nearest(folder), _nearest(folder.absolute().parent)}:
        try:
            Path(tempfile.mkdtemp(prefix=".maglev-ctrl-", dir=place)).rmdir()
        except OSError as error:
            what = f"the {results} cannot" if results else "cannot"
            raise ScenarioError(
                f"{folder}: {what} be written ({place}: {error.strerror or error}); choose another folder with --out"
            ) from None


def _nearest(path: Path) -> Path:
    return next((one for one in (path.absolute(), *path.absolute().parents) if one.exists()), Path.cwd())
