"""Build HTML from Python values: whatever is not already markup is escaped."""

from __future__ import annotations

import html
from collections.abc import Iterable


class Markup(str):
    """Mark a string as HTML that was built here."""


Child = str | Markup | Iterable["Child"] | None

VOID = {"meta", "img", "br", "hr", "input", "col"}


def render(child: Child) -> str:
    """Write a child as HTML: markup as it is, plain text escaped, None as nothing."""
    if child is None:
        return ""
    if isinstance(child, Markup):
        return str(child)
    if isinstance(child, str):
        return html.escape(child, quote=True)
    return "".join(render(c) for c in child)


def tag(name: str, /, *children: Child, **attributes: str | None) -> Markup:
    """Write an element; ``class_`` and ``data_x`` lose the underscore; attributes that are None are left out."""
    words = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{html.escape(str(value), quote=True)}"'
        for key, value in attributes.items()
        if value is not None
    )
    if name in VOID:
        return Markup(f"<{name}{words}>")
    return Markup(f"<{name}{words}>{render(children)}</{name}>")


def table(
    header: Iterable[str], rows: Iterable[Iterable[Child]], *, class_: str = "", caption: str | None = None, numeric_from: int = 1
) -> Markup:
    """Write a table; columns from ``numeric_from`` on are right-aligned."""
    head = [tag("th", text, scope="col", class_="n" if i >= numeric_from else None) for i, text in enumerate(header)]
    body = [
        tag(
            "tr",
            [
                tag("th", cell, scope="row") if i == 0 else tag("td", cell, class_="n" if i >= numeric_from else None)
                for i, cell in enumerate(row)
            ],
        )
        for row in rows
    ]
    inner = tag(
        "table", tag("caption", caption) if caption else None, tag("thead", tag("tr", head)), tag("tbody", body), class_=class_ or None
    )
    return tag("div", inner, class_="scroll", tabindex="0", role="region", aria_label=caption or "table")


def section(ident: str, title: str, *children: Child) -> Markup:
    """Write a section with its heading."""
    return tag("section", tag("h2", title), *children, id=ident)
