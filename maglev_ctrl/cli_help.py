"""What `--help` says of each verb beside its options: its group, one line, examples, and what its exit status means."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from typer.core import TyperGroup

GROUPS: Final = ("Study", "Design", "Look closer", "Files", "Shell")
_COMMON: Final = (
    ("2", "wrong input: one sentence says what"),
    ("130", "interrupted by Ctrl-C"),
    ("143", "ended by the system"),
)
_TRAIN: Final = "scenarios/compare/warwick_30t.toml"


@dataclass(frozen=True, eq=False, slots=True)
class VerbHelp:
    """One verb: `status` tells what 0 and 1 mean; the others mean the same everywhere."""

    group: str
    line: str
    examples: tuple[str, ...]
    status: tuple[tuple[str, str], ...] = (("0", "done"),)


VERBS: Final[dict[str, VerbHelp]] = {
    "report": VerbHelp(
        "Study", "Run the whole study of a scenario and write its report.",
        (f"report {_TRAIN}", "report train.toml --out out/monday --format html,json --jobs 4",
         "report train.toml --json | jq .verdict"),
        (("0", "every option passes every hard requirement"), ("1", "some do not, or could not be judged")),
    ),
    "compare": VerbHelp(
        "Study", "Tune the options, run the study on them, rank them.",
        ("compare scenarios/compare/four_options.toml", "compare train.toml --as-written --quiet",
         "compare train.toml --json | jq '.ranking[0].label'"),
        (("0", "every option passes every hard requirement"), ("1", "some do not, or could not be judged")),
    ),
    "map": VerbHelp(
        "Study", "Map where each option is stable over any two quantities.",
        ("map scenarios/periodic/girder_passing.toml", "map train.toml --list-quantities",
         "map train.toml --x speed=50m/s:160m/s:200 --y payload=0t:30t:50"),
        (("0", "every option has its map"), ("1", "an option has no map or UNRESOLVED points")),
    ),
    "sweep": VerbHelp(
        "Study", "Compute every option at many points, here or on a cluster.",
        ("sweep train.toml --grid speed=20:150:200 --grid payload=0:20t:50",
         "sweep train.toml --vary vehicle.car.mass=20t~5% --points 1000",
         "sweep train.toml --grid speed=20:150:9 --cluster tcp://node:8786"),
        (("0", "every point has an answer"), ("1", "some points are UNRESOLVED or have no answer")),
    ),
    "simulate": VerbHelp(
        "Study", "Simulate one option with its full force map.",
        (f"simulate {_TRAIN} --option windings", 'simulate train.toml --speed "400 km/h" --duration "30 s"',
         "simulate train.toml --option lqr --runs 4 --runs-only"),
        (("0", "nothing touched; linear and nonlinear agree"),
         ("1", "something touched, ended early or does not agree")),
    ),
    "diff": VerbHelp(
        "Study", "Tell what changed from one report to another.",
        ("diff out/before out/after", "diff out/before out/after --tolerance 1e-4",
         "diff out/before/report.json out/after/report.json --json"),
        (("0", "the second is at least as good"), ("1", "some requirement or option is worse or gone")),
    ),
    "ui": VerbHelp(
        "Study", "Open the workbench: a page on this machine.",
        ("ui", f"ui {_TRAIN}", "ui train.toml --port 5010 --no-open"),
    ),
    "design": VerbHelp(
        "Design", "Design every option's control law, prove it, export it.",
        ("design scenarios/design/lqr_primary.toml", "design train.toml --option lqr --out out/lqr",
         "design train.toml --json | jq '.options[].verdict'"),
        (("0", "every law is proved"), ("1", "some law does not exist or is not proved")),
    ),
    "verify": VerbHelp(
        "Design", "Prove every claim of a design file again, without a solver.",
        ("verify out/lqr_primary/design.json", "verify design.json --quiet && echo proved"),
        (("0", "everything is proved"), ("1", "something is not, or the file was changed")),
    ),
    "export": VerbHelp(
        "Design", "Write a proved controller for MATLAB, C, Python or as JSON.",
        ("export out/lqr_primary/design.json --to python", 'export design.json --to c --period "2 ms"',
         "export design.json --to mat --option lqr --out matlab"),
        (("0", "written"),),
    ),
    "forces": VerbHelp(
        "Look closer", "Compute the magnets' forces over height, gap and speed.",
        ("forces scenarios/paper/double_l.toml", "forces train.toml --accuracy draft --out out/draft"),
        (("0", "the tables are written"),),
    ),
    "identify": VerbHelp(
        "Look closer", "Find m, c, k from forced oscillations, with 95 % intervals.",
        ("identify scenarios/data/forced_oscillation.csv", "identify monday.csv tuesday.csv --out out/rig",
         "identify rig.csv --json | jq '.series[].damping'"),
        (("0", "every m, c, k is told"), ("1", "some m, c or k cannot be told")),
    ),
    "reproduce": VerbHelp(
        "Look closer", "Compute the paper from geometry alone and judge every claim.",
        ("reproduce", "reproduce --quick --out out/paper"),
        (("0", "no claim is UNRESOLVED"), ("1", "a claim is UNRESOLVED: two ways to it disagree")),
    ),
    "check": VerbHelp(
        "Files", "Say what is wrong with scenario files, line and column.",
        ("check train.toml", "check scenarios/*/*.toml --quiet", "check train.toml --json | jq '.files[].faults'"),
        (("0", "every file is valid"),),
    ),
    "new": VerbHelp(
        "Files", "Write NAME.toml, a commented scenario to start from.",
        ("new my_train", "new my_train --out studies"),
        (("0", "written"),),
    ),
    "schema": VerbHelp(
        "Files", "The scenario format as a JSON Schema, for editors.",
        ("schema", "schema --out ."),
    ),
    "completion": VerbHelp(
        "Shell", "Print the completion script of a shell.",
        ('eval "$(maglev-ctrl completion bash)"', "completion zsh > ~/.zfunc/_maglev-ctrl",
         "completion fish > ~/.config/fish/completions/maglev-ctrl.fish"),
    ),
    "help": VerbHelp("Shell", "Show the help of a verb.", ("help map",)),
    "version": VerbHelp("Shell", "Print the version.", ("version", "version --verbose", "version --json")),
}  # fmt: skip

ROOT_EPILOG: Final = """\
`maglev-ctrl help VERB` has each verb's options and examples.

\b
Exit status:
  0    every requirement passes; what was asked is done
  1    some requirement fails or could not be evaluated
  2    wrong input: one sentence says what
  130  interrupted by Ctrl-C
  143  ended by the system
"""


def epilog(verb: str) -> str:
    """Examples and exit status under a verb's options; empty for a verb that is not listed.

    Examples
    --------
    >>> print(epilog("verify").replace(chr(8), "").strip())
    Examples:
      maglev-ctrl verify out/lqr_primary/design.json
    ...
    """
    found = VERBS.get(verb)
    if found is None:
        return ""
    commands = [one if one.startswith("eval") else f"maglev-ctrl {one}" for one in found.examples]
    examples = "\n".join(f"  {one}" for one in commands)
    status = "\n".join(f"  {number:<4} {meaning}" for number, meaning in (*found.status, *_COMMON))
    return f"\b\nExamples:\n{examples}\n\n\b\nExit status:\n{status}\n"


class VerbGroup(TyperGroup):
    """The verbs in groups, each in one whole line."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Every visible verb under the heading of its group."""
        shown = [name for name in self.list_commands(ctx) if name in VERBS]
        for group in GROUPS:
            rows = [(name, VERBS[name].line) for name in VERBS if name in shown and VERBS[name].group == group]
            if rows:
                with formatter.section(group):
                    formatter.write_dl(rows)
