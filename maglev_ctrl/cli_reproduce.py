"""`maglev-ctrl reproduce`: the whole paper from geometry alone; everything heavy is loaded inside the command."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Annotated

import typer

from maglev_ctrl.cli_output import answer, manner, say, say_written
from maglev_ctrl.cli_terminal import NOT_PASSED, PASSED, Jobs, progress


def reproduce(
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for the page, its JSON and its data.")
    ] = Path("out/reproduction"),
    jobs: Jobs = 2,
    quick: Annotated[bool, typer.Option("--quick", help="Leave the sensitivity to the assumptions out.")] = False,
) -> None:
    """Compute every figure and table of the paper from geometry alone and judge every claim.

    Writes reproduction.html, reproduction.json and reproduction_data/*.csv, which replace earlier ones as a whole.
    """
    from maglev_ctrl.report.folder import require_writable
    from maglev_ctrl.report.paper.files import write_reproduction
    from maglev_ctrl.study.paper.cases import eddy_current
    from maglev_ctrl.study.paper.records import ClaimVerdict
    from maglev_ctrl.study.paper.run import reproduce as run

    require_writable(out)
    with progress("reproduce") as tell:
        found = run(eddy_current, quick=quick, jobs=jobs, progress=tell)
    paths = write_reproduction(found, out)
    if manner().as_json:
        from maglev_ctrl.report.serialise import plain

        answer({"claims": plain(found.claims), "notes": list(found.notes), "quick": found.quick})
    counts = Counter(claim.verdict for claim in found.claims)
    for verdict in ClaimVerdict:
        if counts[verdict]:
            say(f"{counts[verdict]:3d}  {verdict.value}")
    for claim in found.claims:
        if claim.verdict is ClaimVerdict.UNRESOLVED:
            say(f"UNRESOLVED: {claim.key}: {claim.why}")
    for note in found.notes:
        say(note)
    say_written(paths)
    raise typer.Exit(NOT_PASSED if counts[ClaimVerdict.UNRESOLVED] else PASSED)
