"""How kopf reads the API server's answers.

kopf decodes them with Python's json and copies what it finds. Both fail where a policy nests too deeply, and that ends
kopf for all namespaces. kopf has no setting for the decoder, so both places in which it decodes are replaced: aiohttp's
`json()`, for lists, which only kopf uses in this process; and the name `json` in kopf's private module `api`, for the
events of a watch. `tests/app/test_kopf_reading.py` runs a real kopf, and fails once a newer one decodes elsewhere.
"""

from __future__ import annotations

from functools import partialmethod
from types import SimpleNamespace

import aiohttp
from kopf._cogs.clients import api

from contextpolicy.cluster.nesting import loads_shallow

_PLAIN = aiohttp.ClientResponse.json
"""Taken at import, so that a second call of `bound_nesting` wraps aiohttp's method, not our own."""


def bound_nesting() -> None:
    """Have kopf see nothing below `DEEPEST` levels, in lists and in events."""
    aiohttp.ClientResponse.json = partialmethod(_PLAIN, loads=loads_shallow)  # type: ignore[method-assign,assignment]
    api.json = SimpleNamespace(loads=loads_shallow)  # type: ignore[assignment, attr-defined]
