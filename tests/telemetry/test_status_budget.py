from __future__ import annotations

import pytest

from contextpolicy.telemetry.status_budget import FOR_CONDITIONS, FOR_CONTEXTS, reserve


def a_status(*, ready="True", message="", **fields):
    conditions = [{"type": "Ready", "status": ready, "reason": "Working", "message": message}]
    return {"observedGeneration": 1, "contexts": "-", "conditions": conditions, **fields}


@pytest.mark.parametrize(
    "after",
    [
        a_status(ready="False"),
        a_status(observedGeneration=2),
        a_status(promotedShadow="trial"),
        a_status(shadow={"reverted": {"generation": 1}}),
    ],
    ids=["condition", "generation", "promotion", "reverted"],
)
def test_urgent_conditions_may_use_the_last_status_write(after):
    assert reserve(a_status(), after) == 0


def test_the_first_status_may_take_the_last_write():
    assert reserve(None, a_status()) == 0


def test_contexts_leave_writes_for_conditions():
    assert reserve(a_status(), a_status(contexts="moving", tasks=[])) == FOR_CONDITIONS > 0


@pytest.mark.parametrize("after", [a_status(tasks=[{"weight": 2}]), a_status(message="more"), a_status(plan={})])
def test_sample_driven_statuses_leave_writes_for_contexts(after):
    assert reserve(a_status(), after) == FOR_CONTEXTS > FOR_CONDITIONS
