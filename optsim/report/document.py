"""The frame that all pages share: one HTML file that opens offline, with its style and script inside."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import resources

from optsim.report.html import Child, Markup, tag

POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
"""No page asks the network for anything."""
EXTRAS = Markup(
    '<div id="tip" role="status" hidden></div><dialog id="zoom" aria-label="Picture at full size"><img src="data:," alt=""></dialog>'
)


def document(tab: str, *body: Child) -> str:
    """Write a whole page: ``tab`` names the browser's tab, ``body`` is header, main and footer."""
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", http_equiv="Content-Security-Policy", content=POLICY),
        tag("title", tab),
        tag("style", Markup(asset("page.css"))),
    )
    return f"<!doctype html>\n{tag('html', head, tag('body', *body, EXTRAS, tag('script', Markup(asset('page.js')))), lang='en')}\n"


def links_to(sections: Iterable[tuple[str, str]]) -> Markup:
    """Write the links to a page's sections, given as (id, heading)."""
    return tag("nav", [tag("a", heading, href=f"#{ident}") for ident, heading in sections], aria_label="Sections")


def asset(name: str) -> str:
    """Return a text file of this package."""
    return resources.files("optsim.report").joinpath(name).read_text("utf-8")
