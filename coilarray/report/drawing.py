"""Second process that draws pictures while this process computes.

Python draws and computes on one core at a time, and the import of Matplotlib and PyVista takes
long. The process runs this module with ``python -m``, as a process of `multiprocessing` would run
the caller's script again.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from typing import Any, BinaryIO, TypeVar

from coilarray.compute.threads import cores

Result = TypeVar("Result")
Task = tuple[Future[Any], Callable[..., Any], tuple[Any, ...]]

_OPEN: list[Drawing] = []  # one, while a block lasts
_WORTH = 2  # tasks that the other process has done by the time this process has imported Matplotlib


class Drawing:
    """Tasks of the drawing process, in order.

    Tasks that it has not begun at the end, or cannot do, are done in this process. On a computer of
    one core there is no drawing process.
    """

    def __init__(self, process: subprocess.Popen[bytes] | None) -> None:
        self._process = process
        self._asking = ThreadPoolExecutor(1, "drawing")
        self._tasks: list[Task] = []
        self._answers: list[Future[None]] = []

    def submit(self, function: Callable[..., Result], *arguments: Any) -> Future[Result]:
        """Submit a module's function, with pickled arguments and result."""
        task: Task = (Future(), function, arguments)
        self._tasks.append(task)
        if self._process is not None:
            self._answers.append(self._asking.submit(_ask, self._process, task))
        return task[0]

    def finish(self) -> None:
        """Finish all tasks, and help if many have not begun."""
        if sum(not answer.done() for answer in self._answers) > _WORTH:
            for task, answer in zip(reversed(self._tasks), reversed(self._answers), strict=True):
                if answer.cancel():
                    _fulfil(task)
        self._asking.shutdown()
        for task in self._tasks:
            if not task[0].done():  # the process could not do it
                _fulfil(task)

    def end(self) -> None:
        """End the process, and forget what has not begun."""
        if self._process is not None:
            self._process.kill()
            self._asking.shutdown(cancel_futures=True)
            for stream in (self._process.stdin, self._process.stdout):
                with suppress(OSError, AttributeError):  # a question on its way
                    stream.close()  # type: ignore[union-attr]
            self._process.wait()


def _fulfil(task: Task) -> None:
    future, function, arguments = task
    try:
        future.set_result(function(*arguments))
    except Exception as error:
        future.set_exception(error)


def _ask(process: subprocess.Popen[bytes], task: Task) -> None:
    future, *question = task
    try:
        assert process.stdin is not None
        assert process.stdout is not None
        # whole or not at all: another thread may change what is cached in a design meanwhile
        process.stdin.write(pickle.dumps(question, pickle.HIGHEST_PROTOCOL))
        process.stdin.flush()
        result, error = pickle.load(process.stdout)
    except Exception:
        return
    if error is None:
        future.set_result(result)
    else:
        future.set_exception(error)


@contextmanager
def drawing_beside() -> Iterator[Drawing]:
    """Draw in another process while the block runs.

    There is no other process on a single core. A block within this block draws in the same process,
    which a command starts before its imports.
    """
    if _OPEN or cores() == 1:
        yield _OPEN[0] if _OPEN else Drawing(None)
        return
    # its search path is the same as here and no longer: -P keeps the working folder off
    path = os.pathsep.join(folder or os.getcwd() for folder in sys.path)
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", __name__], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": path, "COILARRAY_THREADS": "1"},
        start_new_session=True,  # an interrupt from the keyboard is for this process, which ends the drawing process
    )  # fmt: skip
    drawing = Drawing(process)
    try:
        _OPEN.append(drawing)
        yield drawing
    finally:
        _OPEN.clear()
        drawing.end()


def _draw(questions: BinaryIO, answers: BinaryIO) -> None:
    from coilarray import viz
    from coilarray.compute.memory import collect_seldom

    collect_seldom()
    threading.Thread(target=viz.rendering_problem, daemon=True).start()  # asks a process that takes a second
    from matplotlib.backends import backend_agg  # noqa: F401 - loaded before the first task comes

    from coilarray.report import page  # noqa: F401

    while True:
        try:
            function, arguments = pickle.load(questions)
        except EOFError:
            return
        answer: tuple[Any, Exception | None]
        try:
            answer = function(*arguments), None
        except Exception as error:
            answer = None, error
        pickle.dump(answer, answers, pickle.HIGHEST_PROTOCOL)
        answers.flush()


if __name__ == "__main__":
    replies = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # output of libraries is not an answer
    with suppress(BrokenPipeError, KeyboardInterrupt):
        _draw(sys.stdin.buffer, replies)
    os._exit(0)  # ends at once, even if threads still wait
