"""What the doctor reads, and of which namespaces."""

from __future__ import annotations

import pytest

from contextpolicy.commands.doctor import facts
from contextpolicy.errors import ActuationError

EVERYWHERE = [{"metadata": {"name": "one", "namespace": "lab"}}, {"metadata": {"name": "two", "namespace": "hall"}}]


class FakeApi:
    """An API server without pods and nodes, which says what it was asked."""

    def __init__(self, forbidden=()):
        self._forbidden = forbidden

    def serves_policies(self):
        return True

    def policies(self, namespace):
        if namespace in self._forbidden:
            raise ActuationError("Forbidden", "no", retriable=False)
        return [one for one in EVERYWHERE if namespace in (None, one["metadata"]["namespace"])]

    def read(self, path):
        return {"gitVersion": "v1.36.3"} if path == "/version" else {"items": []}


@pytest.mark.parametrize(
    ("namespaces", "judged"), [([None], ["one", "two"]), (["lab"], ["one"]), (["hall", "lab"], ["two", "one"])]
)
def test_it_judges_the_policies_of_the_namespaces_asked_for(namespaces, judged):
    found = facts(FakeApi(), namespaces).policies
    assert [policy["metadata"]["name"] for policy in found] == judged


def test_policies_that_may_not_be_listed_are_unknown_and_not_missing():
    found = facts(FakeApi(forbidden=[None]), [None])
    assert (found.policies, found.serves_policies) == (None, True)
