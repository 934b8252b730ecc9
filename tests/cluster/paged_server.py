"""An API server's lists, in as many bytes as its objects have: it makes them when they are asked for."""

from __future__ import annotations

import json
import tracemalloc
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs, urlsplit

from contextpolicy.cluster.paging import Page
from tests.cluster.builders import a_pod

if TYPE_CHECKING:
    from collections.abc import Callable

MIB = 2**20


class PagedServer:
    """Lists `number` objects, each of which `make` makes; `limits` are the numbers of objects asked for."""

    def __init__(self, number: int, make: Callable[[int], dict[str, Any]]) -> None:
        self.limits: list[int] = []
        self._number, self._make = number, make

    def read_page(self, path: str, most: int | None) -> Page | None:
        asked = {name: values[0] for name, values in parse_qs(urlsplit(path).query).items()}
        begin, limit = int(asked.get("continue", 0)), int(asked["limit"])
        self.limits.append(limit)
        end = min(begin + limit, self._number)
        texts, weight = [], 0
        for index in range(begin, end):
            texts.append(json.dumps(self._make(index)))
            weight += len(texts[-1])
            if most is not None and weight > most:
                return None
        metadata = {"resourceVersion": "1", **({"continue": str(end)} if end < self._number else {})}
        answer = f'{{"metadata": {json.dumps(metadata)}, "items": [{", ".join(texts)}]}}'.encode()
        return Page(json.loads(answer), len(answer))


def a_heavy_pod(index: int, weight: int = MIB) -> dict[str, Any]:
    """A pod with so many bytes in its environment."""
    pod = a_pod(f"heavy-{index}")
    pod["spec"]["containers"][0]["env"] = [{"name": "BALLAST", "value": "x" * weight}]
    return pod


def a_heavy_policy(index: int, weight: int = MIB) -> dict[str, Any]:
    """A policy with so many bytes in its spec."""
    metadata = {"namespace": "lab", "name": f"heavy-{index}", "resourceVersion": "1"}
    return {"metadata": metadata, "spec": {"ballast": "x" * weight}, "status": {"originals": {}}}


def peak(work: Callable[[], object]) -> int:
    """The most memory that this takes, in bytes."""
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
