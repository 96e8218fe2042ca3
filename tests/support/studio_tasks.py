"""Tasks for the tests of jobs; they run in other processes, which find them in this module."""

import os
import time
from pathlib import Path

from coilarray.errors import GeometryError


def count_to(item, link):
    for k in range(item):
        link(k + 1, item)
    return item * item


def fail(item, link):
    if item == "ours":
        raise GeometryError("the coil must be round; got a square.")
    if item == "gone":
        os._exit(7)
    raise ZeroDivisionError("nothing to divide")


def wait_for_the_word(item, link):
    link.send(os.getpid())
    while "q" not in link.orders():
        time.sleep(0.05)
    Path(item).write_text("at rest", encoding="utf-8")


def never_listen(item, link):
    link.send(os.getpid())
    while True:
        time.sleep(1.0)


def tell_on_and_on(item, link):
    while True:
        link.send(os.getpid())
        time.sleep(0.05)
