"""Stages: a person, the emulator's own, and machines that speak G-code, with everything that these answer."""

import math
import re

import pytest
from support.refusals import refused

from coilarray.errors import HardwareError
from coilarray.hardware.record import campaign as module
from coilarray.hardware.record.campaign import GcodeStage, PersonStage, StageLimits
from coilarray.hardware.record.recording import GridPlace

LIMITS = StageLimits((-30e-3, 30e-3), (-10e-3, 10e-3), 2e-3, 2e-3)
SPEED = 1.5e-3


GREETINGS = {"grbl": b"\r\nGrbl 1.1h ['$' for help]\r\n", "marlin": b"start\necho:Marlin 2.1\n"}


class Machine:
    """A `BytePort` with GRBL or Marlin and three axes behind it, on its own time; positions in mm."""

    name = "a machine"

    def __init__(self, dialect="grbl", *, greets=False, instead=None):
        self.dialect, self.instead = dialect, instead or {}
        self.time, self.busy_until = 0.0, 0.0
        self.at = {"X": 0.0, "Y": 0.0, "Z": 5.0}
        self.lines, self.path, self.closed = [], [], False
        self._out, self._due = b"", []
        if greets:
            self._due = [(0.5, GREETINGS[dialect] if greets is True else greets)]

    def now(self):
        return self.time

    def read(self, seconds):
        due = min((when for when, _ in self._due), default=None)
        if not self._out and seconds > 0:
            self.time += seconds if due is None else min(max(due - self.time, 0.0), seconds)
        for when, text in list(self._due):
            if when <= self.time:
                self._out += text
                self._due.remove((when, text))
        taken, self._out = self._out[:7], self._out[7:]  # in pieces
        return taken

    def write(self, data):
        for line in data.decode().splitlines():
            self.lines.append(line)
            self._answer(line)

    def _answer(self, line):
        for pattern, reply in self.instead.items():
            if re.match(pattern, line):
                if reply:
                    self._due.append((self.time, reply))
                return
        if line.startswith(("G0", "G1")):
            target = {**self.at, **{axis: float(value) for axis, value in re.findall(r"([XYZ])(-?[\d.]+)", line)}}
            length = sum((target[axis] - self.at[axis]) ** 2 for axis in target) ** 0.5
            feed = float(re.search(r"F([\d.]+)", line)[1]) if line.startswith("G1") else 3000.0  # mm/min
            self.busy_until = max(self.busy_until, self.time) + 60 * length / feed
            self.at = target
            self.path.append((target["X"], target["Y"], target["Z"]))
        elif line in ("G4 P0.01", "M400"):
            assert line == {"grbl": "G4 P0.01", "marlin": "M400"}[self.dialect]
            if self.dialect == "marlin":
                self._due.append((self.time, b"echo:busy: processing\n"))
            self._due.append((max(self.busy_until, self.time), b"ok\r\n"))
            return
        elif line == {"grbl": "$H", "marlin": "G28"}[self.dialect]:
            self.time += 20.0
            self.at = {"X": -40.0, "Y": -40.0, "Z": 30.0}
            self.path.append("home")
        else:
            assert line in ("G21", "G90")
        self._due.append((self.time, b"ok\r\n"))  # understood, not done

    def close(self):
        self.closed = True


def stage_of(machine, **options):
    return GcodeStage(machine, LIMITS, machine.dialect, **{"confirm": lambda text: None, "now": machine.now, **options})


@pytest.fixture(autouse=True)
def _own_state(tmp_path, monkeypatch):
    """No test knows the machines of this computer, or of another test."""
    monkeypatch.setattr(module, "_machines_file", lambda: tmp_path / "state" / "stages.txt")


@pytest.fixture
def machine():
    return Machine()


@pytest.fixture
def stage(machine):
    """A stage after its first move, which is slow."""
    made = stage_of(machine)
    made.move(0.0, 0.0)
    machine.path.clear()
    machine.lines.clear()
    return made


@pytest.mark.parametrize("dialect", ["grbl", "marlin"])
@pytest.mark.parametrize("home", [True, False])
def test_gcode(dialect, home):
    machine = Machine(dialect, greets=home)
    stage = stage_of(machine, home=home)
    assert machine.path == ["home"] * home
    start = machine.time, dict(machine.at)
    stage.move(-26e-3, 6e-3)
    assert machine.path[home:] == [(start[1]["X"], start[1]["Y"], 2.0), (-26.0, 6.0, 2.0)]  # lifted first
    way = abs(start[1]["Z"] - 2.0) + math.hypot(-26.0 - start[1]["X"], 6.0 - start[1]["Y"])
    assert machine.time - start[0] == pytest.approx(way / 5.0)  # slowly, at 5 mm/s
    stage.move(0.0, 0.0)
    assert machine.lines[-4:-1:2] == ["G0 Z2.0000", "G0 X0.0000 Y0.0000"]  # from now on as fast as it can
    before = machine.time
    stage.indent(1e-3, SPEED)
    assert machine.at["Z"] == -1.0
    # 2 mm of clearance and 1 mm deep at 1.5 mm/s; it is over when the call returns
    assert machine.time - before == pytest.approx(3 / 1.5)
    stage.relax(SPEED)
    assert machine.at["Z"] == 2.0
    assert machine.time - before == pytest.approx(2 * 3 / 1.5)
    stage.retreat()
    stage.close()
    assert (machine.closed, machine.lines[home : home + 2]) == (True, ["G21", "G90"])
    assert {line.split()[0] for line in machine.lines[home:]} <= {"G21", "G90", "G0", "G1", "G4", "M400"}


@pytest.mark.parametrize("dialect", ["grbl", "marlin"])
@pytest.mark.parametrize(
    "greeting",
    [
        *GREETINGS.values(), b"\xfe\x00Grbl 1.1f ['$' for help]\n", b"GrblHAL 1.1f ['$' or '$HELP' for help]\n",
        b"echo: External Reset\n", b"[MSG:'$H'|'$X' to unlock]\nGrbl 3.7 [FluidNC v3.7 (wifi) '$' for help]\n",
    ],
)  # fmt: skip
def test_a_machine_that_restarts_as_its_port_opens_is_not_moved(dialect, greeting):
    machine = Machine(dialect, greets=greeting)
    home = {"grbl": r"\$H", "marlin": "G28"}[dialect]
    told = f"restarted when its port was opened, so it does not know where it is; home = true .* {home}"
    refused(HardwareError, told, stage_of, machine)
    assert (machine.lines, machine.path, machine.closed) == ([], [], True)


def test_a_machine_that_cannot_home_is_not_moved():
    machine = Machine(greets=True, instead={r"\$H": b"error:5\n"})  # no limit switches
    refused(HardwareError, r"refused '\$H': 'error:5'", stage_of, machine, home=True)
    assert (machine.path, machine.closed) == ([], True)


def test_a_person_confirms_homing_and_the_first_move(machine):
    asked = []
    stage = stage_of(machine, confirm=lambda text: asked.append((text, list(machine.path))), home=True)
    stage.retreat()
    assert machine.path == ["home"]  # a retreat is a move
    stage.move(1e-3, 2e-3)
    stage.move(3e-3, 2e-3)
    (home, before), (first, homed), (after, moved) = asked
    assert "home itself with $H" in home
    assert "2 mm over the contact at x = 1, y = 2 mm" in first
    assert "is it there" in after
    assert (before, homed, len(moved)) == ([], ["home"], 3)


@pytest.mark.parametrize("number", [0, 1, 2])
def test_what_nobody_confirms_is_not_done(number):
    def confirm(text):
        asked.append(text)
        if len(asked) > number:
            raise HardwareError("not confirmed")

    def moved():
        stage = stage_of(machine, confirm=confirm, home=True)
        try:
            stage.move(1e-3, 2e-3)
        finally:
            stage.retreat()

    machine, asked = Machine(greets=True), []
    refused(HardwareError, "not confirmed", moved)
    assert len(machine.path) == (0, 1, 3)[number]  # homed, and moved twice
    refused(HardwareError, "a person must confirm the first move", stage_of, Machine(), confirm=None)


def test_nobody_is_asked_where_a_person_has_confirmed_before(tmp_path):
    known = {"identity": "/dev/ttyUSB0 1A86:7523"}
    refused(HardwareError, "leave out --yes this once", stage_of, Machine(), confirm=None, **known)
    stage_of(Machine(), **known).move(0.0, 0.0)
    machine = Machine()
    stage_of(machine, confirm=None, **known).move(0.0, 0.0)
    assert [line[:2] for line in machine.lines[2::2]] == ["G1", "G1"]  # slow all the same
    refused(HardwareError, "first use", stage_of, Machine(), confirm=None, identity="/dev/ttyUSB0 0403:6001")
    refused(HardwareError, "first use", stage_of, Machine("marlin"), confirm=None, **known)


@pytest.mark.parametrize(
    ("line", "reply", "message"),
    [
        ("G21", b"error:9\n", "refused 'G21': 'error:9'"),
        ("G21", GREETINGS["grbl"] + b"ok\n", "restarted at 'G21'"),  # a greeting that comes late
        ("G90", b"", "did not answer 'G90' within 5 s"),
        ("G1 Z", b"ALARM:2\n", "refused 'G1 Z2.0000 F300.00': 'ALARM:2'"),
        ("G1 X", b"Error:Printer halted. kill() called!\n", "refused 'G1 X"),
        ("G1 X", b"Resend: 12\n", "refused 'G1 X"),
        ("G4", b"Grbl 1.1h ['$' for help]\n", "restarted at 'G4 P0.01', so it does not know where it is"),
        ("G4", b"", "did not answer 'G4 P0.01' within 405 s"),
        ("G1 X", b"x" * 100_000, "sends without end"),
        ("G1 X", b"[MSG:hello]\n" * 10_000, "sends without end"),
        ("G1 X", b"\xff\xfe okay\n", "did not answer"),
    ],
)
def test_what_a_machine_may_say(line, reply, message):
    machine = Machine(instead={line: reply})
    told = f"^the stage at a machine .*{re.escape(message)}"
    refused(HardwareError, told, lambda: stage_of(machine).move(1e-3, 0.0))


def test_a_machine_that_failed_is_not_moved_again(machine, stage):
    machine.instead = {"G1": b"ALARM:1\n"}
    stage.move(0.0, 0.0)
    refused(HardwareError, "ALARM", stage.indent, 1e-3, SPEED)
    sent = len(machine.lines)
    stage.retreat()
    assert len(machine.lines) == sent


def test_after_an_interrupt_no_answer_stands_for_that_of_the_next_line(machine, stage):
    read, interrupted = machine.read, []

    def read_until_the_indenter_moves(seconds):
        if not interrupted and machine.lines[-1].startswith("G4") and machine.at["Z"] < 0:
            interrupted.append(True)
            raise KeyboardInterrupt
        return read(seconds)

    machine.read = read_until_the_indenter_moves
    stage.move(0.0, 0.0)
    with pytest.raises(KeyboardInterrupt):
        stage.indent(1e-3, SPEED)
    stage.retreat()
    assert machine.at["Z"] == 2.0
    assert machine.time >= machine.busy_until  # it is up when the call returns, not on its way


@pytest.mark.parametrize(
    "place",
    [(-31e-3, 0.0, 1e-3), (31e-3, 0.0, 1e-3), (0.0, 11e-3, 1e-3), (0.0, 0.0, 2.1e-3), (float("nan"), 0.0, 1e-3)],
)
def test_out_of_reach(machine, stage, place):
    x, y, depth = place
    both = (GridPlace(0, 0, 1e-3, 0.0, 0.0), GridPlace(1, 0, depth, y, x))
    refused(
        HardwareError, "a machine reaches x -30 to 30, y -10 to 10 mm on the board and 2 mm deep", stage.check, both
    )
    with pytest.raises(HardwareError, match=r"reaches|depth of the stage must be"):  # noqa: PT012 - one of the two
        stage.move(x, y)
        stage.indent(depth, SPEED)
    assert all(-30 <= x <= 30 and -10 <= y <= 10 and z >= -2 for x, y, z in machine.path)


def test_limits_and_machine_count_on_the_board(machine):
    stage = stage_of(machine, origin=(-20.1e-3, 3e-3))
    stage.move(50.1e-3, -13e-3)  # the corner, to rounding
    assert machine.path[-1] == (30.0, -10.0, 2.0)
    refused(HardwareError, "the campaign goes to x = -30.1, y = 3, depth 0 mm", stage.move, -10e-3, 0.0)
    assert len(machine.path) == 2


def test_person():
    asked = []
    stage = PersonStage(asked.append)
    stage.check([GridPlace(0, 0, 1.0, 9.0, 9.0)])
    stage.move(-4e-3, 2e-3)
    stage.indent(1e-3, SPEED)
    stage.relax(SPEED)
    stage.retreat()  # nobody is asked when something has failed
    stage.close()
    assert asked == [
        "Move the indenter to x = -4, y = 2 mm, without touching.",
        "Press 1 mm deep at x = -4, y = 2 mm, at 1.5 mm/s, and hold it.",
        "Lift the indenter off at 1.5 mm/s.",
    ]
