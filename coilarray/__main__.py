"""The command line, for ``python -m coilarray``."""

from coilarray.cli.main import run

if __name__ == "__main__":
    run()
