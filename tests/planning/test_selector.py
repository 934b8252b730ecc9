from __future__ import annotations

import pytest

from contextpolicy.planning.selector import Requirement, Selector

LABELS = {"app": "slam", "tier": "edge"}


@pytest.mark.parametrize(
    ("requirement", "matches"),
    [
        (Requirement("app", "In", ("slam", "nav")), True),
        (Requirement("app", "In", ("nav",)), False),
        (Requirement("zone", "In", ("a",)), False),
        (Requirement("app", "NotIn", ("nav",)), True),
        (Requirement("app", "NotIn", ("slam",)), False),
        (Requirement("zone", "NotIn", ("a",)), True),
        (Requirement("app", "Exists"), True),
        (Requirement("zone", "Exists"), False),
        (Requirement("zone", "DoesNotExist"), True),
        (Requirement("app", "DoesNotExist"), False),
    ],
)
def test_a_requirement_matches_as_the_api_server_decides(requirement, matches):
    assert requirement.matches(LABELS) is matches


def test_all_requirements_must_match():
    both = Selector((Requirement("app", "In", ("slam",)), Requirement("tier", "In", ("edge",))))
    assert both.matches(LABELS)
    assert not both.matches({"app": "slam"})
