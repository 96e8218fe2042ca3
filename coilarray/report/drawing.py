"""Second process that draws pictures while this process computes.

Python draws and computes on one core at a time. The process imports Matplotlib and PyVista while the caller imports and
computes. It runs this module with ``python -m``, as a process of `multiprocessing` would run the caller's script again.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from typing import Any, BinaryIO, TypeVar

from coilarray.compute.threads import cores

Result = TypeVar("Result")
Task = tuple[Future[Any], Callable[..., Any], tuple[Any, ...]]

_OPEN: list[Drawing] = []  # one, while a block lasts
_WORTH = 2  # tasks that the other process has done by the time this process has imported Matplotlib


class Drawing:
    """Tasks of the drawing process, in order.

    Tasks that it has not begun at the end, or cannot do, are done in this process. On a computer of one core there is
    no drawing process.
    """

    def __init__(self, process: subprocess.Popen[bytes] | None) -> None:
        """Start the thread that feeds the process."""
        self._process = process
        self._todo: deque[Task] = deque()
        self._told = threading.Condition()
        self._ended = False
        self._thread = threading.Thread(target=self._serve, name="drawing", daemon=True)
        if process is not None:
            self._thread.start()

    def submit(self, function: Callable[..., Result], *arguments: Any) -> Future[Result]:
        """Submit a function of a module, whose arguments and result are pickled."""
        future: Future[Result] = Future()
        with self._told:
            self._todo.append((future, function, arguments))
            self._told.notify()
        return future

    def finish(self) -> None:
        """Finish all tasks, and help if many have not begun."""
        while len(self._todo) > (_WORTH if self._process is not None else 0) and (task := self._take()) is not None:
            _fulfil(task)
        with self._told:
            self._ended = True
            self._told.notify()
        if self._process is not None:
            self._thread.join()
        while (task := self._take()) is not None:  # tasks that the process could not do
            _fulfil(task)

    def _take(self) -> Task | None:
        with self._told:
            return self._todo.popleft() if self._todo else None

    def _serve(self) -> None:
        """Give the process its tasks until none is left or it has ended."""
        assert self._process is not None
        while True:
            with self._told:
                self._told.wait_for(lambda: self._todo or self._ended)
                if not self._todo:
                    return
                task = self._todo.popleft()
            future, function, arguments = task
            try:
                result, error = _asked(self._process, (function, arguments))
            except Exception:  # the process has ended, or something cannot be pickled
                with self._told:
                    self._todo.appendleft(task)
                return
            if error is None:
                future.set_result(result)
            else:
                future.set_exception(error)


def _fulfil(task: Task) -> None:
    future, function, arguments = task
    try:
        future.set_result(function(*arguments))
    except Exception as error:
        future.set_exception(error)


def _asked(process: subprocess.Popen[bytes], question: object) -> tuple[Any, Exception | None]:
    """Return the answer of the process to a question."""
    assert process.stdin is not None
    assert process.stdout is not None
    pickle.dump(question, process.stdin, pickle.HIGHEST_PROTOCOL)
    process.stdin.flush()
    answer: tuple[Any, Exception | None] = pickle.load(process.stdout)
    return answer


@contextmanager
def drawing_beside() -> Iterator[Drawing]:
    """Draw in another process while the block runs.

    There is no other process on a single core. It ends with the block. A block within this block draws in the same
    process, which a command starts before its imports.
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
    try:
        _OPEN.append(Drawing(process))
        yield _OPEN[0]
    finally:
        _OPEN.clear()
        process.kill()
        for stream in (process.stdin, process.stdout):
            if stream is not None:
                with suppress(OSError):  # a question on its way
                    stream.close()
        process.wait()


def _draw(questions: BinaryIO, answers: BinaryIO) -> None:
    """Answer tasks until no more can come."""
    from coilarray import viz
    from coilarray.compute.memory import collect_seldom

    collect_seldom()
    threading.Thread(target=viz.rendering_problem, daemon=True).start()  # asks a process that takes a second
    from matplotlib.backends import backend_agg  # noqa: F401 - loaded before the first task comes

    from coilarray.report import figures  # noqa: F401

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
