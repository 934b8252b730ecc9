"""What is known of one pod between a patch and its effect."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import pytest

from contextpolicy.actuators.resize.pauses import FAILED
from contextpolicy.actuators.resize.pod_patch import Patch
from contextpolicy.actuators.resize.pod_state import TRANSITIONS, Event, Phase, PodState
from contextpolicy.cluster.pod_parsing import view
from contextpolicy.cluster.pods import Cpu
from contextpolicy.errors import ActuationError
from tests.actuators.resize.fake_cluster import UNREACHABLE
from tests.cluster.builders import a_pod, cpu

POLICY = "lab/robot"
NOW = 1000.0
OLD, NEW, MORE = Cpu(100, 500), Cpu(100, 300), Cpu(100, 900)
BUSY = ActuationError("Conflict", "no", retriable=True)

HAPPENINGS = {
    Event.SENT: lambda state: state.send(Patch(POLICY, {"slam": NEW})),
    Event.ACCEPTED: lambda state: state.accept(102, NOW),
    Event.REFUSED: lambda state: state.refuse(),
    Event.POSTPONED: lambda state: state.postpone(BUSY, NOW),
    Event.LOST: lambda state: state.lose(UNREACHABLE, NOW),
    Event.DUE: lambda state: state.wake(),
    Event.FOUND: lambda state: state.find(state.view, NOW),
    Event.MISSING: lambda state: state.miss(),
}
WAYS = {
    Phase.IDLE: [],
    Phase.IN_FLIGHT: [Event.SENT],
    Phase.RETRYING: [Event.SENT, Event.POSTPONED],
    Phase.UNSURE: [Event.SENT, Event.LOST],
    Phase.ASKING: [Event.SENT, Event.LOST, Event.DUE],
    Phase.GONE: [Event.SENT, Event.MISSING, Event.MISSING],
}
"""How each phase is reached."""


@pytest.fixture
def state():
    return PodState(view(a_pod()))


def happen(state, *events):
    for event in events:
        HAPPENINGS[event](state)


def send(state, resources=NEW, *, restore=False):
    state.send(Patch(POLICY, {"slam": resources}, restore))


def shown(state, *, spec=NEW, actual=OLD, generation=2, observed=2, version=103):  # noqa: PLR0913 - one field each
    """What the watch shows next."""
    [container] = state.view.containers
    containers = (replace(container, spec=spec, actual=actual),)
    seen = replace(state.view, containers=containers, generation=generation, observed_generation=observed)
    return state.observe(replace(seen, version=version))


def test_every_phase_is_reached_and_every_event_happens():
    assert WAYS.keys() == TRANSITIONS.keys() == set(Phase)
    assert {event for events in TRANSITIONS.values() for event in events} == HAPPENINGS.keys() == set(Event)


@pytest.mark.parametrize(("phase", "event"), list(product(Phase, Event)))
def test_each_event_leads_to_the_phase_in_the_table(state, phase, event):
    happen(state, *WAYS[phase])
    assert state.phase is phase
    if event in TRANSITIONS[phase]:
        HAPPENINGS[event](state)
        assert state.phase is TRANSITIONS[phase][event]
    else:
        with pytest.raises(KeyError):
            HAPPENINGS[event](state)


@pytest.mark.parametrize("phase", Phase)
def test_reading_the_state_changes_nothing(state, phase):
    happen(state, *WAYS[phase])

    def ask():
        return state.spec("slam"), state.highest("slam"), state.settles_at, state.originator, state.ready, state.due

    assert ask() == ask()
    assert state.phase is phase


@pytest.mark.parametrize("phase", Phase)
def test_spec_is_unknown_while_an_answer_is_missing(state, phase):
    happen(state, *WAYS[phase])
    assert (state.spec("slam") is None) is (phase in (Phase.UNSURE, Phase.ASKING))


def test_while_a_patch_is_under_way_both_limits_may_hold(state):
    send(state, MORE)
    assert state.highest("slam") == 900
    other = PodState(state.view)
    send(other)
    assert other.highest("slam") == 500


def test_an_accepted_patch_is_the_spec_before_the_watch_shows_it(state):
    send(state)
    state.accept(102, NOW)
    assert (state.spec("slam"), state.highest("slam")) == (NEW, 500)


def test_a_decrease_holds_until_the_kubelet_reports_it(state):
    send(state)
    state.accept(102, NOW)
    shown(state, observed=1)
    assert state.highest("slam") == 500
    shown(state, version=104)
    assert state.highest("slam") == 500
    shown(state, actual=NEW, version=105)
    assert state.highest("slam") == 300


def test_a_resize_that_is_held_back_has_not_passed(state):
    send(state)
    state.accept(102, NOW)
    state.view = replace(state.view, pending="Deferred: full")
    shown(state, actual=NEW)
    assert state.highest("slam") == 500


def test_stale_watch_events_are_ignored(state):
    send(state)
    state.accept(200, NOW)
    assert not shown(state, spec=OLD, generation=1, version=199)
    assert state.spec("slam") == NEW


def test_watch_event_ahead_of_the_answer_counts(state):
    send(state)
    shown(state, actual=NEW, version=110)
    state.accept(105, NOW)
    assert (state.spec("slam"), state.highest("slam")) == (NEW, 300)


def test_refused_patch_leaves_the_state_unchanged(state):
    send(state, MORE)
    state.refuse()
    assert (state.spec("slam"), state.highest("slam"), state.originator) == (OLD, 500, None)


def test_unanswered_patch_counts_until_resolved(state):
    send(state, MORE)
    state.lose(UNREACHABLE, NOW)
    assert (state.highest("slam"), state.originator) == (900, POLICY)
    state.wake()
    assert not state.find(state.view, NOW)
    assert (state.highest("slam"), state.originator, state.spec("slam")) == (500, None, OLD)


def test_patch_found_in_effect_counts_as_accepted(state):
    happen(state, *WAYS[Phase.ASKING])
    [container] = state.view.containers
    found = replace(state.view, containers=(replace(container, spec=NEW),), generation=2, version=110)
    assert state.find(found, NOW)
    assert (state.spec("slam"), state.highest("slam"), state.settles_at > NOW) == (NEW, 500, True)


def test_lowered_original_is_restored_once_the_kubelet_confirms(state):
    send(state)
    state.accept(102, NOW)
    state.expect_back("slam", POLICY)
    assert state.putting_back == {"slam": POLICY}
    shown(state, actual=NEW, version=105)
    assert state.putting_back == {}


def test_failures_in_a_row_make_the_pauses_longer_until_one_is_accepted(state):
    pauses = []
    for _ in range(4):
        send(state)
        pauses.append(state.postpone(BUSY, NOW))
        state.wake()
    send(state)
    state.accept(102, NOW)
    send(state)
    assert [*pauses, state.postpone(BUSY, NOW)] == [0.1, 0.2, 0.4, 0.8, FAILED.first]


def test_container_is_putting_back_until_in_force(state):
    send(state, restore=True)
    state.accept(102, NOW)
    assert state.putting_back == {"slam": POLICY}
    shown(state, actual=NEW)
    assert state.putting_back == {}


def test_a_container_that_never_ran_counts_by_its_spec():
    pod = a_pod("slam", {"slam": cpu("100m", "500m")})
    del pod["status"]["containerStatuses"]
    state = PodState(view(pod))
    assert (state.highest("slam"), state.highest("unknown")) == (500, 0)
