"""The studio in a real browser: how long after a slider moves the coils, the matrix and the copper are new.

The whole of it is counted, from the key that moves the pitch of the six-coil board by one step to the cells and the
picture on the page: the browser's own time, both ways of the line, the numbers or the scene, and the drawing. Then the
board is turned, and the time of the page's own script in each frame is counted, and the frames.
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

TURNS = 90
WINDOW = {"width": 1280, "height": 800}

# Times in ms since the key: the first picture with the coils where they are now, the first change of the matrix, the
# one to full accuracy, and the picture of the new copper.
_WATCH = """() => {
  const since = {};
  window.since = since;
  const told = name => { since[name] ??= performance.now() - since.start };
  const matrix = document.querySelector("#matrix");
  window.watching?.disconnect();
  window.watching = new MutationObserver(changes => {
    if (changes.some(change => change.target.nodeName !== "TABLE")) told("matrix");
    if (matrix.dataset.accuracy === "full") told("full");
  });
  watching.observe(matrix, {attributes: true, characterData: true, childList: true, subtree: true});
  const before = trame.state.get("plan").digest;
  const follow = () => {
    const plan = trame.state.get("plan"), scene = trame.state.get("scene");
    if (plan.digest !== before) {
      told("coils");
      if (scene.digest === plan.digest && !trame.state.get("stale").includes("scene")) told("picture");
    }
    if (!since.picture) requestAnimationFrame(follow);
  };
  const start = () => { since.start = performance.now(); follow() };
  document.addEventListener("keydown", start, {once: true, capture: true});
}"""


def _times() -> tuple[list[dict[str, float]], list[float], float]:
    """Move the slider again and again, always to a new pitch; then turn the board.

    The last results are the times of the script in ms in each frame, and the frames a second.
    """
    times = []
    with (
        browser.served("gast2020", OPENBLAS_NUM_THREADS="1") as studio,
        browser.launched(*browser.SOFTWARE_GL) as chromium,
        browser.opened(chromium, studio.url) as page,
    ):
        page.set_viewport_size(WINDOW)
        slider = page.locator("[data-key='array.pitch_mm'] [role=slider]")
        slider.focus()
        for _ in range(STEPS + 1):
            browser.drawn(page)
            browser.at_rest(page)
            page.evaluate(_WATCH)
            page.keyboard.press("ArrowRight")
            page.wait_for_function("since.full && since.picture")
            times.append(_read(page))
        browser.drawn(page)
        box = page.locator("#board").bounding_box()
        page.mouse.move(box["x"] + 9, box["y"] + 9)
        page.mouse.down()
        page.evaluate("boardView.frames.length = boardView.scripts.length = 0")
        for k in range(TURNS):
            page.mouse.move(box["x"] + 9 + 4 * k, box["y"] + 9)
            page.wait_for_timeout(16)
        frames, scripts = page.evaluate("[boardView.frames, boardView.scripts]")
        page.mouse.up()
    return times[1:], scripts, 1e3 * (len(frames) - 1) / (frames[-1] - frames[0])  # the first one warms up


def _read(page: Any) -> dict[str, float]:
    since: dict[str, float] = page.evaluate("since")
    return since


def figures() -> list[Speed]:
    """Measure, or say why not."""
    problem = browser.missing()
    if problem:
        print(f"studio: not measured, {problem}", file=sys.stderr)
        return []
    times, scripts, rate = _times()

    def row(what: str, name: str, limit: float) -> Speed:
        values = [one[name] for one in times]
        median = statistics.median(values)
        note = f"{min(values):.0f} to {max(values):.0f} ms in {len(values)} steps"
        return Speed(what, median, "ms", note, f"at most {limit:g} ms", median <= limit)

    script = statistics.median(scripts)
    note = f"{rate:.0f} frames a second by software in a window of {WINDOW['width']} x {WINDOW['height']}"
    return [
        row("studio, six coils: slider to the coils at their new places in the picture", "coils", 100.0),
        row("studio, six coils: slider to new k matrix on the page", "matrix", 150.0),
        row("studio, six coils: slider to new copper in the picture", "picture", 1000.0),
        Speed(
            "studio, six coils: our script in a frame while turning", script, "ms", note, "at most 10 ms", script <= 10
        ),
    ]


if __name__ == "__main__":
    for figure in figures():
        print(figure)
