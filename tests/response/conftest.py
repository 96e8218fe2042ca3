"""Contacts on a coarse mesh, the same on both sides of a comparison."""

import pytest
from support.contacts import COARSE, contacts_of


@pytest.fixture(scope="module", autouse=True)
def _coarse_contacts():
    with contacts_of(COARSE):
        yield
