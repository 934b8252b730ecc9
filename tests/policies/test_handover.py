"""Containers that move between policies are given up before they are taken."""

from __future__ import annotations

import pytest

from contextpolicy.policies.handover import Holdings, givers_first


def handover(**changes):
    """Each policy's containers before and after, as words."""
    found = {policy: [frozenset(words.split()) for words in both] for policy, both in changes.items()}
    return givers_first({policy: Holdings(before, after) for policy, (before, after) in found.items()})


@pytest.mark.parametrize(
    ("changes", "order"),
    [
        ({"a": ("x", "x"), "b": ("y", "y")}, "a b"),
        ({"a": ("", "x"), "b": ("y", "")}, "a b"),
        ({"a": ("", "x"), "b": ("x", "")}, "b a"),
        ({"a": ("x", ""), "b": ("", "x")}, "a b"),
        ({"a": ("", "x"), "b": ("x", "y"), "c": ("y", "")}, "c b a"),
        ({"a": ("", "x y"), "b": ("x", ""), "c": ("z", "z"), "d": ("y", "")}, "b c d a"),
    ],
)
def test_owners_come_before_takers_and_else_the_order_stays(changes, order):
    assert handover(**changes) == (order.split(), [])


def test_of_policies_that_swap_containers_the_first_publishes_again():
    assert handover(a=("x", "y"), b=("y", "x")) == (["a", "b"], ["a"])


def test_of_policies_in_a_ring_one_publishes_again():
    order, again = handover(a=("x", "y"), b=("y", "z"), c=("z", "x"))
    assert sorted(order) == ["a", "b", "c"]
    assert again == ["a"]
