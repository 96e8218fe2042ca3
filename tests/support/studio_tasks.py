"""Tasks for the tests of jobs; they run in other processes, which find them in this module."""

import os
import time
from pathlib import Path

from coilarray.errors import GeometryError
from coilarray.viz.studio.job import progress_of


def count_to(item, tell, stopped):
    progress = progress_of(tell)
    for k in range(item):
        progress(k + 1, item)
    return item * item


def fail(item, tell, stopped):
    if item == "ours":
        raise GeometryError("the coil must be round; got a square.")
    if item == "gone":
        os._exit(7)
    raise ZeroDivisionError("nothing to divide")


def wait_for_the_word(item, tell, stopped):
    tell(os.getpid())
    while not stopped():
        time.sleep(0.05)
    Path(item).write_text("at rest", encoding="utf-8")


def never_listen(item, tell, stopped):
    tell(os.getpid())
    while True:
        time.sleep(1.0)


def tell_on_and_on(item, tell, stopped):
    while True:
        tell(os.getpid())
        time.sleep(0.05)
