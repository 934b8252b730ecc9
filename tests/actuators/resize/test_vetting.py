"""After a restart: originals that the operator signed count, others only as far as the pod's owner says the same."""

from __future__ import annotations

from typing import Any

import pytest

from contextpolicy.actuators.resize.originals import Originals
from contextpolicy.actuators.resize.stored_originals import Signatures, StoredPod, signatures_with, write
from contextpolicy.actuators.resize.vetting import Vetted, Vetting
from contextpolicy.cluster.pod_parsing import view
from contextpolicy.cluster.pods import Cpu
from contextpolicy.policy.parsing import parse
from tests.actuators.resize.fake_cluster import FakeCluster
from tests.cluster.builders import a_pod, cpu
from tests.cluster.paged_server import MIB, PagedServer, a_heavy_policy, peak
from tests.policies.builders import a_policy

KEY, POLICY, OTHER = b"k" * 32, "lab/robot", "lab/other"
SIGNATURES = Signatures(KEY)
OWNER = {"apiVersion": "apps/v1", "kind": "ReplicaSet", "name": "slam-7d9f", "uid": "uid-owner", "controller": True}
PATH = "/apis/apps/v1/namespaces/lab/replicasets/slam-7d9f"
BY_US = "contextpolicy"


def a_resized_pod(name: str = "slam", *, manager: str = BY_US, owner: dict[str, Any] | None = OWNER) -> dict[str, Any]:
    """It has 990m by order of a policy."""
    fields: dict[str, Any] = {
        "f:spec": {"f:containers": {f'k:{{"name":"{name}"}}': {"f:resources": {"f:limits": {"f:cpu": {}}}}}}
    }
    managed = [{"manager": manager, "subresource": "resize", "time": "2026-01-01T00:00:00Z", "fieldsV1": fields}]
    owners: dict[str, Any] = {"ownerReferences": [owner]} if owner else {}
    return a_pod(name, {name: cpu("100m", "990m")}, managedFields=managed, **owners)


def an_owner(limit: str | None = "500m", uid: str = "uid-owner") -> dict[str, Any]:
    container = {"name": "slam", "resources": cpu("100m", limit)}
    return {"metadata": {"uid": uid}, "spec": {"template": {"spec": {"containers": [container]}}}}


def signed(limit: int, policy: str = POLICY, uid: str = "uid-slam", key: bytes = KEY) -> dict[str, Any]:
    entry = StoredPod("slam", {"slam": Cpu(100, limit)})
    return {uid: write(entry._replace(signature=Signatures(key).of(policy, uid, entry)))}


def unsigned(limit: str) -> dict[str, Any]:
    return {"uid-slam": {"pod": "slam", "containers": {"slam": {"request": "100m", "limit": limit}}}}


class Case:
    """A cluster in which no operator ran for a while."""

    def __init__(self, *pods: dict[str, Any], owner: dict[str, Any] | None = None, key: bytes | None = KEY) -> None:
        self.cluster = FakeCluster(*pods)
        if owner is not None:
            self.cluster.owners[PATH] = owner
        self.vetting = Vetting(signatures_with(key), self.cluster)
        for pod in pods:
            self.vetting.observe(view(pod))

    def vet(self, originals: object, *, spec: bool = True) -> Vetted:
        body = a_policy()
        body = {**body, "metadata": {**body["metadata"], "resourceVersion": "7"}, "status": {"originals": originals}}
        self.cluster.policies.setdefault(POLICY, {})
        found = self.vetting.vet(body, parse(body) if spec else None)
        assert found.stored.version == 7
        assert found.stored.raw == (originals if isinstance(originals, dict) else {})
        return found


def limits(vetted: Vetted) -> dict[str, int | None]:
    return {uid: entry.containers["slam"].limit for uid, entry in vetted.stored.pods.items()}


def test_signed_original_overrides_the_pod_template():
    """Somebody resized the pod in place before any policy."""
    found = Case(a_resized_pod(), owner=an_owner("700m")).vet(signed(500))
    assert (limits(found), found.doubts) == ({"uid-slam": 500}, ())


FORGED = {
    "not signed": unsigned("50m"),
    "signed by another key": signed(50, key=b"x" * 32),
    "signed for another policy": signed(50, policy=OTHER),
    "signed for another pod": {"uid-slam": signed(50, uid="uid-other")["uid-other"]},
    "signed for another limit": {"uid-slam": {**signed(500)["uid-slam"], "containers": {"slam": {"limit": "50m"}}}},
    "said to be an agent's": {"uid-slam": {**signed(500)["uid-slam"], "agent": True}},
    "no entry": {"uid-slam": 5},
    "no signature": {"uid-slam": {**signed(50)["uid-slam"], "signature": ["\ud800"]}},
}


@pytest.mark.parametrize("originals", FORGED.values(), ids=FORGED)
def test_pod_template_overrides_an_unsigned_original(originals):
    found = Case(a_resized_pod(), owner=an_owner()).vet(originals)
    assert limits(found) == {"uid-slam": 500}
    assert all(doubt.settled for doubt in found.doubts)


def test_a_forgery_is_reported_with_both_values():
    [doubt] = Case(a_resized_pod(), owner=an_owner()).vet(unsigned("50m")).doubts
    assert doubt.text == (
        "lab/slam/slam: status.originals has request 100m, limit 50m, not signed by the operator; "
        "using request 100m, limit 500m from ReplicaSet slam-7d9f"
    )


def test_an_unsigned_but_correct_original_is_not_reported():
    assert Case(a_resized_pod(), owner=an_owner()).vet(unsigned("500m")).doubts == ()


@pytest.mark.parametrize(("originals", "news"), [({}, False), (unsigned("50m"), True)])
def test_template_match_excuses_a_missing_but_not_a_forged_entry(originals, news):
    assert bool(Case(a_resized_pod(), owner=an_owner("990m")).vet(originals).doubts) is news


UNKNOWN = {
    "no owner": (a_resized_pod(owner=None), None),
    "an owner of another kind": (a_resized_pod(owner={**OWNER, "kind": "Robot"}), an_owner()),
    "an owner that is gone": (a_resized_pod(), None),
    "another owner of that name": (a_resized_pod(), an_owner(uid="uid-new")),
    "no such container": (a_resized_pod("map"), an_owner()),
    "an owner without a template": (a_resized_pod(), {"metadata": {"uid": "uid-owner"}, "spec": {}}),
}


@pytest.mark.parametrize(("pod", "owner"), UNKNOWN.values(), ids=UNKNOWN)
def test_unprovable_original_is_reported_and_kept(pod, owner):
    name = pod["metadata"]["name"]
    forged = {f"uid-{name}": {"pod": name, "containers": {name: {"request": "100m", "limit": "50m"}}}}
    found = Case(pod, owner=owner).vet(forged)
    [doubt] = found.doubts
    assert not doubt.settled
    assert (found.stored.pods, found.stored.unproven) == ({}, {f"uid-{name}": doubt.text})
    assert doubt.text.endswith(
        "no owner of the pod states its original CPU, so it keeps request 100m, limit 990m, and the entry stays; "
        "replace the pod"
    )


def test_entry_signed_by_another_release_is_not_overwritten():
    """A standby took over while the first one's operator was away: its entry is true, and we have another key."""
    entry = signed(500, key=b"x" * 32)
    case = Case(a_resized_pod(owner=None))
    found = case.vet(entry)
    assert "has request 100m, limit 500m, signed with another key than this release's" in found.doubts[0].text
    assert found.doubts[0].text.endswith("let the release that signed it serve the namespace, or replace the pod")
    originals = Originals(SIGNATURES)
    originals.recall(POLICY, found.stored, lambda _: True)
    assert originals.changes(POLICY) == {}
    assert originals.doubt("uid-slam") == found.doubts[0].text
    originals.drop_pod("uid-slam")
    assert originals.changes(POLICY) == {"uid-slam": None}


def test_pod_with_an_injected_container_stays_unproven():
    """An injected container is in no template, and the signature is over both."""
    pod = a_resized_pod()
    beside = a_resized_pod("map")
    pod["spec"]["containers"] += beside["spec"]["containers"]
    pod["metadata"]["managedFields"] += beside["metadata"]["managedFields"]
    found = Case(pod, owner=an_owner("700m")).vet(signed(500, key=b"x" * 32))
    assert (found.stored.pods, list(found.stored.unproven)) == ({}, ["uid-slam"])
    assert [(doubt.name, doubt.settled) for doubt in found.doubts] == [("map", False)]


def test_emptied_status_is_detected_for_selected_pods():
    found = Case(a_resized_pod(), owner=an_owner()).vet({})
    assert limits(found) == {"uid-slam": 500}
    assert [doubt.text.partition("; ")[0] for doubt in found.doubts] == [
        "lab/slam/slam: status.originals no longer has an entry"
    ]


@pytest.mark.parametrize("manager", ["contextpolicy-restore", "vpa-updater", "kubelet"])
def test_missing_entry_is_ignored_if_another_writer_resized_last(manager):
    found = Case(a_resized_pod(manager=manager), owner=an_owner()).vet({})
    assert (found.stored.pods, found.doubts) == ({}, ())


def test_pod_that_was_never_resized_needs_no_original():
    found = Case(a_pod("slam")).vet(unsigned("50m"))
    assert (found.stored.pods, found.doubts) == ({}, ())


def test_original_held_by_another_policy_is_not_missing():
    case = Case(a_resized_pod(), owner=an_owner())
    case.cluster.policies[OTHER] = signed(500, OTHER)
    assert case.vet({}) == Case().vet({})


def test_heavy_policies_of_others_do_not_exhaust_the_memory(monkeypatch):
    case = Case(a_resized_pod(), owner=an_owner())
    monkeypatch.setattr(case.cluster, "read_page", PagedServer(100, a_heavy_policy).read_page)
    assert peak(lambda: case.vet({})) < 40 * MIB
    assert limits(case.vet({})) == {"uid-slam": 500}


def test_forged_entry_in_another_policy_does_not_count_as_held():
    case = Case(a_resized_pod(), owner=an_owner())
    case.cluster.policies[OTHER] = unsigned("50m")
    assert limits(case.vet({})) == {"uid-slam": 500}


IDLE: dict[str, dict[str, Any] | None] = {
    "dry run": {"mode": "DryRun"},
    "paused": {"mode": "Paused"},
    "shadow": {"shadow": {"of": "other"}},
    "invalid": None,
}


@pytest.fixture(params=list(IDLE.values()), ids=list(IDLE))
def idle(request):
    """Vet a policy that acts no more, and whose status was emptied."""

    def vet(case: Case, **others: Any) -> Vetted:
        body = a_policy(**(request.param or {}))
        body["metadata"]["resourceVersion"] = "7"
        case.cluster.policies.update({POLICY: {}, **others})
        return case.vetting.vet(body, None if request.param is None else parse(body))

    return vet


def test_emptied_status_is_detected_whatever_the_policy_has_become(idle):
    found = idle(Case(a_resized_pod(), owner=an_owner()))
    assert (limits(found), [doubt.settled for doubt in found.doubts]) == ({"uid-slam": 500}, [True])


def test_policy_that_does_not_act_leaves_what_is_as_its_owner_says(idle):
    """The last plan of another, deleted policy may have given it just that."""
    assert idle(Case(a_resized_pod(), owner=an_owner("990m"))) == idle(Case())


def test_policy_that_does_not_act_reports_a_bare_pod_of_which_no_status_says_anything(idle):
    found = idle(Case(a_resized_pod(owner=None)))
    assert (found.stored.pods, found.stored.unproven, found.doubts) == ({}, {}, ())
    assert found.unknown == {
        "lab/slam/slam": "an operator resized it, and no status.originals has an entry for it; "
        "no owner of the pod states its original, so it keeps request 100m, limit 990m"
    }


def test_policy_that_does_not_act_lacks_nothing_that_another_has(idle):
    for case in (Case(a_resized_pod(), owner=an_owner()), Case(a_resized_pod(owner=None))):
        assert idle(case, **{OTHER: signed(500, OTHER)}) == idle(Case())


def test_pods_of_other_namespaces_are_ignored():
    pod = a_resized_pod()
    pod["metadata"]["namespace"] = "far"
    found = Case(pod, owner=an_owner()).vet(unsigned("50m"))
    assert (found.stored.pods, found.doubts) == ({}, ())


def test_a_pod_that_is_gone_or_put_back_is_forgotten():
    case = Case(a_resized_pod(), owner=an_owner())
    case.vetting.forget("uid-slam")
    assert case.vet(unsigned("50m")).stored.pods == {}
    case = Case(a_resized_pod(), owner=an_owner())
    case.vetting.observe(view(a_resized_pod(manager="contextpolicy-restore")))
    assert case.vet(unsigned("50m")).stored.pods == {}


def test_status_is_trusted_without_a_key():
    found = Case(a_resized_pod(), owner=an_owner("700m"), key=None).vet(unsigned("500m"))
    assert (limits(found), found.doubts) == ({"uid-slam": 500}, ())


def test_each_owner_is_read_once():
    case = Case(*(a_resized_pod(f"slam-{index}") for index in range(5)), owner=an_owner())
    asked: list[str] = []

    class Api(FakeCluster):
        def read(self, path: str) -> dict[str, Any]:
            asked.append(path)
            return case.cluster.read(path)

    case.vetting = Vetting(SIGNATURES, Api())
    for pod in case.cluster.pods.values():
        case.vetting.observe(view(pod))
    case.vet(dict.fromkeys(case.cluster.pods, 5))
    assert asked == [PATH]
