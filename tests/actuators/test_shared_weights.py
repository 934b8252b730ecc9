"""What several pods weigh together: beside a Guaranteed pod, as the containers of one task, and as a namespace's."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contextpolicy.actuators.order import order_of
from contextpolicy.actuators.resize.pod_state import PodState
from contextpolicy.actuators.resize.targets import target_cpu
from contextpolicy.actuators.resize.tracked_pod import TrackedPod
from contextpolicy.bus.plan_message import message
from contextpolicy.cluster.agent_reports import AgentReport, with_agents, writing
from contextpolicy.cluster.parts import Stake, parts
from contextpolicy.cluster.pod_parsing import view
from contextpolicy.policy.spec import Mode
from contextpolicy.policy.tenants import Tenant, Tenants
from tests.cluster.builders import NODE, a_pod, cpu, granted
from tests.cluster.claiming import claim
from tests.planning.builders import Story, a_policy, a_stream, a_task

TWO_CORES = {NODE: 2000}


def weighted(*tasks):
    return a_policy(
        streams=[a_stream("imu")], tasks=list(tasks), contexts=[], enforcement={"control": "Weight"}, reserve="0"
    )


def request_of(order, pod):
    target = target_cpu(order, f"lab/{pod.name}/{pod.name}", TrackedPod(PodState(pod)), pod.containers[0], None)
    return target.request or 0


def plan(policy, placement):
    story = Story(policy, placement)
    story.sample("imu", at=1, speed=0)
    return story.last


def test_requests_fit_beside_a_guaranteed_pod_with_a_fixed_request():
    policy = weighted(a_task("slam"), a_task("speech", priority=9), a_task("map"))
    resources = {
        "slam": cpu("1500m", "1500m", ("64Mi", "64Mi")),
        "speech": cpu("10m", "2"),
        "map": cpu("10m", "2"),
    }
    pods = [
        view(a_pod(name, {name: own}, qos="Guaranteed" if name == "slam" else "Burstable"))
        for name, own in resources.items()
    ]
    own = claim([policy], pods, TWO_CORES)[policy.reference]
    order = order_of(policy, own.placement.containers, plan(policy, own.placement).nodes, room=own.room)
    requests = {pod.name: request_of(order, pod) for pod in pods}
    assert requests["slam"] == 1500
    assert requests["speech"] > requests["map"]
    assert sum(requests.values()) <= 2000


def targets(policies, pods, nodes, **more):
    """What agents are to write for each policy, by reference."""
    reports = {NODE: AgentReport("", "")}
    claims = claim(policies, pods, nodes, agents=writing(reports), **more)
    made = {}
    for policy in policies:
        own = with_agents(policy, claims[policy.reference], reports)
        made[policy.reference] = message(
            policy, 1, plan(policy, own.placement), own.placement.containers, pods, own.most_weight
        )["targets"]
    return made


def weights(targets):
    """By task, in thousandths of a core."""
    found = Counter[str]()
    for target in targets:
        found[target["task"]] += round((target["weight"] or 0) * 1000)
    return found


@pytest.mark.parametrize("pods", [1, 2, 4])
def test_a_protected_task_weighs_a_core_over_all_its_containers_on_a_node(pods):
    """Beside the robot's other task, which has the rest of the node as its share."""
    policy = weighted(a_task("guard", protected=True, max="400m"), a_task("slam", priority=100))
    found = [view(a_pod(f"guard-{n}", {"guard": cpu("10m", "100m")}, labels={"app": "guard"})) for n in range(pods)]
    found.append(view(a_pod("slam", {"slam": cpu("10m", "2")})))
    [made] = targets([policy], found, TWO_CORES).values()
    share = sum(target["cores"] for target in made if target["task"] == "slam")
    own = weights(made)
    assert own["guard"] / own["slam"] == pytest.approx(1.0 / share, rel=0.02)
    assert 2000 - 2 * pods < sum(own.values()) <= 2000


def test_a_protected_task_weighs_a_core_beside_the_other_tasks_whatever_else_is_on_the_node():
    """As on the usual robot: one namespace, beside the pods of k3s and the operator, which keep their requests."""
    policy = weighted(
        a_task("nav", protected=True, priority=10), a_task("slam", priority=100), a_task("map", priority=3)
    )
    pods = [view(a_pod(name, {name: cpu("10m", "1")})) for name in ("nav", "slam", "map")]
    [alone] = targets([policy], pods, TWO_CORES).values()
    [beside] = targets([policy], pods, TWO_CORES, weighing={NODE: 300}).values()
    shares = {target["task"]: target["cores"] * 1000 for target in alone}
    for made, most in ((alone, 2000), (beside, 1700)):
        own = weights(made)
        assert most - 3 <= sum(own.values()) <= most
        assert own["nav"] / own["slam"] == pytest.approx(1000 / shares["slam"], rel=0.01)
        assert own["map"] / own["slam"] == pytest.approx(shares["map"] / shares["slam"], rel=0.03)


def test_many_protected_tasks_weigh_no_more_than_their_namespaces_part():
    """Ten pods that request 10m each weighed ten cores together, and left a robot less than it requests."""
    names = [f"t{n}" for n in range(10)]
    greedy = replace(weighted(*(a_task(name, protected=True) for name in names)), namespace="elsewhere")
    pods = [view(a_pod(name, {name: cpu("10m", "100")}, namespace="elsewhere", uid=name)) for name in names]
    robot, own = weighted(a_task("slam")), view(a_pod("slam", {"slam": cpu("620m", "1600m")}))
    made = targets([greedy, robot], [*pods, own], TWO_CORES, weighing={NODE: 300})
    assert sum(weights(made["elsewhere/robot"]).values()) <= 1 + 1700 * 100 // 720
    assert weights(made["lab/robot"])["slam"] >= 1700 * 620 // 720


@pytest.mark.parametrize("mode", [None, Mode.DRY_RUN, Mode.PAUSED])
def test_pods_that_no_policy_weighs_keep_their_requests(mode):
    """Without a policy of their own, or with one that does not enforce."""
    policy, driver = weighted(a_task("slam")), view(a_pod("driver", {"driver": cpu("500m", "1")}, namespace="lab-2"))
    pods = [view(a_pod("slam", {"slam": cpu("10m", "2")})), driver]
    others = [replace(weighted(a_task("driver")), namespace="lab-2", mode=mode)] if mode else []
    made = targets([policy, *others], pods, TWO_CORES)
    assert weights(made["lab/robot"])["slam"] == 1500


def test_sidecars_and_guaranteed_pods_keep_their_requests():
    sidecars = {"proxy": cpu("100m", "200m")}
    pods = [
        view(a_pod("slam", {"slam": cpu("10m", "2")}, sidecars=sidecars)),
        view(a_pod("map", {"map": cpu("300m", "300m", ("64Mi", "64Mi"))}, qos="Guaranteed")),
    ]
    made = targets([weighted(a_task("slam"), a_task("map"))], pods, TWO_CORES)
    assert weights(made["lab/robot"]) == {"slam": 1000, "map": 0}, "its share is what it divides with map"
    made = targets([weighted(a_task("slam"))], pods, TWO_CORES)
    assert weights(made["lab/robot"]) == {"slam": 1600}


def test_what_no_kubelet_has_admitted_leaves_weights_as_they_are():
    """Who may make pods can name the node in them, and resize them to any request."""
    refused = a_pod("refused", {"refused": cpu("64", "64")}, namespace="elsewhere")
    deferred = granted("10m", a_pod("deferred", {"deferred": cpu("64", "64")}, namespace="elsewhere"))
    pods = [view(refused | {"status": {"phase": "Pending"}}), view(deferred), view(a_pod("slam"))]
    made = targets([weighted(a_task("slam"))], pods, TWO_CORES)
    assert weights(made["lab/robot"])["slam"] == 1990


def test_a_namespace_never_weighs_less_than_it_requests():
    made = targets([weighted(a_task("slam"))], [view(a_pod("slam"))], TWO_CORES, weighing={NODE: 3000})
    assert weights(made["lab/robot"]) == {"slam": 100}


def test_a_greater_priority_leaves_what_the_others_request():
    tenants = Tenants({"lab": Tenant(1)})
    robot, other = weighted(a_task("slam")), replace(weighted(a_task("arm")), namespace="elsewhere")
    arm = view(a_pod("arm", {"arm": cpu("400m", "1")}, namespace="elsewhere"))
    made = targets([other, replace(robot, reserve=500)], [view(a_pod("slam")), arm], TWO_CORES, tenants=tenants)
    assert weights(made["lab/robot"]) == {"slam": 1500}
    assert weights(made["elsewhere/robot"]) == {"arm": 500}


def test_the_policies_of_a_namespace_weigh_its_part_together():
    first, second = weighted(a_task("slam")), replace(weighted(a_task("speech")), name="second")
    pods = [view(a_pod(name)) for name in ("slam", "speech")]
    made = targets([replace(first, reserve=500), second], pods, TWO_CORES, weighing={NODE: 1000})
    assert (weights(made["lab/robot"]), weights(made["lab/second"])) == ({"slam": 750}, {"speech": 250})


TASKS = st.lists(
    st.tuples(st.integers(1, 60).map(lambda tens: tens * 10), st.booleans(), st.integers(1, 100)),
    min_size=1,
    max_size=4,
)
"""What a task's pod requests, whether it is protected, and its priority."""


@given(
    st.dictionaries(st.sampled_from(["lab", "one", "two"]), TASKS, min_size=1),
    st.integers(0, 1500),
    st.integers(0, 2000),
)
def test_weights_of_a_namespace_stay_within_its_part(homes, unmanaged, idle):
    """For all requests, protected tasks and priorities, where what is requested fits into the node."""
    stakes = {home: sum(request for request, *_ in tasks) for home, tasks in homes.items()}
    total = unmanaged + sum(stakes.values()) + idle
    pods = [
        view(a_pod(f"t{n}", {f"t{n}": cpu(f"{request}m", "64")}, namespace=home, uid=f"{home}{n}"))
        for home, tasks in homes.items()
        for n, (request, *_) in enumerate(tasks)
    ]
    policies = [
        replace(
            weighted(*(a_task(f"t{n}", protected=own, priority=more) for n, (_, own, more) in enumerate(tasks))),
            namespace=home,
        )
        for home, tasks in homes.items()
    ]
    made = targets(policies, pods, {NODE: total}, weighing={NODE: unmanaged})
    found = {home: sum(weights(made[f"{home}/robot"]).values()) for home in homes}
    others = {"": Stake(unmanaged, unmanaged)}
    own = parts(total, others | {home: Stake(asked, 64_000) for home, asked in stakes.items()})
    assert all(found[home] <= own[home] + len(homes) for home in homes)
    assert all(found[home] >= stakes[home] - 10 * len(homes[home]) for home in homes), "steps of 10m may be left over"
    assert sum(found.values()) + unmanaged <= total
