"""What a reader may never do: write or remove outside its folder, read elsewhere, start programs, talk, run texts."""

from __future__ import annotations

import os
import sys
import sysconfig
from pathlib import Path
from typing import Any

_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
_CHANGES = {
    "os.remove", "os.rename", "os.mkdir", "os.rmdir", "os.link", "os.symlink", "os.truncate", "os.chmod", "os.chown",
    "os.utime", "shutil.rmtree", "shutil.move", "shutil.copyfile", "shutil.copytree", "tempfile.mkstemp",
    "tempfile.mkdtemp",
}  # fmt: skip
_NEVER = {
    "os.system", "os.exec", "os.fork", "os.forkpty", "os.posix_spawn", "os.spawn", "subprocess.Popen", "pty.spawn",
    "socket.connect", "socket.bind", "socket.getaddrinfo", "socket.gethostbyname", "socket.sendto", "urllib.Request",
    "pickle.find_class", "os.chdir", "ctypes.dlsym/handle", "webbrowser.open",
}  # fmt: skip
_OWN_CODE = (
    str(Path(__file__).resolve().parents[2] / "maglev_ctrl"),
    str(Path(__file__).resolve().parent),
    sys.prefix,
    sys.base_prefix,
    sysconfig.get_path("stdlib"),
)
_LIBRARY = tuple(
    str(Path(sysconfig.get_path("stdlib"), name))
    for name in ("dataclasses.py", "collections/__init__.py", "typing.py", "inspect.py", "traceback.py")
)
_SYSTEM = ("/proc/", "/sys/", "/etc/localtime", "/usr/share/zoneinfo", "/dev/null", "/dev/urandom", "/usr/lib", "/lib")


class Watch:
    """An audit hook that notes every breach while `active`; once installed it stays for the life of the process."""

    def __init__(self, folder: Path) -> None:
        self.folder = str(folder.resolve())
        self.active = False
        self.breaches: list[str] = []

    def install(self) -> Watch:
        """Begin to listen."""
        sys.addaudithook(self._hear)
        return self

    def _hear(self, event: str, details: tuple[Any, ...]) -> None:
        if not self.active:
            return
        self.active = False  # what the check itself opens is not looked at
        try:
            breach = self._breach(event, details)
        finally:
            self.active = True
        if breach:
            self.breaches.append(breach)

    def _breach(self, event: str, details: tuple[Any, ...]) -> str:
        if event in _NEVER:
            return f"{event} {details!r:.200}"
        if event == "open":
            path, _, flags = details
            if isinstance(path, int) or path is None:
                return ""
            place = os.path.realpath(os.fsdecode(path))
            if isinstance(flags, int) and flags & _WRITING:
                return "" if self._inside(place) or place == os.devnull else f"opened for writing: {place}"
            allowed = self._inside(place) or place.startswith((*_OWN_CODE, *_SYSTEM))
            return "" if allowed else f"read elsewhere: {place}"
        if event in _CHANGES:
            places = [
                os.path.realpath(os.fsdecode(one)) for one in details[:2] if isinstance(one, str | bytes | os.PathLike)
            ]
            outside = [one for one in places if not self._inside(one)]
            return f"{event} outside: {outside[0]}" if outside else ""
        if event == "compile":
            source, name = details
            if source is not None and not _making_a_class() and not str(name).startswith(_OWN_CODE):
                return f"a text is compiled: {source!r:.200}"
        if event == "exec":
            name = getattr(details[0], "co_filename", "?")
            if not (name.startswith(_OWN_CODE) or name.startswith("<frozen") or _making_a_class()):
                return f"code is run: {name}"
        return ""

    def _inside(self, place: str) -> bool:
        return place == self.folder or place.startswith(self.folder + os.sep)


def _making_a_class() -> bool:
    """Whether the standard library writes methods of a class or reads annotations, as it does for modules and verbs."""
    frame = sys._getframe(3)
    for _ in range(4):
        if frame is None:
            return False
        if frame.f_code.co_filename in _LIBRARY:
            return True
        frame = frame.f_back  # type: ignore[assignment]
    return False
