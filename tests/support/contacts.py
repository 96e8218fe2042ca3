"""Contacts of response maps on a coarse mesh."""

from contextlib import contextmanager
from functools import partial

import pytest

import coilarray.response.setup as setup
from coilarray.elastomer.contact import indent
from coilarray.elastomer.contact_mesh import ContactMesh

COARSE = ContactMesh(8, 1.8)
"""Good to 1 %."""


@contextmanager
def contacts_of(mesh):
    """Solve the contacts of response maps on another mesh, the same on both sides of a comparison."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(setup, "indent", partial(indent, mesh=mesh))
        setup._cached_contact.cache_clear()
        yield
    setup._cached_contact.cache_clear()
