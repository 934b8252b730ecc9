"""The states of a Lease in virtual time: candidates on one Lease, of which at most one may act at any instant."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest

from contextpolicy.cluster.lease import ACT, AGAIN, LONGEST, RENEW, Candidacy, Lease, OwnPod, read, write

WALL = "2026-01-01T00:00:00.000000Z"


class Cluster:
    """The API server's side: one Lease, replaced only by who knows its newest version."""

    def __init__(self):
        self.lease, self.versions = Lease(), 0

    def put(self, wanted):
        if wanted.version != self.lease.version:
            return None
        self.versions += 1
        self.lease = replace(wanted, version=str(self.versions), renewed=f"{WALL}{self.versions}")
        return self.lease

    def delete(self):
        self.lease = Lease()


def attempt(candidate, cluster, now, *, arrives=0.0):
    """One look or write of a candidate whose request takes `arrives` seconds; whether it had to pause before."""
    wanted = candidate.ask(WALL)
    if wanted is None:
        candidate.see(cluster.lease, now + arrives)
        return False
    written = cluster.put(wanted)
    if written is None:
        candidate.see(cluster.lease, now + arrives)
        candidate.fail(now + arrives)
        return False
    return candidate.succeed(written, now, now + arrives)


def acts(candidate, now):
    return now < candidate.acts_until


def a_leader(cluster, seconds=10):
    leader = Candidacy("one", seconds)
    attempt(leader, cluster, 0.0)
    attempt(leader, cluster, 0.0)
    assert acts(leader, 0.0)
    return leader


def a_standby(cluster, name="two", seconds=10, now=0.0):
    standby = Candidacy(name, seconds)
    attempt(standby, cluster, now)
    return standby


@pytest.fixture
def cluster():
    return Cluster()


def test_unheld_lease_is_taken_at_once(cluster):
    leader = a_leader(cluster)
    assert cluster.lease.holder == "one"
    assert (leader.acts_until, leader.due) == (ACT * 10, pytest.approx(RENEW * 10))
    assert cluster.lease.transitions == 1


def test_candidate_reads_the_lease_before_writing_it():
    candidate = Candidacy("one", 10)
    assert candidate.due < 0
    assert candidate.ask(WALL) is None
    assert not acts(candidate, 0)


def test_a_standby_waits_the_lease_duration_after_the_last_renewal_it_saw(cluster):
    leader, standby = a_leader(cluster, seconds=15), a_standby(cluster, seconds=1, now=2)
    assert standby.due == 17
    attempt(leader, cluster, 5)
    standby.see(cluster.lease, 5.5)
    assert standby.due == 20.5


def test_same_version_is_not_a_renewal(cluster):
    a_leader(cluster)
    standby = a_standby(cluster, now=1)
    standby.see(cluster.lease, 9)
    assert standby.due == 11


def test_an_older_version_is_ignored(cluster):
    leader = a_leader(cluster)
    old = cluster.lease
    attempt(leader, cluster, 3)
    leader.see(old, 3.1)
    attempt(leader, cluster, 6)
    assert leader.acts_until == 6 + ACT * 10


def test_standby_follows_only_an_observed_renewal(cluster):
    """One that was there before us may be dead: until its time is over nobody decides."""
    leader, standby = a_leader(cluster), a_standby(cluster)
    assert not standby.follows
    attempt(leader, cluster, 3)
    standby.see(cluster.lease, 3)
    assert standby.follows
    cluster.put(leader.resign())
    standby.see(cluster.lease, 4)
    assert not standby.follows
    attempt(standby, cluster, 4)
    assert not standby.follows
    assert not leader.follows


def test_a_released_lease_is_taken_as_soon_as_the_watch_reports_it(cluster):
    leader, standby = a_leader(cluster), a_standby(cluster)
    cluster.put(leader.resign())
    assert not acts(leader, 0)
    standby.see(cluster.lease, 1)
    assert standby.due == 1
    attempt(standby, cluster, 1)
    assert acts(standby, 1)


def test_a_resigned_holder_stops_campaigning(cluster):
    leader = a_leader(cluster)
    leader.resign()
    leader.see(Lease(), 2)
    assert leader.due == float("inf")


def test_standby_resigns_nothing(cluster):
    a_leader(cluster)
    assert a_standby(cluster).resign() is None


def test_a_replica_that_restarts_continues_with_the_lease_in_its_name(cluster):
    """Its kubelet starts it again only when the process before is dead."""
    a_leader(cluster)
    again = a_standby(cluster, name="one", now=1)
    assert not acts(again, 1), "not before it was renewed"
    assert again.due == 1
    attempt(again, cluster, 1)
    assert acts(again, 1)
    assert cluster.lease.transitions == 1


def test_paused_holder_stops_acting_after_its_lease(cluster):
    leader, standby = a_leader(cluster), a_standby(cluster)
    attempt(standby, cluster, standby.due)
    assert not acts(leader, 11)
    leader.see(cluster.lease, 11)
    assert leader.lost
    assert leader.due == float("inf"), "it must not take it back: all that it knows may be wrong"


def test_holder_pauses_while_the_api_is_unreachable(cluster):
    leader = a_leader(cluster)
    for now in (3.4, 5.0, 7.9):
        leader.fail(now)
        assert leader.due == now + AGAIN
    assert acts(leader, 7.9)
    assert not acts(leader, 8.1)
    assert attempt(leader, cluster, 20)
    assert acts(leader, 20)
    assert not leader.lost


def test_a_renewal_in_time_is_not_an_interruption(cluster):
    leader = a_leader(cluster)
    assert not attempt(leader, cluster, 3.4)
    assert not attempt(leader, cluster, 7, arrives=0.5)


def test_time_counts_from_when_a_renewal_was_sent(cluster):
    leader = a_leader(cluster)
    attempt(leader, cluster, 3, arrives=4)
    assert leader.acts_until == 3 + ACT * 10


def test_lost_renewal_answer_does_not_extend_the_lease(cluster):
    leader = a_leader(cluster)
    cluster.put(leader.ask(WALL))
    leader.fail(4)
    assert leader.acts_until == ACT * 10
    attempt(leader, cluster, 4.2)  # refused: its version is old
    assert leader.due == 4.2 + AGAIN
    attempt(leader, cluster, 4.4)
    assert leader.acts_until == 4.4 + ACT * 10


def test_deleted_lease_is_lost(cluster):
    leader, standby = a_leader(cluster), a_standby(cluster)
    cluster.delete()
    standby.see(cluster.lease, 1)
    attempt(standby, cluster, 1)
    leader.see(Lease(), 1)
    assert leader.lost
    assert not acts(leader, 1)


def test_a_lost_lease_race_waits_again(cluster):
    first, second = (Candidacy(name, 10) for name in ("one", "two"))
    for candidate in (first, second):
        attempt(candidate, cluster, 0)
    attempt(first, cluster, 1)
    attempt(second, cluster, 1)
    assert (acts(first, 1), acts(second, 1)) == (True, False)
    assert second.due == 11


@pytest.mark.parametrize("seed", range(20))
def test_two_candidates_never_act_at_once(seed):
    """Requests take up to twice a Lease, answers and watch events get lost, candidates freeze for longer than it."""
    dice = random.Random(seed)  # noqa: S311 - a story, not a secret
    cluster, candidates = Cluster(), [Candidacy(name, dice.choice([1, 2, 5])) for name in "abc"]
    asleep = dict.fromkeys("abc", 0.0)
    answers: list[tuple[float, Candidacy, Lease, float]] = []
    now, leaders = 0.0, set[str]()
    for _ in range(5000):
        now += dice.random() * 0.2
        for arrival, asker, granted, sent in [answer for answer in answers if answer[0] <= now]:
            asker.succeed(granted, sent, arrival)
        answers = [answer for answer in answers if answer[0] > now]
        acting = [candidate for candidate in candidates if acts(candidate, now)]
        assert len(acting) <= 1
        leaders.update(candidate.identity for candidate in acting)
        candidate = dice.choice(candidates)
        if now < asleep[candidate.identity] or any(answer[1] is candidate for answer in answers):
            continue
        if candidate.lost:
            candidates[candidates.index(candidate)] = Candidacy(candidate.identity, candidate.seconds)
        elif dice.random() < 0.1:
            asleep[candidate.identity] = now + dice.random() * 8
        elif candidate.due <= now:
            wanted = candidate.ask(WALL)
            written = cluster.put(wanted) if wanted else None
            if written is None:
                candidate.see(cluster.lease, now)
                candidate.fail(now)
            elif dice.random() < 0.2:
                candidate.fail(now)
            else:
                answers.append((now + dice.random() * 4, candidate, written, now))
        elif dice.random() < 0.5:
            candidate.see(cluster.lease, now)
    assert len(leaders) > 1, "otherwise nothing was tried"


# what is stored


def stored(**spec):
    return {"metadata": {"resourceVersion": "7"}, "spec": spec}


def test_a_lease_is_read_as_it_was_written():
    lease = Lease("one", 15, WALL, WALL, 3, "7")
    item = write(lease, "system", "contextpolicy")
    assert item["metadata"] == {"name": "contextpolicy", "namespace": "system", "resourceVersion": "7"}
    assert read(item) == lease


def test_a_lease_belongs_to_its_last_holders_pod():
    """As Kubernetes' garbage collector reads it; a pod that is gone must not take the Lease of the next one along."""
    candidate = Candidacy("two", 15, OwnPod("operator-2", "uid-2"))
    candidate.see(Lease("one", 15, WALL, WALL, 3, "7", OwnPod("operator-1", "uid-1")), 0)
    taken = candidate.ask(WALL)
    assert taken is not None
    item = write(taken, "system", "contextpolicy")
    [owner] = item["metadata"]["ownerReferences"]
    assert owner == {"apiVersion": "v1", "kind": "Pod", "name": "operator-2", "uid": "uid-2"}
    assert read(item) == taken


def test_times_that_a_lease_lacks_are_not_written():
    """The API server refuses an empty text for a time: a Lease made by hand could never be taken, nor renewed."""
    spec = write(Lease(holder="one", seconds=10), "lab", "contextpolicy")["spec"]
    assert (spec["renewTime"], spec["acquireTime"]) == (None, None)


def test_a_new_lease_has_no_version():
    assert "resourceVersion" not in write(Lease("one", 15), "system", "contextpolicy")["metadata"]


@pytest.mark.parametrize("spec", [{}, {"holderIdentity": None, "leaseDurationSeconds": None, "leaseTransitions": "x"}])
def test_missing_or_invalid_fields_count_as_absent(spec):
    assert read(stored(**spec)) == Lease(version="7")


def test_lease_duration_is_bounded():
    assert read(stored(holderIdentity="x", leaseDurationSeconds=10**9)).seconds == LONGEST
