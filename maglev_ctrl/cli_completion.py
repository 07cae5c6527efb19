"""The verb `completion`: scripts for four shells, and the hidden verb `complete` that answers them at every tab key.

The scripts hand over the words of the line and know nothing of verbs and options, so that they never grow old.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator, Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Protocol, get_args, get_type_hints

import typer

from maglev_ctrl.cli_help import VERBS
from maglev_ctrl.cli_output import answer, say

if TYPE_CHECKING:

    class Parameter(Protocol):
        """What is asked of an option or argument."""

        name: str
        opts: list[str]
        multiple: bool
        hidden: bool
        is_flag: bool
        help: str | None
        param_type_name: str


_ENDINGS: Final = {
    ("check", "files"): (".toml",), ("identify", "files"): (".csv",), ("verify", "file"): (".json",),
    ("export", "file"): (".json",), ("diff", "before"): (".json",), ("diff", "after"): (".json",),
}  # fmt: skip
_LISTED: Final = re.compile(r"Any of ([\w, ]+), by commas")
Candidates = tuple[str, list[tuple[str, str]]]
"""`words` or `files`, and each candidate with a word about it."""

_BASH: Final = r"""# maglev-ctrl: completion for bash.  Put into ~/.bashrc:  eval "$(maglev-ctrl completion bash)"
_maglev_ctrl_complete() {
    local kind="" text rest
    COMPREPLY=()
    while IFS=$'\t' read -r text rest; do
        if [[ -z $kind ]]; then kind=$text; continue; fi
        if [[ $kind == files ]]; then text=${text%/}; fi
        COMPREPLY+=("$text")
    done < <("$1" complete "--current=${COMP_WORDS[COMP_CWORD]}" -- "${COMP_WORDS[@]:1:COMP_CWORD-1}" 2>/dev/null)
    if [[ $kind == files ]]; then compopt -o filenames 2>/dev/null; fi
    if [[ ${#COMPREPLY[@]} -eq 1 && ${COMPREPLY[0]} == *= ]]; then compopt -o nospace 2>/dev/null; fi
    return 0
}
complete -F _maglev_ctrl_complete maglev-ctrl
"""
_ZSH: Final = r"""#compdef maglev-ctrl
# maglev-ctrl: completion for zsh.  Save as _maglev-ctrl in a folder of $fpath, or put into ~/.zshrc after compinit:
#   eval "$(maglev-ctrl completion zsh)"
_maglev_ctrl() {
    local -a lines words_found folders described
    local line text
    lines=("${(@f)$($words[1] complete "--current=$PREFIX" -- "${(@)words[2,CURRENT-1]}" 2>/dev/null)}")
    local kind=$lines[1]
    shift lines
    for line in $lines; do
        text=${line%%$'\t'*}
        if [[ $text == */ || $text == *= ]]; then folders+=("$text"); else words_found+=("$text"); fi
        described+=("${text//:/\\:}${${line#*$'\t'}:+:${line#*$'\t'}}")
    done
    if [[ $kind == words && $#folders -eq 0 ]]; then
        _describe 'maglev-ctrl' described
    else
        (( $#words_found )) && compadd -f -- $words_found
        (( $#folders )) && compadd -S '' -f -- $folders
    fi
}
if [[ $zsh_eval_context[-1] == loadautofunc ]]; then
    _maglev_ctrl "$@"
else
    compdef _maglev_ctrl maglev-ctrl
fi
"""
_FISH: Final = r"""# maglev-ctrl: completion for fish.  Save as ~/.config/fish/completions/maglev-ctrl.fish
function __maglev_ctrl_complete
    set -l words (commandline -opc)
    set -l current (commandline -ct)
    set -l found (command $words[1] complete "--current=$current" -- $words[2..-1] 2>/dev/null)
    string join \n -- $found[2..-1]
end
complete -c maglev-ctrl -f -a '(__maglev_ctrl_complete)'
"""
_POWERSHELL: Final = r"""# maglev-ctrl: completion for PowerShell.  Put into $PROFILE:
#   maglev-ctrl completion powershell | Out-String | Invoke-Expression
Register-ArgumentCompleter -Native -CommandName maglev-ctrl -ScriptBlock {
    param($wordToComplete, $commandAst, $cursorPosition)
    $before = @($commandAst.CommandElements | Select-Object -Skip 1 |
        Where-Object { $_.Extent.EndOffset -lt $cursorPosition } | ForEach-Object { $_.Extent.Text.Trim("'", '"') })
    & maglev-ctrl complete "--current=$wordToComplete" -- @before 2>$null | Select-Object -Skip 1 | ForEach-Object {
        $text, $about = $_ -split "`t", 2
        if (-not $about) { $about = $text }
        $shown = if ($text -match '\s') { "'$text'" } else { $text }
        [System.Management.Automation.CompletionResult]::new($shown, $text, 'ParameterValue', $about)
    }
}
"""


class Shell(StrEnum):
    """Shells that can complete."""

    bash = "bash"
    zsh = "zsh"
    fish = "fish"
    powershell = "powershell"


SCRIPTS: Final = {Shell.bash: _BASH, Shell.zsh: _ZSH, Shell.fish: _FISH, Shell.powershell: _POWERSHELL}


def completion(
    shell: Annotated[Shell, typer.Argument(metavar="SHELL", help="bash, zsh, fish or powershell.", show_default=False)],
) -> None:
    """Print the script that lets a shell complete verbs, options, files, names of options and quantities.

    The first lines of each script tell where it goes.
    """
    answer({"shell": shell.value, "script": SCRIPTS[shell]})
    say(SCRIPTS[shell].rstrip())


def complete(
    context: typer.Context,
    before: Annotated[list[str] | None, typer.Argument(help="The words before the one completed.")] = None,
    current: Annotated[str, typer.Option("--current", help="What there is of the word.")] = "",
) -> None:
    """Tell a completion script what the word at the cursor may become."""
    kind, found = candidates(context.find_root().command, [*(before or []), current])
    answer({"of": kind, "candidates": [text for text, _ in found]})
    say("\n".join([kind, *(f"{text}\t{about}" for text, about in found)]))


def candidates(group: Any, words: Sequence[str]) -> Candidates:
    """What the last of `words` may become; the words are those after `maglev-ctrl`."""
    before, current = _joined(words)
    context = typer.Context(group, info_name="maglev-ctrl")
    verb = next((word for word in before if not word.startswith("-")), "")
    if not verb:
        if current.startswith("-"):
            return "words", _options(group.params, before, current)
        return "words", _verbs(group, context, current)
    command = group.get_command(context, verb)
    if command is None:
        return "words", []
    after = before[before.index(verb) + 1 :]
    takes = {
        name: one for one in command.params for name in one.opts if name.startswith("-") and not _is_flag(one)
    }  # fmt: skip
    if current.startswith("--") and "=" in current:
        name, _, value = current.partition("=")
        kind, found = _values(command, takes[name], verb, after, value) if name in takes else ("words", [])
        return kind, [(f"{name}={text}", about) for text, about in found]
    if after and after[-1] in takes:
        return _values(command, takes[after[-1]], verb, after, current)
    if current.startswith("-"):
        return "words", _options(command.params, after, current)
    arguments = [one for one in command.params if one.param_type_name == "argument"]
    if not arguments:
        return "words", []
    if verb == "help":
        return "words", _verbs(group, context, current)
    given = len(_positional(after, takes))
    return _values(command, arguments[min(given, len(arguments) - 1)], verb, after, current)


def _joined(words: Sequence[str]) -> tuple[list[str], str]:
    """The words before and the one completed; bash cuts `--format=pdf` into three, and a quote may be open."""
    before, current = list(words[:-1]), words[-1] if words else ""
    if current == "=":
        current = ""
    elif before and before[-1] == "=":
        before.pop()
    return before, current.lstrip("'\"")


def _is_flag(one: Parameter) -> bool:
    return bool(getattr(one, "is_flag", False)) or one.opts == ["--help"]


def _positional(words: Sequence[str], takes: dict[str, Parameter]) -> list[str]:
    found, skip = [], False
    for word in words:
        if not skip and not word.startswith("-"):
            found.append(word)
        skip = word in takes
    return found


def _verbs(group: Any, context: typer.Context, current: str) -> list[tuple[str, str]]:
    return [(name, VERBS[name].line) for name in group.list_commands(context)
            if name in VERBS and name.startswith(current)]  # fmt: skip


def _options(parameters: Sequence[Parameter], before: Sequence[str], current: str) -> list[tuple[str, str]]:
    found = [("--help", "Show the help.")] if "--help".startswith(current) else []
    for one in parameters:
        if one.param_type_name != "option" or getattr(one, "hidden", False) or "--help" in one.opts:
            continue
        if not one.multiple and any(name in before for name in one.opts):
            continue
        found += [(name, one.help or "") for name in one.opts if name.startswith(current) and name.startswith("--")]
    return found


def _choices(command: Any, name: str) -> list[str]:
    """Words of the enumeration that an option is declared with."""
    kind = get_type_hints(inspect.unwrap(command.callback)).get(name)
    for one in (kind, *get_args(kind)):
        if isinstance(one, type) and issubclass(one, StrEnum):
            return [choice.value for choice in one]
    return []


def _values(command: Any, one: Parameter, verb: str, before: Sequence[str], current: str) -> Candidates:
    """What one option or argument may be."""
    choices = _choices(command, one.name)
    listed = _LISTED.search(one.help or "") if one.param_type_name == "option" else None
    if listed is not None:
        done, comma, last = current.rpartition(",")
        taken = done.split(",")
        known = [name for name in re.split(r", | and ", listed[1]) if name not in taken]
        return "words", [(f"{done}{comma}{name}", "") for name in known if name.startswith(last)]
    if choices:
        return "words", [(choice, "") for choice in choices if choice.startswith(current)]
    scenario = next((Path(word) for word in before if word.endswith(".toml")), None)
    if one.name == "option":
        return "words", [(name, label) for name, label in _option_names(scenario) if name.startswith(current)]
    if one.name in ("x", "y"):
        return "words", [(f"{name}=", about) for name, about in _quantities(scenario, current)]
    if one.name == "out":
        return "files", list(_files(current, ()))
    if one.name == "scenario" or (verb, one.name) in _ENDINGS:
        return "files", list(_files(current, _ENDINGS.get((verb, one.name), (".toml",))))
    return "words", []


def _files(current: str, endings: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Folders, with a slash, and files of these endings that begin so."""
    folder, slash, start = current.rpartition("/")
    place = Path(f"{folder}{slash}" or ".").expanduser()
    try:
        entries = sorted(place.iterdir())
    except OSError:
        return
    for entry in entries:
        name = entry.name
        if not name.startswith(start) or (name.startswith(".") and not start) or "\n" in name or "\t" in name:
            continue
        if entry.is_dir():
            yield f"{folder}{slash}{name}/", ""
        elif name.endswith(tuple(endings)) and endings:
            yield f"{folder}{slash}{name}", ""


def _option_names(scenario: Path | None) -> list[tuple[str, str]]:
    """Names of a scenario's options, read as plain TOML: checking the whole file would take a second at every key."""
    import tomllib

    if scenario is None:
        return []
    try:
        options = tomllib.loads(scenario.read_text(encoding="utf-8")).get("option", [])
        return [(str(one["name"]), str(one.get("label", ""))) for one in options]
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return []  # what is wrong with the file is told by the command itself


def _quantities(scenario: Path | None, current: str) -> list[tuple[str, str]]:
    """What a map can run over; only of a scenario that is already named and right."""
    from maglev_ctrl.errors import MaglevError

    if scenario is None or "=" in current:
        return []
    from maglev_ctrl.scenario import load
    from maglev_ctrl.scenario.quantity_paths import scenario_quantities

    try:
        return [(one.name, one.label) for one in scenario_quantities(load(scenario)) if one.name.startswith(current)]
    except (MaglevError, OSError):
        return []
