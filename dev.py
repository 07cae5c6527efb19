#!/usr/bin/env python3
"""Set everything up on a fresh machine and run the work: `python3 dev.py report SCENARIO`, `python3 dev.py test`.

Standard library only. Uses uv where it is on PATH, otherwise a virtual environment and pip. Verbs that are not listed
below are passed on to the `maglev-ctrl` command, so `python3 dev.py check FILE` is `maglev-ctrl check FILE`.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent
ENVIRONMENT = ROOT / ".venv"
BIN = ENVIRONMENT / ("Scripts" if os.name == "nt" else "bin")
PYTHON = BIN / ("python.exe" if os.name == "nt" else "python")
STAMP = ENVIRONMENT / "maglev-ctrl-setup"
LOCK = ROOT / "requirements.lock"
LOCKED = "locked"
EXTRAS = "test,docs,ui,dist,supply"

HELP = """usage: python3 dev.py VERB [ARGUMENTS]

  test [PYTEST ARGUMENTS]   run the tests
  lint                      ruff, mypy and the floors of the architecture
  docs                      build the documentation site into docs/_build/html
  validation [TEST FILES]   run the tests that the validation page names, and record what they say for it
  hold [PART] [--short]     try to break it, and record what happened for the reliability page
  bench [NAME]              run the benchmarks
  setup [--locked]          only set up; with --locked exactly what requirements.lock names, each file with its hash
  ui [SCENARIO]             the workbench page in your browser
  cluster [N] [PORT]        a Dask cluster of N worker processes on this machine, for sweep --cluster
  report | design ...       everything else is the maglev-ctrl command:
                            python3 dev.py report scenarios/compare/eds_135t.toml
"""


def main(arguments: list[str]) -> int:
    """Set up once, then run one verb; the exit status is the verb's own."""
    if sys.version_info < (3, 11):
        found = ".".join(str(part) for part in sys.version_info[:3])
        return complain(f"Python 3.11 or newer is needed; this is {found} ({sys.executable})")
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        print(HELP)
        return 0
    verb, rest = arguments[0], arguments[1:]
    if verb == "setup" and rest not in ([], ["--locked"]):
        return complain(f"setup: expected nothing or --locked, got {' '.join(rest)}")
    problem = set_up(locked=verb == "setup" and bool(rest))
    if problem:
        return complain(problem)
    # No match statement: an older Python must get as far as the sentence above.
    if verb == "setup":
        return 0
    if verb == "test":
        return run([str(PYTHON), "-m", "pytest", *(rest or ["-n", str(os.cpu_count() or 1)])], cwd=ROOT)
    if verb == "lint":
        return lint()
    if verb == "docs":
        return build_docs()
    if verb == "validation":
        return run([str(PYTHON), str(ROOT / "docs" / "_ext" / "record_validation.py"), *rest], cwd=ROOT)
    if verb == "hold":
        return run([str(PYTHON), str(ROOT / "tests" / "hold" / "hold.py"), *rest], cwd=ROOT)
    if verb == "bench":
        return bench(rest)
    if verb == "cluster":
        return cluster(rest)
    return pass_on(arguments)


def set_up(*, locked: bool = False) -> str:
    """Create the environment unless the project's requirements are the ones installed; a problem in words, or ''.

    One that was locked stays so until pyproject.toml or the lock changes; then `setup --locked` is asked for again.
    """
    found = STAMP.read_text(encoding="utf-8") if STAMP.exists() else ""
    if found == wanted(locked=True) or (not locked and found == wanted()):
        return ""
    if not locked and found.endswith(LOCKED):
        return "the requirements have changed since this environment was locked: run `python3 dev.py setup --locked`"
    print("maglev_ctrl: setting up (once) ...", file=sys.stderr, flush=True)
    uv = shutil.which("uv")
    if uv:
        environment = {**os.environ, "UV_PROJECT_ENVIRONMENT": str(ENVIRONMENT), "VIRTUAL_ENV": str(ENVIRONMENT)}
        steps = [[uv, "venv", "--quiet", "--allow-existing", "--python", sys.executable, str(ENVIRONMENT)]]
        install = [uv, "pip", "install", "--quiet", "--compile-bytecode"]
        exactly = [uv, "pip", "sync", "--quiet", "--compile-bytecode", "--require-hashes", str(LOCK)]
    else:
        problem = make_environment()
        if problem:
            return problem
        environment = dict(os.environ)
        steps = []
        install = [str(PYTHON), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        exactly = [*install, "--require-hashes", "--no-deps", "--requirement", str(LOCK)]
    if locked:  # what builds the package is in the lock as well
        steps += [exactly, [*install, "--no-deps", "--no-build-isolation", "--editable", str(ROOT)]]
    else:
        steps += [[*install, "--editable", f"{ROOT}[{EXTRAS}]"]]
    for step in steps:
        if subprocess.run(step, env=environment, check=False).returncode != 0:
            return f"set-up failed at: {' '.join(step)}"
    STAMP.write_text(wanted(locked=locked), encoding="utf-8")
    return ""


def make_environment() -> str:
    """A virtual environment with pip; a problem in words, or ''."""
    try:
        import ensurepip  # noqa: F401
    except ImportError:
        version = f"{sys.version_info.major}.{sys.version_info.minor}"
        return (
            "this Python has no ensurepip, so it cannot make an environment with pip in it; mend it with one command:\n"
            f"  sudo apt-get install python{version}-venv"
        )
    if PYTHON.exists():
        return ""
    done = subprocess.run([sys.executable, "-m", "venv", str(ENVIRONMENT)], check=False)
    return "" if done.returncode == 0 else f"could not create {ENVIRONMENT}"


def wanted(*, locked: bool = False) -> str:
    """What the environment must match: the requirements, this Python, this place; and the lock, where it is held to."""
    digest = hashlib.sha256((ROOT / "pyproject.toml").read_bytes()).hexdigest()
    if locked and LOCK.exists():
        digest = hashlib.sha256(digest.encode() + LOCK.read_bytes()).hexdigest()
    return f"{digest} {sys.version_info[:2]} {ROOT} {LOCKED if locked else EXTRAS}"


def lint() -> int:
    """Style, types and floors; the worst exit status."""
    steps = [
        [str(PYTHON), "-m", "ruff", "check", "."],
        [str(PYTHON), "-m", "ruff", "format", "--check", "."],
        [str(PYTHON), "-m", "mypy"],
        [str(BIN / ("lint-imports.exe" if os.name == "nt" else "lint-imports"))],
    ]
    return max(run(step, cwd=ROOT) for step in steps)


def build_docs() -> int:
    """The documentation site; a warning, a broken link or a failing example is an error."""
    out = ROOT / "docs" / "_build" / "html"
    status = run([str(PYTHON), "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", "docs", str(out)], cwd=ROOT)
    if status == 0:
        print(f"documentation: {out / 'index.html'}")
    return status


def bench(names: list[str]) -> int:
    """Every benchmark, or the named ones."""
    known = {path.stem: path for path in sorted((ROOT / "benchmarks").glob("*.py"))}
    missing = [name for name in names if name not in known]
    if missing:
        return complain(f"no benchmark {missing[0]!r}; there are: {', '.join(known)}")
    return max((run([str(PYTHON), str(known[name])], cwd=ROOT) for name in names or known), default=0)


def cluster(arguments: list[str]) -> int:
    """A scheduler and workers of one thread, for this machine alone, until Ctrl-C; what dies is started again."""
    try:
        count, port = (int(value) for value in [*arguments, *[str(os.cpu_count() or 1), "8786"][len(arguments) :]])
    except ValueError:
        return complain(f"cluster: expected the number of workers and a port, got {' '.join(arguments)}")
    if count < 1 or not 1 <= port <= 65535:
        return complain(f"cluster: expected one worker or more and a port up to 65535, got {count} and {port}")
    address = f"tcp://127.0.0.1:{port}"
    threads = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    quiet = {"DASK_LOGGING__DISTRIBUTED": "warning"}
    environment = {**os.environ, **threads, **quiet}
    dask = [str(PYTHON), "-m", "distributed.cli.dask_scheduler"], [str(PYTHON), "-m", "distributed.cli.dask_worker"]
    place = ["--host", "127.0.0.1", "--no-dashboard"]
    commands = {
        "scheduler": [*dask[0], "--port", str(port), *place],
        "workers": [*dask[1], address, "--nworkers", str(count), "--nthreads", "1", *place],
    }
    # Whoever ends this ends the cluster; a shell that starts it in the background lets it ignore Ctrl-C.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    print(f"Dask cluster of {count} worker(s): --cluster {address}   (Ctrl-C ends it)", flush=True)
    running: dict[str, subprocess.Popen[bytes]] = {}
    try:
        while True:
            for name, command in commands.items():
                if name not in running or running[name].poll() is not None:
                    if name in running:
                        print(f"the {name} ended with status {running[name].returncode}; started again", flush=True)
                        time.sleep(1.0)
                    running[name] = subprocess.Popen(command, env=environment)
            time.sleep(0.5)
    except KeyboardInterrupt:
        return 0
    finally:
        for process in running.values():
            process.terminate()
        for process in running.values():
            process.wait()


def run(command: list[str], *, cwd: Path | None = None) -> int:
    """Run a command with this terminal; its exit status. Ctrl-C reaches it too, and it is waited for."""
    with subprocess.Popen(command, cwd=cwd) as process:
        while True:
            try:
                status = process.wait()
            except KeyboardInterrupt:
                continue
            return status if status >= 0 else 128 - status


def pass_on(arguments: list[str]) -> int:
    """Become the maglev-ctrl command; where a process cannot become another one, run it."""
    os.environ["MAGLEV_CTRL_COMMAND"] = f"{'python' if os.name == 'nt' else 'python3'} {sys.argv[0]}"
    command = [str(PYTHON), "-m", "maglev_ctrl", *arguments]
    if os.name != "nt":
        sys.stdout.flush()
        sys.stderr.flush()
        os.execv(command[0], command)
    return run(command)


def complain(problem: str) -> int:
    """Say what is wrong; exit status 2."""
    print(f"dev.py: {problem}", file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
