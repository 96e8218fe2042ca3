"""The program ``coilarray``, also as ``python -m coilarray``."""

import os


def start() -> None:
    """Run the command line, which Ctrl-C ends in one line."""
    try:
        from coilarray.cli.main import run
    except KeyboardInterrupt:
        os.write(2, b"coilarray: interrupted\n")
        os._exit(130)
    run()


if __name__ == "__main__":
    start()
