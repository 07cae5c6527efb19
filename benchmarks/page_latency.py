"""From a slider on the workbench page to the frame on the screen, in chromium: six freedoms, a 100 x 100 map.

The option with windings and actuators of the 135 t train. A move is an input event of a slider; it is shown with the
frame in which eigenvalues, ledger and mode shapes of the new values are drawn, and whole with the one in which the
lines over speed and the map are drawn as well, where the value changes them; the map is faint in between. Half of the
moves follow each other at once, as in a drag; before the others the page rests, so that the slow check has begun and
has to be given up. The page is ready when the first view is drawn, counted from the navigation; the first one opened
finds the server just begun. The exit status is 1 if the median until a move is shown is above 150 ms or the first page
is ready later than after 3 s. The load of the machine is
printed: figures of one that does other work at the same time say little. Run it alone:

    python benchmarks/page_latency.py
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "browser"))

MOVES = 30
LARGEST_MEDIAN = 150.0  # ms
LATEST_READY = 3.0  # s
CALM = 1.0  # of the load average over a minute, per processor, before the run
ADDRESS = "?scenario=compare/eds_135t&option=combined"

MOVE = """
([name, step]) => new Promise((done, fail) => {
  const root = document.documentElement, live = Bokeh.documents.find(d => d.get_model_by_name("bridge"))
  const drawn = (figure) => {
    const model = live.get_model_by_name(figure)
    return model.renderers.map(r => r.data_source.data)
  }
  const values = () => drawn("eigenvalues").find(d => d.own_growth).own_growth.join()
  const before = values(), slider = document.getElementById(`slide-${name}`), began = performance.now()
  const from = Number(root.dataset.shown)
  let first = null
  const look = () => {
    const now = performance.now()
    if (first === null && Number(root.dataset.shown) > from && values() !== before) first = now - began
    if (first !== null && root.dataset.state !== "busy") done([first, now - began])
    else if (now - began > 20000) fail(new Error(`${name}: nothing new is shown`))
    else requestAnimationFrame(look)
  }
  slider.value = step
  slider.dispatchEvent(new Event("input", {bubbles: true}))
  requestAnimationFrame(look)
})
"""


def main() -> int:
    from browser_watch import HOW_TO_INSTALL, Watch, find_chromium, launched
    from page_server import Bench, Server
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        if find_chromium(playwright.chromium.executable_path) is None:
            print(f"not measured: {HOW_TO_INSTALL}")
            return 0
        load = os.getloadavg()[0] / (os.cpu_count() or 1)
        with launched(playwright) as browser:
            begun = time.perf_counter()
            server = Server(Path(folder))
            address = time.perf_counter() - begun
            try:
                watch = Watch(browser, "latency")
                first, second = (ready(watch, server.address + ADDRESS) for _ in range(2))
                bench = Bench.open(watch, server.address + ADDRESS)
                measured, computed = moves(bench)
                watch.close()
            finally:
                server.stop()
    for name, values in measured.items():
        soon, whole = np.array(values).T
        print(f"{name:46s} shown {np.median(soon):5.0f} ms, at worst {np.max(soon):5.0f}; "
              f"whole {np.median(whole):5.0f} ms, at worst {np.max(whole):5.0f}; {len(soon)} moves")  # fmt: skip
    shown, whole = np.concatenate([np.array(values) for values in measured.values()]).T
    median, late = np.quantile(shown, [0.5, 0.9])
    verdict = "ok" if median <= LARGEST_MEDIAN else "TOO SLOW"
    print(f"slider to screen: median {median:.0f} ms, 90 % {late:.0f} ms; at most {LARGEST_MEDIAN:.0f} ms: {verdict}")
    print(f"with lines and map over speed: median {np.median(whole):.0f} ms, 90 % {np.quantile(whole, 0.9):.0f} ms")
    print(f"computed by the server: median {np.median(computed):.0f} ms, 90 % {np.quantile(computed, 0.9):.0f} ms")
    in_time = "ok" if first <= LATEST_READY else "TOO SLOW"
    print(f"page ready: {first:.1f} s, a second one {second:.1f} s; at most {LATEST_READY:.0f} s: {in_time}")
    print(f"address printed {address:.1f} s after the command")
    told = "calm" if load <= CALM else "LOADED, the figures are of a machine with other work"
    print(f"load before the run {load:.1f} per processor: {told}")
    return int(median > LARGEST_MEDIAN or first > LATEST_READY)


def ready(watch, address: str) -> float:  # type: ignore[no-untyped-def]
    """Seconds from the navigation to the first view on the screen."""
    page = watch.page()
    page.goto(address, wait_until="commit", timeout=60_000)
    page.wait_for_function("Number(document.documentElement.dataset.shown) > 0", timeout=60_000)
    seconds = float(page.evaluate("performance.now()")) / 1e3
    page.close()
    return seconds


def moves(bench) -> tuple[dict[str, list[list[float]]], list[float]]:  # type: ignore[no-untyped-def]
    """Milliseconds until every move is shown and whole, by slider, sliders in turn; and what the server computed."""
    names = [str(one.get_attribute("id")) for one in bench.page.locator("#sliders input[type=range]").all()]
    names.remove("slide-depth")  # it changes no eigenvalue: its cursor moves in the browser, without the server
    found: dict[str, list[list[float]]] = {}
    computed: list[float] = []
    rng = np.random.default_rng(1)
    for k in range(MOVES):
        name = names[k % len(names)].removeprefix("slide-")
        bench.page.wait_for_timeout(600 if k % 2 else 60)
        step = int(rng.integers(300, 700))
        found.setdefault(name, []).append(bench.page.evaluate(MOVE, [name, step]))
        computed.append(1e3 * float(bench.page.evaluate("document.documentElement.dataset.seconds")))
    return found, computed


if __name__ == "__main__":
    sys.exit(main())
