"""What all tests share: the machine is used by others too, and signals do what they do on a terminal."""

import os
import signal

# Tests run side by side, one on each core: threads of the linear algebra would only wait for each other.
# Before the imports, for numpy reads it when it is loaded.
for library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

import hypothesis  # noqa: E402
import pytest  # noqa: E402
from support.patience import PATIENCE  # noqa: E402

# Under CI the parent is hypothesis' own profile for it, which tries the same examples every time.
hypothesis.settings.register_profile(
    "shared machine", hypothesis.settings(), deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)
hypothesis.settings.load_profile("shared machine")


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
    monkeypatch.setattr("coilarray.hardware.wire.serial_ports._WRITE_TIMEOUT", PATIENCE)
