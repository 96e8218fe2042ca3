"""HTML pages from one set of templates, with the origin of each page."""

from __future__ import annotations

import re
from datetime import UTC, datetime

import jinja2

from coilarray.compute.html import html_table


def render_page(template: str, **values: object) -> str:
    """Return a page made from a template of this package.

    An undefined name in the template is an error.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("coilarray.report", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals["html_table"] = html_table
    return environment.get_template(template).render(**values)


def now() -> str:
    """Return the date and time in UTC, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def with_contents(page: str) -> str:
    """Return a page with linked sections.

    A list of them replaces its comment "contents".
    """
    titles: list[str] = []

    def linked(match: re.Match[str]) -> str:
        titles.append(match[1])
        return f'<h2 id="section-{len(titles)}">{match[1]}</h2>'

    page = re.sub(r"<h2>(.*?)</h2>", linked, page)
    links = " · ".join(f'<a href="#section-{k}">{title}</a>' for k, title in enumerate(titles, start=1))
    return page.replace("<!-- contents -->", f'<nav class="contents">{links}</nav>')
