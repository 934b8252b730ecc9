"""Lists whose objects may be of any size, as each tenant likes."""

from __future__ import annotations

from typing import Any, cast

from contextpolicy.cluster import paging
from contextpolicy.cluster.paging import items
from contextpolicy.cluster.pod_parsing import view
from contextpolicy.cluster.watching import ObjectWatch
from tests.cluster.paged_server import MIB, PagedServer, a_heavy_pod, peak


def an_ordinary_pod(index):
    return a_heavy_pod(index, 9000)


class Views:
    """What the operator keeps of pods."""

    def __init__(self):
        self.found = []

    def on_object(self, item):
        self.found.append(view(item))

    def on_gone(self, uid):
        raise AssertionError(uid)

    def on_listing(self):
        pass


def test_memory_does_not_depend_on_what_pods_weigh():
    """It was 500 pods in one page, half a GiB as bytes alone, in an operator with 384 MiB."""
    views = Views()
    watch = ObjectWatch(cast("Any", PagedServer(200, a_heavy_pod)), "/api/v1/pods", views)
    assert peak(watch._list) < 40 * MIB
    assert len(views.found) == 200


def test_ordinary_pods_come_in_large_pages():
    server = PagedServer(5000, an_ordinary_pod)
    assert len({pod["metadata"]["uid"] for pod in items(server, "/api/v1/pods")}) == 5000
    assert len(server.limits) <= 30


def test_tiny_objects_come_in_pages_of_bounded_number():
    server = PagedServer(2000, lambda index: {"metadata": {"uid": str(index)}})
    assert len(list(items(server, "/api/v1/nodes?a=b"))) == 2000
    assert max(server.limits) == paging.MOST


def test_a_page_that_turns_out_too_heavy_is_asked_for_again_with_fewer():
    """Nothing is lost or seen twice where small pods are followed by large ones, and those by small ones."""
    server = PagedServer(900, lambda index: a_heavy_pod(index, MIB if 400 <= index < 410 else 100))
    names = [pod["metadata"]["name"] for pod in items(server, "/api/v1/pods")]
    assert names == [f"heavy-{index}" for index in range(900)]
    assert len(server.limits) < 40


def test_an_object_beyond_the_bound_is_read_alone():
    server = PagedServer(3, lambda index: a_heavy_pod(index, paging.HEAVIEST + 1))
    assert len(list(items(server, "/api/v1/pods"))) == 3
    assert server.limits[-3:] == [1, 1, 1]
