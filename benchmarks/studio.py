"""The studio in a real browser: how long after a slider moves the matrix and the picture are new.

The whole of it is counted, from the key that moves the pitch of the six-coil board by one step to the cells and the
picture on the page: the browser's own time, both ways of the line, the numbers or the scene, and the rendering.
"""

from __future__ import annotations

import statistics
import sys
from pathlib import Path
from typing import Any

from speed import Speed

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from support import browser

STEPS = 24

# Times in ms since the key: the first change of the matrix, the one to full accuracy, the new picture, which is marked
# as that of another design until it is there.
_WATCH = """() => {
  const since = {};
  window.since = since;
  const told = name => { since[name] ??= performance.now() - since.start };
  const matrix = document.querySelector("#matrix");
  window.watching?.forEach(one => one.disconnect());
  const cells = new MutationObserver(changes => {
    if (changes.some(change => change.target.nodeName !== "TABLE")) told("matrix");
    if (matrix.dataset.accuracy === "full") told("full");
  });
  cells.observe(matrix, {attributes: true, characterData: true, childList: true, subtree: true});
  const picture = document.querySelector("#scene img");
  const frame = document.querySelector("#scene .studio-view");
  let stale = false, decoded = null;
  const pictures = new MutationObserver(() => {
    decoded = picture.decode().catch(() => {});
    const before = stale;
    stale = frame.classList.contains("stale");
    if (before && !stale) decoded.then(() => told("picture"));
  });
  pictures.observe(picture, {attributes: true, attributeFilter: ["src"]});
  pictures.observe(frame, {attributes: true, attributeFilter: ["class"]});
  window.watching = [cells, pictures];
  document.addEventListener("keydown", () => { since.start = performance.now() }, {once: true, capture: true});
}"""


def _times() -> list[dict[str, float]]:
    """Move the slider by a step again and again, always to a pitch that was not there before."""
    times = []
    with (
        browser.served("gast2020", OPENBLAS_NUM_THREADS="1") as studio,
        browser.launched() as chromium,
        browser.opened(chromium, studio.url) as page,
    ):
        slider = page.locator("[data-key='array.pitch_mm'] [role=slider]")
        slider.focus()
        for _ in range(STEPS + 1):
            browser.drawn(page)
            browser.at_rest(page)
            page.evaluate(_WATCH)
            page.keyboard.press("ArrowRight")
            page.wait_for_function("since.full && since.picture")
            times.append(_read(page))
    return times[1:]  # the first one warms up


def _read(page: Any) -> dict[str, float]:
    since: dict[str, float] = page.evaluate("since")
    return since


def figures() -> list[Speed]:
    """Measure, or say why not."""
    problem = browser.missing()
    if problem:
        print(f"studio: not measured, {problem}", file=sys.stderr)
        return []
    times = _times()

    def row(what: str, name: str, limit: float) -> Speed:
        values = [one[name] for one in times]
        median = statistics.median(values)
        note = f"{min(values):.0f} to {max(values):.0f} ms in {len(values)} steps"
        return Speed(what, median, "ms", note, f"at most {limit:g} ms", median <= limit)

    return [
        row("studio, six coils: slider to new k matrix on the page", "matrix", 150.0),
        row("studio, six coils: slider to new picture on the page", "picture", 150.0),
    ]


if __name__ == "__main__":
    for figure in figures():
        print(figure)
