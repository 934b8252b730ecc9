"""Read a long list in pages of about the same weight: tenants decide how large its objects are.

The bytes of a page, their text and the objects made of it are in memory at once, and take up to 15 times the bytes. All
pages show one moment, however many objects each has.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple, Protocol
from urllib.parse import quote

if TYPE_CHECKING:
    from collections.abc import Iterator

FIRST = 20
"""Objects in the first page of a list, of which nothing is known."""
MOST = 500
"""Objects in a page of small ones."""
WEIGHT = 2 * 2**20
"""Bytes that a page should have: 200 ordinary pods."""
HEAVIEST = 4 * 2**20
"""Bytes of an answer after which it is not read on, and fewer objects are asked for; a single one is always read."""
SHRINK, GROW = 4, 16
"""How much smaller a page is after one that was too heavy, and how much larger the next one is at most."""


class Page(NamedTuple):
    """A part of a list, and how many bytes it had."""

    content: dict[str, Any]
    weight: int


class PageReader(Protocol):
    """The call to the API server that paging needs."""

    def read_page(self, path: str, most: int | None) -> Page | None:
        """GET a part of a list; None if it has more bytes than `most`."""


def pages(api: PageReader, path: str) -> Iterator[dict[str, Any]]:
    """The pages of a list; the path may select objects. What the caller keeps of a page stays in memory."""
    target, size, more = f"{path}{'&' if '?' in path else '?'}limit=", FIRST, ""
    while True:
        page = api.read_page(f"{target}{size}{more}", HEAVIEST if size > 1 else None)
        if page is None:
            size = max(1, size // SHRINK)
            continue
        size = _fitting(size, page)
        token = (page.content.get("metadata") or {}).get("continue")
        yield page.content
        if not token:
            return
        more = f"&continue={quote(token)}"


def items(api: PageReader, path: str) -> Iterator[dict[str, Any]]:
    """The objects of a list, one after the other."""
    for page in pages(api, path):
        yield from page["items"]


def _fitting(size: int, page: Page) -> int:
    """How many objects the next page should have, if they are as heavy as those of this one."""
    wanted = WEIGHT * max(1, len(page.content["items"])) // max(1, page.weight)
    return max(1, min(wanted, size * GROW, MOST))
