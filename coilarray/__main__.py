"""The program ``coilarray``, also as ``python -m coilarray``."""

import os


def start() -> None:
    """Load the command line and run it; Ctrl-C ends it in one line from here on."""
    try:
        from coilarray.cli.main import run
    except KeyboardInterrupt:
        os.write(2, b"coilarray: interrupted\n")
        os._exit(130)
    run()


if __name__ == "__main__":
    start()
