"""The frame of a page that opens offline: head, header with sections, main, foot."""

from __future__ import annotations

from collections.abc import Sequence

from optsim.report.html import Child, Markup, section, tag
from optsim.report.page import asset


def plain_page(
    *, tab: str, kicker: str, title: str, lead: Sequence[Child], sections: Sequence[tuple[str, str, Sequence[Child]]], foot: str
) -> str:  # fmt: skip
    """Write a page as one HTML text.

    Args:
        tab: name of the browser's tab.
        kicker: small line above the title.
        title: the headline.
        lead: what stands under it.
        sections: (id, heading, contents).
        foot: last line.
    """
    links = tag("nav", [tag("a", heading, href=f"#{ident}") for ident, heading, _ in sections], aria_label="Sections")
    header = tag("header", tag("div", tag("p", kicker, class_="kicker"), tag("h1", title), lead, links))
    main = tag("main", [section(ident, heading, contents) for ident, heading, contents in sections])
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag(
            "meta",
            http_equiv="Content-Security-Policy",
            content="default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'",
        ),
        tag("title", tab),
        tag("style", Markup(asset("page.css"))),
    )
    extras = Markup(
        '<div id="tip" role="status" hidden></div><dialog id="zoom" aria-label="Picture at full size"><img src="data:," alt=""></dialog>'
    )
    body = tag("body", header, main, tag("footer", tag("div", foot)), extras, tag("script", Markup(asset("page.js"))))
    return f"<!doctype html>\n{tag('html', head, body, lang='en')}\n"
