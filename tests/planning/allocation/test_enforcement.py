"""What a share means for weight and quota."""

from __future__ import annotations

import pytest

from contextpolicy.planning.allocation.enforcement import PROTECTED_WEIGHT, Amounts, amounts
from contextpolicy.policy.spec import Control, Task

TASK, CAPPED = Task("slam"), Task("slam", max=800)
PROTECTED = Task("nav", protected=True)
LIMIT, WEIGHT, SUSPEND = Control.LIMIT, Control.WEIGHT, Control.SUSPEND


@pytest.mark.parametrize(
    ("control", "task", "suspended", "expected"),
    [
        (LIMIT, TASK, False, Amounts(None, 200)),
        (LIMIT, CAPPED, False, Amounts(None, 200)),
        (LIMIT, TASK, True, Amounts(None, 200)),
        (WEIGHT, TASK, False, Amounts(200, None)),
        (WEIGHT, CAPPED, False, Amounts(200, 800)),
        (WEIGHT, PROTECTED, False, Amounts(PROTECTED_WEIGHT, None)),
        (WEIGHT, TASK, True, Amounts(0, 10)),
        (WEIGHT, CAPPED, True, Amounts(0, 10)),
        (SUSPEND, TASK, False, Amounts(None, None)),
        (SUSPEND, CAPPED, False, Amounts(None, 800)),
        (SUSPEND, PROTECTED, False, Amounts(None, None)),
        (SUSPEND, TASK, True, Amounts(None, 10)),
    ],
)
def test_a_share_of_200m(control, task, suspended, expected):
    assert amounts(control, task, 200, suspended=suspended) == expected


def test_a_protected_task_keeps_a_larger_share():
    assert amounts(WEIGHT, PROTECTED, 1900, suspended=False) == Amounts(1900, None)


@pytest.mark.parametrize("control", [WEIGHT, SUSPEND])
@pytest.mark.parametrize(("most", "containers", "quota"), [(800, 2, 400), (800, 3, 266), (30, 4, 10)])
def test_the_containers_of_a_task_divide_its_max(control, most, containers, quota):
    """A quota below what a suspended container keeps would suspend an active task."""
    assert amounts(control, CAPPED, 200, suspended=False, cap=most, containers=containers).quota == quota
