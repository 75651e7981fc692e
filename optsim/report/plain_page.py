"""A page of a headline, what stands under it, sections and a last line."""

from __future__ import annotations

from collections.abc import Sequence

from optsim.report.document import document, links_to
from optsim.report.html import Child, section, tag


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
    links = links_to((ident, heading) for ident, heading, _ in sections)
    header = tag("header", tag("div", tag("p", kicker, class_="kicker"), tag("h1", title), lead, links))
    main = tag("main", [section(ident, heading, contents) for ident, heading, contents in sections])
    return document(tab, header, main, tag("footer", tag("div", foot)))
