"""What is written when, in virtual time; the worker runs when the test says so."""

from __future__ import annotations

from itertools import pairwise

import pytest
from reactivex.testing import TestScheduler

from contextpolicy.telemetry.reporter import STATUS_DELAY, STATUS_INTERVAL, STATUS_RETRY, Reporter
from contextpolicy.telemetry.status_budget import BURST, FOR_CONTEXTS, REFILL
from tests.actuators.resize.fake_cluster import UNREACHABLE, refusal
from tests.actuators.resize.rig import MOMENT
from tests.virtual_operator import Pool

POLICY = "lab/robot"


class Desk:
    """A reporter with its worker and the API that it writes to."""

    def __init__(self):
        self.scheduler, self.worker = TestScheduler(), Pool()
        self.statuses, self.events, self.faults = [], [], []
        self.made = 0
        self.reporter = Reporter(self, self.scheduler, self.worker)  # type: ignore[arg-type]  # it only submits

    def write_status(self, namespace, name, status):
        self._fail()
        self.statuses.append((self.now(), f"{namespace}/{name}", status["n"]))

    def post_event(self, namespace, event):
        self._fail()
        self.events.append((namespace, event["reason"], event["message"]))

    def _fail(self):
        if self.faults:
            raise self.faults.pop(0)

    def now(self):
        return round(self.scheduler.to_seconds(self.scheduler.now), 2)

    def status(self, n, policy=POLICY, *, contexts="-", ready="True"):
        conditions = [{"type": "Ready", "status": ready, "reason": "", "message": str(n)}]

        def make():
            self.made += 1
            return {"n": n, "contexts": contexts, "conditions": conditions}

        self.reporter.status(policy, make)

    def storm(self, seconds, *, contexts=("-",)):
        """Eight statuses a second, these contexts in turn."""
        for turn in range(seconds * 8):
            self.status(turn, contexts=contexts[turn % len(contexts)])
            self.wait(0.12)

    def event(self, message):
        self.reporter.event({"metadata": {"namespace": "lab"}, "reason": "Invalid", "message": message})

    def wait(self, seconds):
        """In steps of 10 ms, the worker at work."""
        for _ in range(round(seconds * 100)):
            while self.worker.jobs:
                self.worker.run()
            self.scheduler.advance_by(0.01)


@pytest.fixture
def desk():
    return Desk()


def test_a_status_lets_the_resizes_of_its_plan_go_first(desk):
    desk.status(1)
    assert desk.worker.jobs == []
    desk.wait(1)
    assert desk.statuses == [(STATUS_DELAY, POLICY, 1)]


def test_of_many_statuses_the_newest_is_written_at_most_once_per_interval(desk):
    for n in range(100):
        desk.status(n)
        desk.wait(0.01)
    desk.wait(1)
    written = [n for _, _, n in desk.statuses]
    times = [at for at, _, _ in desk.statuses]
    assert written[-1] == 99
    assert all(after - before > STATUS_INTERVAL - 0.001 for before, after in pairwise(times))
    assert len(written) <= 1 / STATUS_INTERVAL + 2


def test_what_is_no_news_is_not_written(desk):
    for n in (1, 1, 2, 1, 1):
        desk.status(n)
        desk.wait(3)
    assert [n for _, _, n in desk.statuses] == [1, 2, 1]


def test_what_was_refused_is_news_still(desk):
    desk.faults += [refusal("Invalid")]
    for _ in range(2):
        desk.status(1)
        desk.wait(3)
    assert [n for _, _, n in desk.statuses] == [1]


def test_a_status_is_made_when_it_is_written_not_when_it_is_announced(desk):
    desk.status(0)
    desk.wait(STATUS_DELAY + 0.05)
    facts = {"n": 1}
    desk.reporter.status(POLICY, lambda: dict(facts))
    facts["n"] = 2
    desk.wait(STATUS_INTERVAL + 0.1)
    assert [n for _, _, n in desk.statuses] == [0, 2]


def test_policies_do_not_wait_for_each_other(desk):
    desk.status(1)
    desk.status(2, "lab/other")
    desk.wait(STATUS_DELAY + 0.05)
    assert [policy for _, policy, _ in desk.statuses] == [POLICY, "lab/other"]


def test_a_status_that_could_not_be_written_is_written_later(desk):
    desk.faults += [UNREACHABLE, UNREACHABLE]
    desk.status(1)
    desk.wait(3 * STATUS_RETRY)
    [(at, _, n)] = desk.statuses
    assert n == 1
    assert at == pytest.approx(2 * STATUS_RETRY, abs=0.1)


def test_a_newer_status_takes_the_place_of_one_that_could_not_be_written(desk):
    desk.faults += [UNREACHABLE]
    desk.status(1)
    desk.wait(0.5)
    desk.status(2)
    desk.wait(2 * STATUS_RETRY)
    assert [n for _, _, n in desk.statuses] == [2]


def test_so_does_one_that_came_while_it_was_being_written(desk):
    desk.faults += [UNREACHABLE]
    desk.status(1)
    desk.scheduler.advance_by(STATUS_DELAY + 0.01)
    desk.status(2)
    desk.wait(2 * STATUS_RETRY)
    assert [n for _, _, n in desk.statuses] == [2]


@pytest.mark.parametrize("reason", ["NotFound", "Invalid", "Forbidden"])
def test_a_status_that_is_refused_is_given_up(desk, reason):
    desk.faults += [refusal(reason)]
    desk.status(1)
    desk.wait(5)
    assert desk.statuses == []
    desk.status(2)
    desk.wait(1)
    assert [n for _, _, n in desk.statuses] == [2]


def test_nothing_more_is_written_about_a_policy_that_is_gone(desk):
    desk.status(1)
    desk.wait(STATUS_DELAY + 0.05)
    desk.status(2)
    desk.reporter.forget(POLICY)
    desk.wait(1)
    assert [n for _, _, n in desk.statuses] == [1]


def test_nor_is_what_could_not_be_written_before(desk):
    desk.faults += [UNREACHABLE]
    desk.status(1)
    desk.reporter.forget(POLICY)
    desk.wait(5)
    assert desk.statuses == []


def test_a_policy_of_the_same_name_begins_anew(desk):
    desk.faults += [UNREACHABLE]
    desk.status(1)
    desk.reporter.forget(POLICY)
    desk.status(2)
    desk.wait(5)
    assert [n for _, _, n in desk.statuses] == [2]


@pytest.mark.parametrize("running", [False, True], ids=["waits", "fails"])
def test_nor_does_it_wait_because_of_what_was_left_to_write(desk, running):
    desk.faults += [UNREACHABLE] * running
    desk.status(1)
    desk.scheduler.advance_by((STATUS_DELAY + 0.01) * running)
    desk.reporter.forget(POLICY)
    desk.wait(1)
    desk.status(2)
    desk.wait(STATUS_DELAY + 0.05)
    assert [n for _, _, n in desk.statuses] == [2]


# the budget


@pytest.mark.parametrize("contexts", [("-",), ("moving", "reading")])
def test_what_changes_all_the_time_is_written_now_and_then(desk, contexts):
    desk.storm(300, contexts=contexts)
    assert len(desk.statuses) <= BURST + 300 / REFILL
    times = [at for at, _, _ in desk.statuses]
    assert max(after - before for before, after in pairwise(times)) <= REFILL + 2 * STATUS_INTERVAL


def test_the_last_of_a_storm_is_written(desk):
    desk.storm(120)
    desk.wait(REFILL)
    written = len(desk.statuses)
    assert desk.statuses[-1][2] == 120 * 8 - 1
    desk.wait(5 * REFILL)
    assert len(desk.statuses) == written


def test_what_waits_is_made_when_it_is_due_and_not_before(desk):
    for n in range(BURST - FOR_CONTEXTS):
        desk.status(n)
        desk.wait(STATUS_INTERVAL + STATUS_DELAY + 0.1)
    before = desk.made
    desk.status(-1)
    desk.wait(REFILL + 1)
    assert desk.statuses[-1][2] == -1
    assert desk.made == before + 2


def test_in_a_storm_statuses_are_made_once_a_second(desk):
    desk.storm(60)
    before, began = desk.made, desk.now()
    desk.storm(60)
    assert desk.made - before <= (desk.now() - began) / STATUS_INTERVAL + 1


def test_a_condition_does_not_wait_for_a_storm_to_end(desk):
    desk.storm(120, contexts=("moving", "reading"))
    desk.status(-1, ready="False")
    desk.wait(STATUS_DELAY + STATUS_INTERVAL + 0.1)
    assert desk.statuses[-1][2] == -1


def test_a_context_does_not_wait_for_weights_that_move_with_every_sample(desk):
    desk.storm(120)
    desk.status(-1, contexts="moving")
    desk.wait(STATUS_DELAY + STATUS_INTERVAL + 0.1)
    assert desk.statuses[-1][2] == -1


def test_conditions_that_flap_are_bounded_too(desk):
    for turn in range(300):
        desk.status(turn, ready=str(turn % 2 == 0))
        desk.wait(1)
    assert len(desk.statuses) <= BURST + 300 / REFILL


def test_after_a_quiet_time_a_status_is_written_at_once(desk):
    desk.storm(120)
    desk.wait((BURST + 1) * REFILL)
    desk.status(-1)
    desk.wait(STATUS_DELAY + 0.05)
    assert desk.statuses[-1][2] == -1


def test_what_fails_costs_nothing(desk):
    desk.faults += [UNREACHABLE] * 2 * BURST
    desk.status(1)
    desk.wait(2 * BURST * STATUS_RETRY + 1)
    assert [n for _, _, n in desk.statuses] == [1]


def test_nothing_is_made_any_more_for_a_policy_that_is_gone(desk):
    desk.storm(120)
    desk.reporter.status(POLICY, lambda: pytest.fail("the policy is gone"))
    desk.reporter.forget(POLICY)
    desk.wait(2 * REFILL)


# events


def test_who_calls_knows_what_is_news(desk):
    for _ in range(2):
        desk.event("no tasks")
    desk.wait(0.1)
    assert desk.events == [("lab", "Invalid", "no tasks")] * 2


def test_what_nobody_foresaw_is_tried_again_like_any_failure(desk):
    desk.faults += [RuntimeError("token file is gone"), RuntimeError("still")]
    desk.status(1)
    desk.wait(3 * STATUS_RETRY)
    assert [n for _, _, n in desk.statuses] == [1]
    desk.faults += [RuntimeError("and again")]
    desk.event("a")
    desk.event("b")
    desk.wait(0.1)
    assert [message for _, _, message in desk.events] == ["b"]


def test_an_event_that_is_refused_hinders_nothing(desk):
    desk.faults += [refusal("Forbidden")]
    desk.event("a")
    desk.status(1)
    desk.wait(STATUS_DELAY + 0.05)
    assert [n for _, _, n in desk.statuses] == [1]


def test_closing_drops_what_waits(desk):
    desk.status(1)
    desk.reporter.close()
    desk.wait(MOMENT)
    assert (desk.statuses, desk.worker.ended) == ([], True)
