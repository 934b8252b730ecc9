from __future__ import annotations

from contextpolicy.telemetry.event_budget import BURST, FOR_PROBLEMS, EventBudget


def test_flapping_contexts_leave_events_for_problems():
    budget = EventBudget()
    assert sum(budget.spend(1000.0, routine=True) for _ in range(BURST)) == BURST - FOR_PROBLEMS
    assert sum(budget.spend(1000.0) for _ in range(BURST)) == FOR_PROBLEMS


def test_the_next_event_says_how_many_were_left_out():
    budget = EventBudget()
    for _ in range(BURST + 2):
        budget.spend(0.0)
    assert budget.admit_to("hot") == "hot (2 earlier events were left out)"
    assert budget.admit_to("hot") == "hot"
