"""What all tests share: one store of results, files in an order that ends well, and signals as on a terminal."""

import os
import re
import signal
import sys
from collections import Counter
from pathlib import Path

# Tests run side by side, one on each core: threads of the linear algebra would only wait for each other.
# Before the imports, for numpy reads it when it is loaded.
for library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")
os.environ.setdefault("MPLBACKEND", "agg")  # no test opens a window

import hypothesis  # noqa: E402
import pytest  # noqa: E402
from support.patience import PATIENCE  # noqa: E402

from coilarray.compute.memory import collect_seldom  # noqa: E402
from coilarray.compute.store import FOLDER_VARIABLE  # noqa: E402

collect_seldom()  # thousands of collected tests last too

# Under CI the parent is hypothesis' own profile for it, which tries the same examples every time.
hypothesis.settings.register_profile(
    "shared machine", hypothesis.settings(), deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)
hypothesis.settings.load_profile("shared machine")


def pytest_configure(config):
    # else pytest-xdist begins with the files of many tests, which are the short ones
    config.option.loadscopereorder = False
    # Each worker reads all files, and writes down how it compiled them: no two begin at the same folder of the tests.
    here, worker = Path(__file__).parent, getattr(config, "workerinput", None)
    if worker is not None:  # threads of workers side by side wait for each other; tests of threads say how many
        os.environ.setdefault("COILARRAY_THREADS", "1")
    if worker is not None and [Path(name).resolve() for name in config.args] == [here]:
        parts = sorted({path.relative_to(here).parts[0] for path in here.rglob("test_*.py")})
        first = len(parts) * int(worker["workerid"].removeprefix("gw")) // worker["workercount"]
        config.args[:] = [str(here / name) for name in parts[first:] + parts[:first]]


def pytest_ignore_collect(collection_path, config):
    """Leave files whose tests are all slow unread where slow tests are left out."""
    if config.option.markexpr == "not slow" and re.fullmatch(r"test_.*\.py", collection_path.name):
        slow = re.search(r"^pytestmark = .*\bmark\.slow\b", collection_path.read_text(encoding="utf-8"), re.MULTILINE)
        return True if slow else None
    return None


def pytest_collection_modifyitems(items):
    """Begin with the files that take longest, in a browser or of many slow tests: none of them is left for the end."""
    slow = Counter(item.path for item in items if "slow" in item.keywords)
    waiting = {item.path for item in items if "chromium" in getattr(item, "fixturenames", ())}
    # of the same file: as they stand there
    items.sort(key=lambda item: (item.path not in waiting, -slow[item.path], item.path))


def pytest_terminal_summary(terminalreporter, config):
    """Name the tests without the mark slow that took longer than its limit of 1 s."""
    passed = terminalreporter.getreports("passed") if config.option.markexpr == "not slow" else []
    for report in passed:
        if report.when == "call" and report.duration > 1.0:
            terminalreporter.write_line(f"{report.duration:.1f} s, not marked slow: {report.nodeid}")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config):
    """One more than there are cores, as some slow tests only wait; reading all files takes each some 10 s."""
    alone = config.option.markexpr or not hasattr(os, "sched_getaffinity")
    return None if alone else len(os.sched_getaffinity(0)) + 1


@pytest.fixture(scope="session", autouse=True)
def _one_store(tmp_path_factory, request):
    """Keep results in one folder a run, for all its processes and those that they start."""
    folder = tmp_path_factory.getbasetemp()
    if hasattr(request.config, "workerinput"):  # a worker's folder lies in that of the run
        folder = folder.parent
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(FOLDER_VARIABLE, str(folder / "store"))
        if os.environ.get("PYTHONDONTWRITEBYTECODE"):  # each process of a test would compile all packages anew
            patch.delenv("PYTHONDONTWRITEBYTECODE")
            patch.setenv("PYTHONPYCACHEPREFIX", str(folder / "bytecode"))
        yield


@pytest.fixture(scope="session")
def rendering():
    """Skip a test where this machine cannot render; asking takes seconds, and only who renders asks."""
    from coilarray.viz import rendering_problem

    if (problem := rendering_problem()) is not None:
        pytest.skip(problem)


@pytest.fixture
def without_trame_vtk(monkeypatch):
    """Trame-vtk as if it were not installed."""
    for module in [name for name in sys.modules if name.split(".")[0] == "trame_vtk"]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, "trame_vtk", None)


@pytest.fixture(scope="module")
def chromium():
    """A running Chromium; skips the tests where there is none."""
    from support import browser

    if (problem := browser.missing()) is not None:
        pytest.skip(problem)
    with browser.launched() as started:
        yield started


@pytest.fixture(autouse=True)
def _closed_figures():
    """Close the figures that a test leaves open: Matplotlib warns from the 21st on."""
    yield
    if (pyplot := sys.modules.get("matplotlib.pyplot")) is not None:
        pyplot.close("all")


@pytest.fixture
def pictures_of_nothing(monkeypatch):
    """Make the plots of pages but draw none in pixels, which takes longest; tests of the report do."""
    monkeypatch.setattr("coilarray.report.page.image_of", lambda drawn, name, alt: ("<svg></svg>", ""))


@pytest.fixture
def no_noisy_copies(monkeypatch):
    """Compare responses without noisy copies, as the fits of their ellipses take longest."""
    monkeypatch.setattr("coilarray.studies.comparison.REPLICATES", 0)


@pytest.fixture
def own_store(tmp_path, monkeypatch):
    """Keep the results of a test about the store in a folder of its own."""
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "cache"))


@pytest.fixture(scope="session", autouse=True)
def _signals_of_a_terminal():
    """Undo what a shell does to jobs in the background, and `nohup` to all: the programs they start are deaf too."""
    usual = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}
    if hasattr(signal, "SIGHUP"):
        usual[signal.SIGHUP] = signal.SIG_DFL
    before = {number: signal.signal(number, handler) for number, handler in usual.items()}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def patient_writing(monkeypatch):
    """Of a write in which this process was stopped for its time-out pyserial says that the port takes no bytes."""
    monkeypatch.setattr("coilarray.hardware.wire.ports._WRITE_TIMEOUT", PATIENCE)
