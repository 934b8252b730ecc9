from __future__ import annotations

import pytest

from contextpolicy.policy.selectors import Selector, SelectorRequirement

LABELS = {"app": "slam", "tier": "edge"}


@pytest.mark.parametrize(
    ("requirement", "matches"),
    [
        (SelectorRequirement("app", "In", ("slam", "nav")), True),
        (SelectorRequirement("app", "In", ("nav",)), False),
        (SelectorRequirement("zone", "In", ("a",)), False),
        (SelectorRequirement("app", "NotIn", ("nav",)), True),
        (SelectorRequirement("app", "NotIn", ("slam",)), False),
        (SelectorRequirement("zone", "NotIn", ("a",)), True),
        (SelectorRequirement("app", "Exists"), True),
        (SelectorRequirement("zone", "Exists"), False),
        (SelectorRequirement("zone", "DoesNotExist"), True),
        (SelectorRequirement("app", "DoesNotExist"), False),
    ],
)
def test_a_requirement_matches_as_the_api_server_decides(requirement, matches):
    assert requirement.matches(LABELS) is matches


def test_all_requirements_must_match():
    both = Selector((SelectorRequirement("app", "In", ("slam",)), SelectorRequirement("tier", "In", ("edge",))))
    assert both.matches(LABELS)
    assert not both.matches({"app": "slam"})


def test_a_selector_reads_as_kubectl_takes_it():
    requirements = [
        SelectorRequirement("app", "In", ("slam",)),
        SelectorRequirement("tier", "NotIn", ("a", "b")),
        SelectorRequirement("gpu", "Exists"),
        SelectorRequirement("old", "DoesNotExist"),
    ]
    assert str(Selector(tuple(requirements))) == "app=slam,tier notin (a,b),gpu,!old"
