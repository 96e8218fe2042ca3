"""The HTML pages: one set of templates, and what every page says about its origin."""

from __future__ import annotations

from datetime import UTC, datetime

import jinja2


def render_page(template: str, **values: object) -> str:
    """Return a page made of a template of this package; an undefined name in the template is an error."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("coilarray.report", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(**values)


def now() -> str:
    """Return the date and time in UTC, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")
