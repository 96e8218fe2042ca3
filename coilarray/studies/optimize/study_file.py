"""Trials of a search on disk: an Optuna study in SQLite that holds only finished trials.

A sampler that works on a study on disk takes one transaction for every parameter and attribute: 45 ms per trial with
six variables. Here the sampler works on a study in memory, and each finished trial is written in one transaction. A
killed run leaves no half-finished trial behind.
"""

from __future__ import annotations

import os
import re
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING

from coilarray.compute.extras import import_extra
from coilarray.compute.files import make_folder
from coilarray.compute.store import content_key, delete_database, locked_database
from coilarray.design.model import Design
from coilarray.errors import OutputError
from coilarray.studies.optimize.goal import Goal

if TYPE_CHECKING:
    from optuna.storages import RDBStorage
    from optuna.study import Study
    from optuna.trial import FrozenTrial

FILE = "study.db"
"""Name of the database in the folder of the results. Any tool for Optuna reads it."""


class StudyFile:
    """Study on disk, made by `open_study`."""

    def __init__(self, study: Study) -> None:
        self._study = study

    def trials(self) -> list[FrozenTrial]:
        """Return every trial, in the order of writing.

        Raises OutputError for a damaged file.
        """
        try:
            return self._study.get_trials(deepcopy=False)
        except Exception as error:  # Optuna lets through the errors of SQLAlchemy and of JSON readers
            raise OutputError(f"cannot use {FILE}, it is damaged: {_first_line(error)}.") from None

    def add(self, trial: FrozenTrial) -> None:
        """Write a finished trial completely or not at all.

        Raises OutputError on failure.
        """
        from optuna.exceptions import StorageInternalError

        try:
            self._study.add_trial(trial)
        except StorageInternalError as error:
            raise OutputError(f"cannot write {FILE}: {_first_line(error)}.") from None


@contextmanager
def open_study(folder: Path, design: Design, goal: Goal) -> Iterator[StudyFile]:
    """Open or make the study of a goal.

    It also belongs to a design. It is a context manager on a folder. The folder may hold studies of other designs and
    goals too. A study is identified by the code and by the whole goal except its trials, polish and watch. Raises
    OutputError if the file cannot be written or holds something else, or if another search is running in the folder,
    and MissingDependencyError if Optuna is not installed.
    """
    optuna = import_extra("optuna", "studies of an optimisation", package="Optuna", extra="optimize")
    from sqlalchemy import event

    make_folder(folder)
    path = folder / FILE
    busy = f"another search is running in {folder}; wait for it or give another folder."
    with locked_database(folder / "study.lock", busy), quiet():
        there = path.exists()
        try:
            storage = storage_on(path.resolve())
            event.listen(storage.engine, "connect", _without_waiting)
            storage.engine.dispose()  # open connections are not aware of it
            study = optuna.create_study(
                storage=storage, study_name=study_name(design, goal), directions=goal.directions, load_if_exists=True
            )
        except Exception as error:  # Optuna lets through the errors of SQLAlchemy and Alembic
            if not there:
                delete_database(path)
            raise OutputError(f"cannot use {path}: {_first_line(error)}.") from None
        try:
            yield StudyFile(study)
        finally:
            storage.remove_session()
            storage.engine.dispose()


def storage_on(file: Path | str, *, as_it_is: bool = False) -> RDBStorage:
    """Return Optuna's storage on a database.

    The file is a path or, in SQLite's form, ``file:…?mode=ro``. Optuna takes a URL, in which names with %, ? or # are
    read differently by different versions of SQLAlchemy. A database taken `as_it_is` is not completed first.
    """
    from optuna.storages import RDBStorage

    def connect() -> sqlite3.Connection:
        return sqlite3.connect(file, uri=isinstance(file, str), check_same_thread=False)

    url, options = f"sqlite:///{FILE}", {"creator": connect}
    return RDBStorage(url, options, skip_compatibility_check=as_it_is, skip_table_creation=as_it_is)


def points_found(folder: Path, design: Design, goal: Goal) -> int:
    """Return the number of points left by an earlier run.

    The errors are the same as in `open_study`, but no files are made.
    """
    if not os.path.exists(folder / FILE):  # pathlib raises an error if the folder may not be read
        return 0
    with open_study(folder, design, goal) as store:
        return len(store.trials())


def study_name(design: Design, goal: Goal) -> str:
    """Return the name of a study.

    It is the name of the design with a hash of everything that determines the points.
    """
    key = content_key(design.digest, goal.searched(), metadata.version("optuna"))
    return f"{design.name}-{key[:16]}"


def _without_waiting(connection: sqlite3.Connection, _: object) -> None:
    """Do not wait for the disk at every trial.

    A killed process loses nothing, and a power cut at most the last trials.
    """
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute("PRAGMA synchronous = NORMAL")


@contextmanager
def quiet() -> Iterator[None]:
    """Silence Optuna's notes and warnings on standard error.

    Damage is reported by this package instead.
    """
    from optuna import logging

    before = logging.get_verbosity()
    logging.set_verbosity(logging.ERROR)
    try:
        yield
    finally:
        logging.set_verbosity(before)


def _first_line(error: Exception) -> str:
    """Return the first line of an error.

    The class that SQLAlchemy puts before it is removed.
    """
    line = (str(error).strip().splitlines() or [type(error).__name__])[0].rstrip(".")
    return re.sub(r"^\([\w.]+\) ", "", line)
