"""Tasks in processes of this machine."""

from __future__ import annotations

import os
import pickle
import signal
import traceback
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing import get_context, resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from queue import SimpleQueue
from threading import Thread
from typing import Any

from coilarray.compute.workers.pool import IN_FLIGHT, Pool, one_thread, outcome_of
from coilarray.errors import ClusterError

_TRIES = 3  # of a task whose process ends
_GOODBYE = 5.0  # s that a process has to end by itself


@dataclass
class _Task:
    """A task in flight in a local process, pickled."""

    tag: int
    payload: bytes
    tries: int = 0


@dataclass
class _Worker:
    """A local process, and the tickets of what it was sent, in that order."""

    process: BaseProcess
    connection: Connection
    tickets: deque[int] = field(default_factory=deque)


class LocalPool(Pool):
    """Processes of this machine, started when there is work; one that ends is replaced, and its tasks sent again."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._context = get_context("spawn")  # OpenMP kills forked children
        self._tasks: dict[int, _Task] = {}
        self._ticket = 0
        self._workers: list[_Worker] = []

    @property
    def capacity(self) -> int:
        """See `Pool.capacity`."""
        return IN_FLIGHT * self._count

    @property
    def in_flight(self) -> int:
        """See `Pool.in_flight`."""
        return len(self._tasks)

    def submit(self, tag: int, function: Callable[[Any], Any], item: Any) -> None:
        """See `Pool.submit`."""
        self._ticket += 1
        self._tasks[self._ticket] = _Task(tag, pickle.dumps((function, item)))
        if len(self._workers) < self._count and all(worker.tickets for worker in self._workers):
            self._workers.append(self._start())
        self._send(min(self._workers, key=lambda worker: len(worker.tickets)), self._ticket)

    def collect(self) -> tuple[int, Any]:
        """See `Pool.collect`."""
        while self._tasks:
            by_connection = {worker.connection: worker for worker in self._workers if worker.tickets}
            for connection in wait(list(by_connection)):
                worker = by_connection[connection]  # type: ignore[index]  # wait returns what it was given
                try:
                    ticket, outcome, error = worker.connection.recv()
                except (EOFError, OSError):
                    self._replace(worker)
                    break
                worker.tickets.remove(ticket)
                task = self._tasks.pop(ticket, None)
                if task is None:  # dropped
                    break
                if error is not None:
                    raise error
                return task.tag, outcome
        raise IndexError("no task is in flight.")

    def drop(self) -> None:
        """See `Pool.drop`; what is being computed goes on, and its outcome is thrown away."""
        self._tasks.clear()

    def close(self) -> None:
        """See `Pool.close`."""
        self._tasks.clear()
        for worker in self._workers:
            worker.connection.close()  # which ends the process, whatever it does
        for worker in self._workers:
            _end(worker.process)

    def _start(self) -> _Worker:
        ours, theirs = self._context.Pipe()
        process = self._context.Process(target=_serve, args=(theirs,), daemon=True, name="coilarray-worker")
        with _no_interrupt():  # an interrupt is for this process, which then ends the others
            process.start()
        theirs.close()
        return _Worker(process, ours)

    def _send(self, worker: _Worker, ticket: int) -> None:
        worker.tickets.append(ticket)
        try:
            worker.connection.send((ticket, self._tasks[ticket].payload))
        except OSError:
            self._replace(worker)

    def _replace(self, worker: _Worker) -> None:
        """Start another process for one that ended, and send what it had again."""
        worker.connection.close()
        _end(worker.process)
        self._workers.remove(worker)
        tickets = [ticket for ticket in worker.tickets if ticket in self._tasks]
        if not tickets:
            return
        first = self._tasks[tickets[0]]  # which it computed; the other only waited
        first.tries += 1
        if first.tries >= _TRIES:
            self.drop()
            code = worker.process.exitcode or 0
            script = 'a script must ask for workers under if __name__ == "__main__".'
            hint = "is there memory enough?" if code < 0 else script
            raise ClusterError(
                f"a local process ended {_TRIES} times at one task, with exit code {code}; {hint}"
            ) from None
        fresh = self._start()
        self._workers.append(fresh)
        for ticket in tickets:
            self._send(fresh, ticket)


@contextmanager
def _no_interrupt() -> Iterator[None]:
    """Block Ctrl-C while the block runs; a process that is started in it never gets one."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # else it is started with the first process, and unblocks for that one
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end(process: BaseProcess) -> None:
    """Wait for a process that was told to end, not for long."""
    process.join(_GOODBYE)
    if process.exitcode is None:
        process.kill()
        process.join()


def _serve(connection: Connection) -> None:
    """Compute tasks until the other side closes the connection."""
    tasks: SimpleQueue[bytes] = SimpleQueue()
    Thread(target=_receive, args=(connection, tasks), daemon=True).start()
    with one_thread():
        while True:
            ticket, payload = pickle.loads(tasks.get())
            connection.send_bytes(_reply(ticket, payload))


def _receive(connection: Connection, tasks: SimpleQueue[bytes]) -> None:
    """Take tasks from the connection; its end, even in the middle of a task, ends the process."""
    with suppress(EOFError, OSError):
        while True:
            tasks.put(connection.recv_bytes())
    os._exit(0)


def _reply(ticket: int, payload: bytes) -> bytes:
    """Compute one task, and pickle its ticket, its outcome and what went wrong."""
    try:
        function, item = pickle.loads(payload)
        return pickle.dumps((ticket, outcome_of(function, item), None))
    except Exception as error:
        return pickle.dumps((ticket, None, _portable(error)))


def _portable(error: Exception) -> Exception:
    """Return an error as it can be sent, with the place where it was raised as a note."""
    text = "in a worker process:\n" + "".join(traceback.format_exception(error))
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(text)
    error.add_note(text)
    return error
