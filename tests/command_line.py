"""Runs of the command line within the tests."""

from coilarray.cli.main import main


def runner(*first):
    """Return `run` and `refused` for command lines that begin with the given arguments."""

    def run(capsys, *arguments):
        """Run and return the exit code, standard output and standard error."""
        code = main([*first, *(str(argument) for argument in arguments)])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    def refused(capsys, *arguments):
        """Run and return the one line of the error."""
        code, out, err = run(capsys, *arguments)
        assert (code, out) == (2, "")
        assert "Traceback" not in err
        (line,) = err.splitlines()
        assert line.startswith("coilarray: error: ")
        return line

    return run, refused
