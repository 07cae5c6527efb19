"""The command line: `maglev-ctrl report SCENARIO`. Everything heavy is loaded inside the command that needs it."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Annotated, Any, NoReturn

import typer

from maglev_ctrl.cli_completion import complete, completion
from maglev_ctrl.cli_design import design, export, verify
from maglev_ctrl.cli_diff import diff
from maglev_ctrl.cli_files import check, new, schema
from maglev_ctrl.cli_forces import forces
from maglev_ctrl.cli_help import ROOT_EPILOG, VERBS, VerbGroup, epilog
from maglev_ctrl.cli_identify import identify
from maglev_ctrl.cli_map import stability_map
from maglev_ctrl.cli_output import Manner, adopt, answer, complain, conversation, finish, say
from maglev_ctrl.cli_report import compare, report
from maglev_ctrl.cli_reproduce import reproduce
from maglev_ctrl.cli_simulate import simulate
from maglev_ctrl.cli_sweep import sweep
from maglev_ctrl.cli_terminal import (
    BAD_INPUT,
    PASSED,
    READER_GONE,
    AsJson,
    Quiet,
    Stopped,
    Verbose,
    with_manner,
)  # fmt: skip
from maglev_ctrl.cli_ui import ui

_UsageError: type[Any] = typer.BadParameter.__mro__[1]  # the command line library's own, wherever typer keeps it
_ClickError: type[Any] = typer.BadParameter.__mro__[2]

app = typer.Typer(
    name="maglev-ctrl",
    help="Stability of maglev vehicles: compare suspension options and report their margins.",
    epilog=ROOT_EPILOG,
    cls=VerbGroup,
    no_args_is_help=True,
    subcommand_metavar="VERB ...",
    add_completion=False,  # the verb `completion` has it
    rich_markup_mode=None,  # rich would double the time `--help` takes
    pretty_exceptions_enable=False,
)


def _add(function: Callable[..., None], name: str | None = None, *, hidden: bool = False) -> None:
    """A verb with its examples, its exit status and the options every verb has."""
    verb = name or function.__name__
    line = VERBS[verb].line if verb in VERBS else None
    app.command(verb, epilog=epilog(verb), short_help=line, hidden=hidden)(with_manner(function, verb))


def _version_and_end(asked: bool) -> None:
    if asked:
        version()
        raise typer.Exit(PASSED)


@app.callback()
def root(
    as_json: AsJson = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    show_version: Annotated[
        bool, typer.Option("--version", callback=_version_and_end, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Stability of maglev vehicles: compare suspension options and report their margins."""
    adopt(Manner(as_json, quiet, verbose))


def version() -> None:
    """Print the version."""
    from maglev_ctrl import __version__

    answer({"version": __version__})
    say(f"maglev-ctrl {__version__}")


def show_help(
    context: typer.Context,
    verb: Annotated[str | None, typer.Argument(metavar="[VERB]", help="A verb.", show_default=False)] = None,
) -> None:
    """Show the help of a verb, or of all of them."""
    from difflib import get_close_matches

    group: Any = context.find_root().command
    top = typer.Context(group, info_name="maglev-ctrl")
    command = group if verb is None else group.get_command(top, verb)
    if command is None:
        near = get_close_matches(str(verb), group.list_commands(top), n=1)
        hint = f'; did you mean "{near[0]}"?' if near else ""
        raise typer.BadParameter(f'there is no verb "{verb}"{hint}')
    text = command.get_help(top if verb is None else typer.Context(command, info_name=verb, parent=top))
    answer({"help": text})
    say(text)


for _verb in (report, compare, sweep, simulate, diff, ui, design, verify, export, forces, identify, reproduce, check,
              new, schema, completion, version):  # fmt: skip
    _add(_verb)
_add(stability_map, "map")
_add(show_help, "help")
_add(complete, hidden=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command line (default: this process's) and return its exit status; faults end in one message, no traceback.

    Examples
    --------
    >>> main(["version"])
    maglev-ctrl ...
    0
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    options = words[: words.index("--")] if "--" in words else words
    # Faults of usage are found before any option is read, and must be answered in the form that was asked for.
    with conversation(Manner(as_json="--json" in options)):
        status = _run(words)
        try:
            finish(status)
            sys.stdout.flush()
        except OSError:
            status = READER_GONE
        if status == READER_GONE:
            _forget_output()
        return status


def command() -> NoReturn:
    """The process of `maglev-ctrl`: runs its command line and ends with its exit status.

    Threads that still compute for nobody, as behind a page that was closed, are not waited for; Python would end them
    by force while it takes itself apart, which compiled code in them answers with an abort.
    """
    status = main()
    if any(one.daemon for one in threading.enumerate()):
        with suppress(OSError, ValueError):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(status)
    sys.exit(status)


def _run(words: list[str]) -> int:
    from maglev_ctrl.errors import MaglevError

    try:
        with _stop_on_signals():
            status = app(args=words, prog_name="maglev-ctrl", standalone_mode=False)
            return status if isinstance(status, int) else PASSED
    except SystemExit as done:  # only where the output is gone while help is printed
        return READER_GONE if done.code else PASSED
    except _ClickError as error:
        if type(error).__name__ == "NoArgsIsHelpError":
            typer.echo(error.format_message())
            return BAD_INPUT
        complain(_usage_words(error))
    except typer.Abort:
        complain("ended: no answer was given")
    except MaglevError as error:
        complain(error)
    except Stopped as stop:
        complain(stop.message)
        return stop.status
    except OSError as error:
        complain(f"{error.filename or 'file'}: {error.strerror or error}")
    return BAD_INPUT


def _usage_words(error: Any) -> str:
    """A fault of usage in a sentence, with the help that tells more."""
    words = " ".join(str(error.format_message()).split()).rstrip(".")
    context = getattr(error, "ctx", None)
    path = context.command_path if context is not None else "maglev-ctrl"
    return f"{words} (see `{path} --help`)" if isinstance(error, _UsageError) else words


def _forget_output() -> None:
    """Nobody reads any more: what is still kept for the output must not be complained of when Python ends."""
    try:
        number = sys.stdout.fileno()
    except (OSError, ValueError):
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, number)
    os.close(nowhere)


@contextmanager
def _stop_on_signals() -> Iterator[None]:
    """SIGINT and SIGTERM raise Stopped, so that workers end and temporary files go; handlers are put back after."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number: int, frame: FrameType | None) -> None:
        raise Stopped(128 + number)  # 130 and 143, as shells have it

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


if __name__ == "__main__":
    sys.exit(main())
