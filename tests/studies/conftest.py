"""Bundled designs, read once for all studies."""

import pytest

from coilarray import load_design


@pytest.fixture(scope="session")
def design():
    return load_design("gast2020")


@pytest.fixture(scope="session")
def starter():
    return load_design("starter")
