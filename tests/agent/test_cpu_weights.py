"""CPU weights: at every level where containers compete, kept against the kubelet, and undone."""

from __future__ import annotations

import shutil
from time import monotonic

import pytest

from contextpolicy.agent.cpu_weights import Weights
from contextpolicy.agent.ledger import Ledger
from contextpolicy.agent.weight_units import FILES, LEAST, of_container, of_pod
from tests.agent.builders import CHAT, LAYOUTS, POLICY, SANDBOX, SLAM, SPEECH, Watch

OTHER = "robot/other"


@pytest.fixture
def journal(tmp_path):
    return tmp_path / "agent.journal"


@pytest.fixture
def watch():
    return Watch()


@pytest.fixture
def weights(tree, journal, watch):
    return Weights(tree.version, watch, Ledger(journal))


@pytest.fixture
def restarted(tree, journal, watch):
    """The next run, with what the journal of this one says."""

    def restart():
        ledger = Ledger(journal)
        ledger.load()
        return Weights(tree.version, watch, ledger)

    return restart


def request(tree, group, millicores):
    """The kubelet makes a pod of one container with a request."""
    tree.set_weight(group, of_container(millicores, tree.version))
    tree.set_weight(group.parent, of_pod(millicores, tree.version))


def sum_up(tree, group):
    """The kubelet gives a class the sum of its pods' requests; here of their weights: the same in version 1."""
    tree.set_weight(group, sum(tree.weight(pod) for pod in group.iterdir() if pod.is_dir()))


@pytest.fixture
def slam(tree):
    group = tree.container(SLAM)
    request(tree, group, 10)
    return group


@pytest.fixture
def speech(tree):
    group = tree.container(SPEECH)
    request(tree, group, 10)
    return group


@pytest.fixture
def klass(tree, slam, speech):
    assert slam.parent.parent == speech.parent.parent
    sum_up(tree, slam.parent.parent)
    return slam.parent.parent


def everything(tree):
    return {path: tree.weight(path.parent) for path in tree.layout.top.rglob(FILES[tree.version])}


def write(tree, weights, group, weight):
    """The kubelet writes and the watch reports it."""
    tree.set_weight(group, weight)
    weights.on_other_write(tree.weight_file(group), monotonic())


@pytest.mark.usefixtures("klass")
def test_a_share_is_a_weight_of_container_and_pod(tree, weights, slam, speech):
    assert weights.apply(POLICY, {slam: 990, speech: 50}, {}) == {}
    for group, cores in ((slam, 990), (speech, 50)):
        assert tree.weight(group) == of_container(cores, tree.version)
        assert tree.weight(group.parent) == of_pod(cores, tree.version)


def test_a_class_has_the_sum_of_its_pods(tree, weights, slam, speech, klass):
    chat = tree.container(CHAT)
    request(tree, chat, 200)
    weights.apply(POLICY, {slam: 990, speech: 50}, {})
    assert tree.weight(klass) == sum(of_pod(cores, tree.version) for cores in (990, 50, 200))


def test_a_class_never_weighs_more_than_the_kernel_takes(tree, weights, slam, speech, klass):
    weights.apply(POLICY, {slam: 250_000, speech: 250_000}, {})
    assert tree.weight(klass) == {1: 262_144, 2: 10_000}[tree.version]


@pytest.mark.usefixtures("klass")
def test_the_group_of_all_pods_is_left_alone(tree, weights, slam, speech):
    before = tree.weight(tree.layout.top)
    weights.apply(POLICY, {slam: 990, speech: 50}, {})
    assert tree.weight(tree.layout.top) == before


@pytest.mark.usefixtures("klass")
def test_pod_weight_includes_its_other_containers(tree, weights, slam):
    sidecar = tree.container(CHAT, uid="uid-a")
    tree.set_weight(sidecar, of_container(500, tree.version))
    weights.apply(POLICY, {slam: 1000}, {})
    assert tree.weight(slam.parent) == pytest.approx(of_pod(1500, tree.version), rel=0.03)
    assert tree.weight(sidecar) == of_container(500, tree.version)


@pytest.mark.usefixtures("klass")
def test_a_sandbox_adds_nothing_to_its_pod(tree, weights, slam):
    tree.sandbox(slam)
    tree.set_weight(slam.parent / SANDBOX, LEAST[tree.version])
    weights.apply(POLICY, {slam: 1000}, {})
    assert tree.weight(slam.parent) == of_pod(1000, tree.version)


def test_a_pod_of_two_policies_has_both(tree, weights, slam):
    chat = tree.container(CHAT, uid="uid-a")
    weights.apply(POLICY, {slam: 1000}, {})
    weights.apply(OTHER, {chat: 2000}, {})
    assert tree.weight(slam.parent) == of_pod(3000, tree.version)
    weights.release(POLICY)
    assert tree.weight(chat) == of_container(2000, tree.version)
    assert tree.weight(slam) == of_container(10, tree.version)
    weights.release(OTHER)
    assert tree.weight(slam.parent) == of_pod(10, tree.version)


@pytest.mark.parametrize("level", ["container", "pod", "class"])
def test_weight_written_by_the_kubelet_is_overridden_and_restored_at_release(tree, weights, slam, klass, level):
    group = {"container": slam, "pod": slam.parent, "class": klass}[level]
    weights.apply(POLICY, {slam: 990}, {})
    ours = everything(tree)
    write(tree, weights, group, 77)
    assert everything(tree) == ours
    weights.release(POLICY)
    assert tree.weight(group) == 77


@pytest.mark.usefixtures("klass")
def test_equal_kubelet_write_becomes_the_restored_weight(tree, weights, slam, speech):
    weights.apply(POLICY, {slam: 990, speech: 50}, {})
    ours = tree.weight(slam)
    write(tree, weights, slam, ours)
    weights.apply(POLICY, {slam: 300, speech: 50}, {})
    weights.release(POLICY)
    assert tree.weight(slam) == ours


@pytest.mark.usefixtures("klass")
def test_plan_applied_before_a_write_report_wins(tree, weights, slam, speech):
    weights.apply(POLICY, {slam: 990, speech: 50}, {})
    tree.set_weight(slam, 77)
    weights.apply(POLICY, {slam: 500, speech: 50}, {})
    weights.on_other_write(tree.weight_file(slam), monotonic())
    assert tree.weight(slam) == of_container(500, tree.version)
    weights.release(POLICY)
    assert tree.weight(slam) == 77


def test_a_pod_that_starts_changes_its_class(tree, weights, slam, speech, klass):
    weights.apply(POLICY, {slam: 990, speech: 50}, {})
    chat = tree.container(CHAT)
    request(tree, chat, 400)
    write(tree, weights, klass, 5)
    assert tree.weight(klass) == sum(of_pod(cores, tree.version) for cores in (990, 50, 400))


def test_a_pod_that_ends_changes_its_class(tree, weights, slam, speech, klass):
    weights.apply(POLICY, {slam: 990, speech: 50}, {})
    shutil.rmtree(speech.parent)
    failed = weights.apply(POLICY, {slam: 990}, {})
    assert (failed, tree.weight(klass)) == ({}, of_pod(990, tree.version))


@pytest.mark.usefixtures("klass")
def test_release_leaves_everything_as_it_was(tree, weights, slam, speech, watch):
    before = everything(tree)
    weights.apply(POLICY, {slam: 990, speech: 50}, {})
    weights.apply(POLICY, {slam: 40}, {})
    weights.release(POLICY)
    assert everything(tree) == before
    assert not watch.paths


def test_a_container_that_no_plan_names_gets_its_weight_back(tree, weights, slam, speech, klass):
    weights.apply(POLICY, {slam: 990, speech: 50}, {})
    weights.apply(POLICY, {slam: 990}, {})
    assert tree.weight(speech) == of_container(10, tree.version)
    assert tree.weight(klass) == of_pod(990, tree.version) + of_pod(10, tree.version)


@pytest.mark.usefixtures("klass")
def test_restarted_agent_restores_the_original_weights(tree, weights, slam, speech, restarted):
    before = everything(tree)
    weights.apply(POLICY, {slam: 990, speech: 50}, {})
    after = restarted()
    after.apply(POLICY, {slam: 300, speech: 300}, {})
    after.release(POLICY)
    assert everything(tree) == before


@pytest.mark.usefixtures("klass")
def test_the_next_run_undoes_a_policy_without_a_plan(tree, weights, slam, speech, restarted):
    before = everything(tree)
    weights.apply(POLICY, {slam: 990, speech: 50}, {})
    restarted().release(POLICY)
    assert everything(tree) == before


@pytest.mark.usefixtures("klass")
def test_external_writes_without_an_agent_are_kept(tree, weights, slam, speech, restarted):
    weights.apply(POLICY, {slam: 990, speech: 50}, {})
    tree.set_weight(slam, 77)
    restarted().release(POLICY)
    assert tree.weight(slam) == 77


@pytest.mark.usefixtures("klass")
def test_missing_container_fails_alone(tree, weights, slam, speech):
    shutil.rmtree(slam)
    failed = weights.apply(POLICY, {slam: 990, speech: 50}, {})
    assert {group: error.reason for group, error in failed.items()} == {slam: "Gone"}
    assert tree.weight(speech) == of_container(50, tree.version)


@pytest.mark.usefixtures("klass")
def test_equal_weights_are_not_rewritten(tree, weights, slam, speech):
    weights.apply(POLICY, {slam: 990, speech: 50}, {})
    times = {path: path.stat().st_mtime_ns for path in everything(tree)}
    weights.apply(POLICY, {slam: 990, speech: 50}, {})
    assert times == {path: path.stat().st_mtime_ns for path in everything(tree)}


@pytest.mark.usefixtures("klass")
def test_a_report_about_a_group_that_is_gone_is_ignored(tree, weights, slam, speech):
    weights.apply(POLICY, {slam: 990, speech: 50}, {})
    shutil.rmtree(slam.parent)
    weights.on_other_write(tree.weight_file(slam), monotonic())
    weights.release(POLICY)
    assert tree.weight(speech) == of_container(10, tree.version)


@pytest.mark.usefixtures("klass")
def test_a_container_without_the_cpu_controller_is_reported_and_stops_nothing(tree, weights, slam, speech):
    tree.weight_file(slam).unlink()
    failed = weights.apply(POLICY, {slam: 990, speech: 50}, {})
    assert {group: error.reason for group, error in failed.items()} == {slam: "NotEnabled"}
    assert tree.weight(speech) == of_container(50, tree.version)
    weights.release(POLICY)
    assert tree.weight(speech) == of_container(10, tree.version)


V2 = pytest.mark.parametrize("tree", LAYOUTS[2:], indirect=True, ids=str)
LINEAR = pytest.mark.parametrize("linear", [False, True], ids=["newer runtime", "older runtime"])


@pytest.fixture
def sidecar(tree, slam, linear):
    """Unmanaged, of 500m, in the pod of a container of 100m."""
    group = tree.container(CHAT, uid="uid-a")
    tree.set_weight(slam, of_container(100, 2, linear=linear))
    tree.set_weight(group, of_container(500, 2, linear=linear))
    return group


@V2
@LINEAR
@pytest.mark.usefixtures("klass")
def test_sidecar_counts_as_its_request_whichever_way_its_runtime_converts_that(tree, weights, slam, sidecar):
    weights.apply(POLICY, {slam: 0}, {slam: 100})
    assert tree.weight(slam.parent) == pytest.approx(of_pod(500, 2), abs=1)
    weights.apply(POLICY, {slam: 500}, {slam: 100})
    assert tree.weight(slam) == tree.weight(sidecar)
    assert tree.weight(slam.parent) == pytest.approx(of_pod(1000, 2), abs=1)


@V2
@LINEAR
@pytest.mark.usefixtures("klass")
def test_restarted_agent_restores_the_conversion_from_the_journal(tree, weights, slam, sidecar, restarted):
    weights.apply(POLICY, {slam: 300}, {slam: 100})
    restarted().apply(POLICY, {slam: 500}, {slam: 100})
    assert tree.weight(slam) == tree.weight(sidecar)


@V2
@LINEAR
@pytest.mark.usefixtures("klass")
@pytest.mark.parametrize("request_of_slam", [{}, {"slam": 777}], ids=["without a request", "of another weight"])
def test_other_pods_show_the_conversion_where_a_container_does_not(  # noqa: PLR0913, PLR0917 - fixtures
    tree, weights, slam, sidecar, speech, linear, request_of_slam
):
    tree.set_weight(speech, of_container(200, 2, linear=linear))
    known = dict(zip([slam], request_of_slam.values(), strict=False))
    weights.apply(POLICY, {slam: 500, speech: 50}, known | {speech: 200})
    assert tree.weight(slam) == tree.weight(sidecar)
