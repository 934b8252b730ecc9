"""How kopf reads the API server's answers.

It decodes them with Python's json and copies what it finds, and both end at what nests too deeply: an error of one
policy's answer ends kopf for all namespaces. It has no setting for the decoder.
"""

from __future__ import annotations

from functools import partialmethod
from types import SimpleNamespace

import aiohttp
from kopf._cogs.clients import api

from contextpolicy.cluster.nesting import loads_shallow

_PLAIN = aiohttp.ClientResponse.json


def bound_nesting() -> None:
    """Have kopf see nothing below `DEEPEST` levels, in lists and in events."""
    aiohttp.ClientResponse.json = partialmethod(_PLAIN, loads=loads_shallow)  # type: ignore[method-assign,assignment]
    api.json = SimpleNamespace(loads=loads_shallow)  # type: ignore[assignment, attr-defined]
