"""What a share means for weight and quota."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contextpolicy.planning.allocation.enforcement import PROTECTED_WEIGHT, Amounts, amounts, fitted, kept_weight
from contextpolicy.policy.spec import Control, Task

TASK, CAPPED = Task("slam"), Task("slam", max=800)
PROTECTED, MODEST = Task("nav", protected=True), Task("nav", protected=True, min=300)
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


@pytest.mark.parametrize(
    ("task", "share", "containers", "kept"),
    [(MODEST, 400, 2, 150), (MODEST, 90, 1, 90), (TASK, 200, 1, 10), (Task("slam", min=300), 400, 1, 10)],
)
def test_only_a_protected_tasks_weight_is_never_cut_below_its_min(task, share, containers, kept):
    assert kept_weight(task, share, containers) == kept


WEIGHTS = st.dictionaries(
    st.sampled_from("abcdefgh"),
    st.tuples(st.integers(1, 500), st.integers(0, 4000)).map(lambda own: (own[0], sum(own))),
)
"""What is kept, and what is wanted."""


@given(WEIGHTS, st.integers(0, 20_000))
def test_weights_fit_whatever_is_wanted(weights, most):
    kept, wanted = ({name: own[place] for name, own in weights.items()} for place in (0, 1))
    found = fitted(wanted, kept, most)
    assert found.keys() == wanted.keys()
    assert all(1 <= found[name] <= wanted[name] for name in wanted)
    assert sum(found.values()) <= max(most, len(wanted)), "0 would suspend"
    assert sum(found.values()) >= min(sum(wanted.values()), most) - len(wanted), "nothing is left over"
    if sum(kept.values()) <= most:
        assert all(found[name] >= kept[name] for name in wanted)


@given(WEIGHTS, st.integers(0, 20_000))
def test_weights_that_are_cut_compare_as_wanted(weights, most):
    kept, wanted = dict.fromkeys(weights, 1), {name: own[1] for name, own in weights.items()}
    found = fitted(wanted, kept, most)
    cut = [name for name in wanted if found[name] > 1]
    assert all(abs(found[a] * wanted[b] - found[b] * wanted[a]) <= wanted[a] + wanted[b] for a in cut for b in cut)
