"""What a terminal shows, and that it fits."""

import os
import re

NUMBER = re.compile(r"[+−-]?\d+(\.\d+)?(·10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)?")
CODES = re.compile(r"\x1b\[[0-9;?]*[a-zA-Z]")


def require_fits(text: str, width: int) -> None:
    """Check that no line is longer than the terminal, but for a single word, and no number is cut."""
    for line in CODES.sub("", text).splitlines():
        assert len(line) <= width or " " not in line.strip(), (width, line)
        assert not re.search(r"\d…(\s|$)", line), line


def on_terminal(command: list[str], columns: int) -> tuple[str, int]:
    """Run a command on a pseudo-terminal; return what stays on the screen, and the exit code."""
    import fcntl  # of systems with pseudo-terminals
    import pty
    import struct
    import subprocess
    import termios

    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 40, columns, 0, 0))
    environment = {key: value for key, value in os.environ.items() if key != "COLUMNS"} | {"TERM": "xterm"}
    process = subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs, env=environment)
    os.close(theirs)
    data = b""
    while True:
        try:
            piece = os.read(ours, 65536)
        except OSError:  # so ends a terminal whose programs have ended
            break
        if not piece:
            break
        data += piece
    os.close(ours)
    text = CODES.sub("", data.decode()).replace("\r\n", "\n")
    return "\n".join(line.rpartition("\r")[2] for line in text.split("\n")), process.wait()
