"""The program ``coilarray``: commands in, exit codes out."""

import codecs
import errno
import functools
import inspect
import io
import os
import re
import signal
import socket
import sys
import unicodedata
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from threading import Event, Thread
from typing import Any, NoReturn

import typer
import typer.core

from coilarray.cli import boards, compute, design, help, link, paper, position, studies, view
from coilarray.cli.board import live, measure, recordings
from coilarray.cli.shared import drop_output, say
from coilarray.compute.files import keep_results
from coilarray.compute.memory import collect_seldom, own_limit
from coilarray.errors import CoilarrayError, UnusualValueWarning

INTERRUPTED = 130  # exit code of an interrupted program
_MESSAGE = b"coilarray: interrupted\n"
_PATIENCE = 2.0  # s for a computation to return to Python
_heard = Event()  # of the block that lasts
_BAD_INPUT = 2
_UNREAD = 1  # as typer has it
_LACKS_MEMORY = re.compile(r"allocate|out of memory|failed to map segment|can't start new thread", re.IGNORECASE)
_SMALL = {"check", "docs", "keys"}
_LEAST_MEMORY = 0.6e9  # bytes of address space, below which libraries of linear algebra wait for memory without end
# bytes of address space: for pictures in three dimensions, and for Optuna beside new processes
_MORE_MEMORY = {"report": 1.8e9, "view": 1.8e9, "optimize": 1.2e9}
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)  # on the disk, of the user, in a file
# Our own threads use the cores: more threads of the linear algebra, which reads these when NumPy is first imported
# (by no module before a command runs), only wait for each other.
_BLAS_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")

GROUPS: dict[str, dict[str, Callable[..., None]]] = {  # every command by name, in the help's groups
    "Design": {
        "init": design.init, "import": boards.import_board, "check": design.check, "export": design.export,
        "view": view.view, "studio": view.studio,
    },
    "Compute": {
        "report": compute.report, "impedance": compute.impedance, "response": compute.response,
        "target": compute.target,
    },
    "Position": {"locate": position.locate, "calibrate": position.calibrate},
    "Studies": {
        "sweep": studies.sweep, "link": link.link, "optimize": studies.optimize, "tolerance": studies.tolerance,
    },
    "Board": {
        "board test": measure.self_test, "board measure": measure.measure, "board campaign": measure.campaign,
        "board info": recordings.info, "board calibrate": recordings.calibrate, "board compare": recordings.compare,
        "board live": live.live,
    },
    "Paper": {"paper fit": paper.fit, "paper distortion": paper.distortion},
    "Help": {"keys": help.keys, "docs": help.docs},
}  # fmt: skip

COMMANDS: dict[str, Callable[..., None]] = {  # every command by name, with ``board`` or ``paper``
    name: command for commands in GROUPS.values() for name, command in commands.items()
}

_FAMILIES = {"board": "Read out a board, real or emulated.", "paper": "Evaluate maps as Gast & Zimmermann (2020) did."}
"""First words of commands, and their help."""
_ORDERLY = {"board", "studio"}  # which bring boards to rest and end sessions, however long that takes
_MOST_LINES = 40  # of a command's help
_ENDS = (r"[;.] ", r"[;.] | \(", r"[;.,:] | \(")  # of what is said about an option, the briefer the narrower
_RARE = {  # options that only --help-all explains
    "--accuracy", "--allow-violations", "--cache", "--capacitance-pF", "--cluster", "--distortion", "--emulate",
    "--experiment", "--folder", "--force", "--help", "--host", "--ideal", "--ignore-self-test", "--json", "--linger",
    "--link", "--nets", "--rate", "--reach", "--reference", "--seed", "--series", "--settings", "--spacing-mm",
    "--stackup", "--switches", "--wiring", "--workers", "--z-mm",
}  # fmt: skip
_READABLE = {
    "−": "-", "–": "-", "—": "-", "µ": "u", "μ": "u", "Ω": "Ohm", "…": "...", "·": "*", "×": "x", "±": "+/-", "≤": "<=",
    "≥": ">=", "≈": "~", "→": "->", "°": " deg", "√": "sqrt ", "∞": "inf", "“": '"', "”": '"', "‘": "'", "’": "'",
    "•": "*", "✔": "ok", "✖": "NO", "⚠": "!", "⁻": "^-", "²": "^2", "³": "^3",
}  # fmt: skip


@contextmanager
def ending_on_interrupt() -> Iterator[None]:
    """End on Ctrl-C if a library does not return."""
    # Files stay whole, as each gets its name in one step. Another program's handler of Ctrl-C is left.
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    global _heard  # noqa: PLW0603
    heard = _heard = Event()  # its own: the thread of a block that has ended may still look at it
    read_end, write_end = socket.socketpair()
    write_end.setblocking(False)  # as set_wakeup_fd demands

    def raise_interrupt(number: int, frame: object) -> NoReturn:
        heard.set()
        raise KeyboardInterrupt

    def watch() -> None:
        with read_end:
            while came := read_end.recv(1):
                if came[0] == signal.SIGINT and not heard.wait(_PATIENCE):
                    with suppress(OSError):
                        os.write(2, _MESSAGE)
                    os._exit(INTERRUPTED)

    signal.signal(signal.SIGINT, raise_interrupt)
    before = signal.set_wakeup_fd(write_end.fileno(), warn_on_full_buffer=False)
    Thread(target=watch, daemon=True).start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        write_end.close()
        _heard = Event()


def summary(name: str) -> str:
    """Return the first line of a command's help."""
    return (COMMANDS[name].__doc__ or "").split("\n", 1)[0]


class _Grouped(typer.core.TyperGroup):
    """Program or family whose help has groups of commands."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        own = f"{self.name} " if self.name in _FAMILIES else ""
        width = max(map(len, COMMANDS))
        for group, commands in GROUPS.items():
            shown = [(name.ljust(width), summary(name)) for name in commands if name.startswith(own)]
            if shown:
                with formatter.section(group):
                    formatter.write_dl(shown)


class _Folded(typer.core.TyperCommand):
    """Command whose help fits on a screen, and is whole with --help-all."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        ctx.meta["all"] = "--help-all" in args
        return super().parse_args(ctx, ["--help"] if ctx.meta["all"] else args)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        if ctx.meta.get("all"):
            super().format_help(ctx, formatter)
            return
        prose = [text for text in inspect.cleandoc(self.help or "").split("\n\n") if not text.startswith("Example: ")]
        text = ""
        for count, ends in [*((n, "") for n in range(len(prose), 0, -1)), *((1, ends) for ends in _ENDS)]:
            whole = type(formatter)(width=formatter.width)
            self._write(ctx, whole, prose[:count], ends)
            text = whole.getvalue()
            if text.count("\n") < _MOST_LINES:
                break
        formatter.write(text)

    def _write(self, ctx: Any, formatter: Any, prose: Sequence[str], ends: str) -> None:
        """Write the help with these paragraphs, and about an option the words before one of the `ends`."""
        self.format_usage(ctx, formatter)
        narrow = ends not in ("", _ENDS[0])  # one example, and no list of the rest
        examples = re.findall(r"^Example: (.*(?:\n.+)*)", inspect.cleandoc(self.help or ""), re.MULTILINE)
        with formatter.indentation():
            for text in [*prose, *(f"Example: {one}" for one in examples[: 2 - narrow])]:
                formatter.write_paragraph()
                formatter.write_text(text)
        rare, shown = [], dict[str, list[tuple[str, str]]]()
        for one in self.get_params(ctx):
            record = one.get_help_record(ctx)
            if record is not None and one.param_type_name == "option" and _RARE & set(one.opts):
                rare.append(one.opts[-1])
            elif record is not None:
                help_text = re.split(ends, record[1])[0].rstrip(".") if ends else record[1]
                shown.setdefault(f"{one.param_type_name}s".capitalize(), []).append((record[0], help_text))
        for title, records in shown.items():
            with formatter.section(title):
                formatter.write_dl(records)
        rest = [f"{len(examples) - 2} more example{'s' * (len(examples) > 3)}"] if len(examples) > 2 else []
        rest = [] if narrow else [*rest, *sorted(set(rare) - {"--help"})]
        formatter.write_paragraph()
        formatter.write_text(f"--help-all explains everything{', also ' * bool(rest)}{', '.join(rest)}.")


def _root(version: bool = typer.Option(False, "--version", help="Print the version and leave.")) -> None:
    if version:
        from importlib import metadata

        typer.echo(f"coilarray {metadata.version('coilarray')}")
        raise typer.Exit


@functools.cache
def program(name: str) -> Callable[..., Any]:
    """Return the program with one command, none, or all."""
    app = typer.Typer(
        name="coilarray",
        help="Planar coil arrays: from a design file to geometry, coupling and a report.\n\nStart with: coilarray "
        "report. Help on a command: coilarray COMMAND --help",
        cls=_Grouped,
        add_completion=False,
        rich_markup_mode=None,
    )
    app.callback(invoke_without_command=True)(_root)
    # typer takes milliseconds to read the signature of a command, and help and version need none
    wanted = (name,) if name in COMMANDS else () if name.startswith("-") else COMMANDS
    families = {
        family: typer.Typer(name=family, help=text, cls=_Grouped, rich_markup_mode=None)
        for family, text in _FAMILIES.items()
    }
    for one in wanted:
        family, _, rest = one.rpartition(" ")
        families.get(family, app).command(rest, cls=_Folded)(COMMANDS[one])
    for family, sub in families.items():
        if sub.registered_commands:
            app.add_typer(sub, name=family)
    return typer.main.get_command(app)


def main(argv: Sequence[str] | None = None) -> int:
    """Return the exit code: 0 done, 2 bad input, 130 interrupted."""
    # A fault of the program itself keeps its traceback.
    for variable in _BLAS_THREADS:
        os.environ.setdefault(variable, "1")
    collect_seldom()
    keep_results()
    arguments = list(sys.argv[1:] if argv is None else argv) or ["--help"]
    if len(arguments) == 1 and arguments[0] in _FAMILIES:
        arguments.append("--help")
    command = " ".join(arguments[:2]) if arguments[0] in _FAMILIES else arguments[0]
    needed = _MORE_MEMORY.get(command, _LEAST_MEMORY)
    if command in COMMANDS.keys() - _SMALL and not {"--help", "--help-all"} & {*arguments} and own_limit() < needed:
        return _refuse(
            f"coilarray {command} needs {needed / 1e9:g} GB of address space; "
            f"{own_limit() / 1e9:.2f} GB are left (ulimit -v)."
        )
    try:
        with _telling_unusual_values():
            code = program(command)(arguments, prog_name="coilarray", standalone_mode=False)
        _flush()
    except (KeyboardInterrupt, typer.Abort):
        code = INTERRUPTED
    except Exception as error:
        # a library may make another error of Ctrl-C
        code = INTERRUPTED if _heard.is_set() else _answer_to(error, command)
    if code == INTERRUPTED:  # also typer's own answer to an interrupt, without a word
        typer.echo("coilarray: interrupted", err=True)
    return code if isinstance(code, int) else 0


def _answer_to(error: Exception, command: str) -> int:
    """Print an expected error in one line, raise others again."""
    if isinstance(error, CoilarrayError):
        return _refuse(str(error))
    if _is_lack_of_memory(error):
        return _refuse(f"there is not enough memory for coilarray {command}.")
    if isinstance(error, OSError):
        if error.errno not in (*_NO_ROOM, errno.EPIPE):
            raise error
        try:
            _flush()
        except OSError:
            drop_output()
        if error.errno == errno.EPIPE:  # who read the output has ended
            return _UNREAD
        return _refuse(f"cannot write {error.filename or 'the output'}: {error.strerror}.")
    if isinstance(error, UnicodeEncodeError) and error.reason == "surrogates not allowed":
        return _refuse("a name is not UTF-8, and cannot be written into a file.")
    # some versions of typer bring a copy of click, whose usage errors have this method too
    format_message = getattr(error, "format_message", None)
    if format_message is None:
        raise error
    family = command.split(" ")[0]
    help_for = f" {command}" if command in COMMANDS else f" {family}" if family in _FAMILIES else ""
    words = " ".join(format_message().split()).replace("Value error, ", "")  # which typer adds to pydantic's
    return _refuse(f"{words} (try: coilarray{help_for} --help)")


def _is_lack_of_memory(error: BaseException) -> bool:
    causes: list[BaseException] = []
    one: BaseException | None = error
    while one is not None and one not in causes:
        causes.append(one)
        one = one.__cause__ or one.__context__
    return any(
        isinstance(one, MemoryError)
        or (isinstance(one, OSError) and one.errno == errno.ENOMEM)
        or (isinstance(one, (ImportError, OSError, RuntimeError)) and _LACKS_MEMORY.search(str(one)) is not None)
        for one in causes
    )


@contextmanager
def _telling_unusual_values() -> Iterator[None]:
    told: set[str] = set()

    def tell(message: Warning | str, category: type[Warning], *where: Any, **more: Any) -> None:
        if not issubclass(category, UnusualValueWarning):
            usual(message, category, *where, **more)
        elif str(message) not in told:
            told.add(str(message))
            say(f"coilarray: warning: {message}", err=True)

    with warnings.catch_warnings():
        warnings.simplefilter("always", UnusualValueWarning)
        usual, warnings.showwarning = warnings.showwarning, tell
        yield


def run() -> None:
    """Entry point of the installed program."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # there may be none
            _prepare(stream)
    with nullcontext() if sys.argv[1:2] and sys.argv[1] in _ORDERLY else ending_on_interrupt():
        code = main()
        if code == INTERRUPTED:  # at once, without waiting for threads
            for stream in (sys.stdout, sys.stderr):
                with suppress(OSError, AttributeError):
                    stream.flush()
            os._exit(INTERRUPTED)
    sys.exit(code)


def _prepare(stream: io.TextIOWrapper) -> None:
    """Let a stream take every text, for programs ASCII minus."""
    encoding, for_programs = codecs.lookup(stream.encoding).name, not stream.isatty()
    if encoding == "utf-8":  # names of files may have bytes that are no UTF-8
        stream.reconfigure(errors="surrogateescape")
    elif encoding == "ascii":  # which typer would replace by UTF-8
        stream.reconfigure(encoding="latin-1")
    write: Callable[[str], int] = stream.write

    def write_readable(text: str) -> int:
        text = text.replace("−", "-") if for_programs else text
        return write(text if encoding == "utf-8" else text.encode(encoding, "coilarray").decode(encoding))

    stream.write = write_readable  # type: ignore[method-assign]


def _in_ascii(error: UnicodeError) -> tuple[str, int]:
    assert isinstance(error, UnicodeEncodeError)
    text = ""
    for one in error.object[error.start : error.end]:
        greek = re.fullmatch(r"GREEK (SMALL|CAPITAL) LETTER (\w+)", unicodedata.name(one, ""))
        plain = unicodedata.normalize("NFKD", one).encode("ascii", "ignore").decode()
        text += _READABLE.get(one) or (greek[2].lower() if greek else plain or "#")
    return text, error.end


codecs.register_error("coilarray", _in_ascii)


def _flush() -> None:
    if sys.stdout is not None:
        sys.stdout.flush()


def _refuse(message: str) -> int:
    say(f"coilarray: error: {message}", err=True)
    return _BAD_INPUT
