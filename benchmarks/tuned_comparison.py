"""Time of a tuned comparison of eight suspension options on two processes, the full study of the chosen ones included.

Options and study are those of scenarios/compare/eds_135t.toml; every option gets two design variables, the requirements
that the search can judge are in its loop. Told: seconds in all, of the search alone, candidates, and processor time per
candidate. The exit status is 0 if every option has a result. Run on a quiet machine:

    OMP_NUM_THREADS=1 python benchmarks/tuned_comparison.py [GENERATIONS]
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from maglev_ctrl.scenario import load
from maglev_ctrl.study.compare import compare

SCENARIO = Path(__file__).parents[1] / "scenarios" / "compare" / "eds_135t.toml"
PROCESSES = 2
WINDING = (("spring_damper.winding.damping", "20 kN*s/m", "400 kN*s/m"), ("spring_damper.winding.lag", "5 ms", "80 ms"))
COIL = (("control.allowed[0].value", "0.1 m/s^2", "2 m/s^2"), ("actuator.coil.bandwidth", "10 Hz", "60 Hz"))
CYLINDER = (("control.allowed[0].value", "0.1 m/s^2", "2 m/s^2"), ("actuator.cylinder.bandwidth", "5 Hz", "40 Hz"))
SKY_HOOK = (("control.damping", "20 kN*s/m", "300 kN*s/m"), ("actuator.cylinder.bandwidth", "5 Hz", "40 Hz"))
VARIABLES = {
    "damper_windings": WINDING,
    "active_primary_lqr": COIL,
    "active_primary_lqg": COIL,
    "passive_secondary": (("spring_damper.damper.damping", "20 kN*s/m", "400 kN*s/m"),),
    "active_secondary_skyhook": SKY_HOOK,
    "active_secondary_lqr": CYLINDER,
    "active_secondary_lqg": CYLINDER,
    "combined": (*WINDING[:1], *SKY_HOOK[:1]),
}


def scenario_text(generations: int) -> str:
    """The scenario with design variables in every option but the bare one, which is left out."""
    head, *options = SCENARIO.read_text(encoding="utf-8").split("[[option]]")
    tail = options[-1][options[-1].index("[[requirement]]") :]
    options[-1] = options[-1][: options[-1].index("[[requirement]]")]
    kept = []
    for option in options:
        name = option.split('name = "', 1)[1].split('"', 1)[0]
        tunes = "".join(
            f'[[option.tune]]\nvalue = "{value}"\nfrom = "{low}"\nto = "{high}"\n'
            for value, low, high in VARIABLES.get(name, ())
        )
        if tunes:
            kept.append(f"[[option]]{option}{tunes}\n")
    tuning = f'[tuning]\nobjectives = ["ride", "gap", "power"]\ngenerations = {generations}\n\n'
    return head + tuning + "".join(kept) + tail


def main() -> int:
    generations = int(sys.argv[1]) if len(sys.argv) > 1 else 15
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "eight_options.toml"
        file.write_text(scenario_text(generations), encoding="utf-8")
        scenario = load(file)
        started = time.perf_counter()
        found = compare(scenario, jobs=PROCESSES)
        seconds = time.perf_counter() - started
    tuning = found.tuning
    assert tuning is not None
    asked = sum(option.evaluations for option in tuning.options)
    spent = sum(option.seconds for option in tuning.options)
    print(f"{len(tuning.options)} options, {asked} candidates, {PROCESSES} processes")
    print(
        f"whole comparison {seconds:.0f} s, of it the search {tuning.seconds:.0f} s; {1e3 * spent / asked:.0f} ms each"
    )
    for option in tuning.options:
        word = option.reason or ("meets every requirement" if option.feasible else f"misses {option.binding}")
        print(f"  {option.label}: {option.evaluations} candidates in {option.seconds:.0f} s, {word}")
    return 0 if not any(option.reason for option in tuning.options) else 1


if __name__ == "__main__":
    sys.exit(main())
