"""What the chart's pods and accounts may do: exactly this, so that every further right is a decision."""

from __future__ import annotations

from collections import defaultdict

import pytest

from contextpolicy.commands.doctor import RIGHTS
from tests.charts.objects import EVERYTHING, container

ORIGINALS = "contextpolicy-originals"
NODES = {("", "nodes"): {"list", "watch"}, ("contextpolicy.dev", "contextpolicies/originals"): {"update"}}
OWNERS = {
    **{("apps", kind): {"get"} for kind in ("replicasets", "statefulsets", "daemonsets")},
    ("batch", "jobs"): {"get"},
}
IN_A_NAMESPACE = {
    ("contextpolicy.dev", "contextpolicies"): {"list", "watch", "patch"},
    ("contextpolicy.dev", "contextpolicies/status"): {"patch"},
    ("", "pods"): {"get", "list", "watch"},
    ("", "pods/resize"): {"patch"},
    ("", "events"): {"create"},
    ("coordination.k8s.io", "leases"): {"get", "update", "create"},
    **OWNERS,
}
RESTORE = {
    ("contextpolicy.dev", "contextpolicies"): {"list", "patch"},
    ("contextpolicy.dev", "contextpolicies/status"): {"patch"},
    ("contextpolicy.dev", "contextpolicies/originals"): {"update"},
    ("", "pods"): {"list"},
    ("", "pods/resize"): {"patch"},
    ("coordination.k8s.io", "leases"): {"get", "update"},
    **OWNERS,
}


def rights(role):
    """The verbs of a role by API group and resource."""
    found: defaultdict[tuple[str, str], set[str]] = defaultdict(set)
    for rule in role["rules"]:
        for group in rule["apiGroups"]:
            for resource in rule["resources"]:
                found[group, resource] |= set(rule["verbs"])
    return found


def test_operator_has_cluster_wide_rights_by_default(render):
    rendered = render()
    assert rights(rendered["ClusterRole", "contextpolicy"]) == NODES | IN_A_NAMESPACE
    assert {name for kind, name in rendered if kind == "Role"} == {
        *("contextpolicy-certificates", "contextpolicy-lease", "contextpolicy-live"),
        *("contextpolicy-originals", "contextpolicy-restore-key"),
    }
    assert rights(rendered["Role", "contextpolicy-live"]) == {
        ("", "pods"): {"get", "list"},
        ("", "pods/portforward"): {"create"},
    }
    assert rights(rendered["ClusterRole", "contextpolicy-restore"]) == RESTORE


def test_operator_rights_are_limited_to_watched_namespaces(render):
    rendered = render("watchNamespaces={robot}")
    assert rights(rendered["ClusterRole", "contextpolicy"]) == NODES
    role, binding = rendered["Role", "contextpolicy"], rendered["RoleBinding", "contextpolicy"]
    assert rights(role) == IN_A_NAMESPACE
    assert role["metadata"]["namespace"] == binding["metadata"]["namespace"] == "robot"
    assert binding["subjects"] == [
        {"kind": "ServiceAccount", "name": "contextpolicy", "namespace": "contextpolicy-system"}
    ]


def test_restore_rights_do_not_depend_on_watched_namespaces(render):
    """Helm makes its rights after the operator is gone: where that fails, nobody restores anything."""
    rendered = render("watchNamespaces={robot,gone}")
    assert rights(rendered["ClusterRole", "contextpolicy-restore"]) == RESTORE
    assert rendered["ClusterRoleBinding", "contextpolicy-restore"]["subjects"] == [
        {"kind": "ServiceAccount", "name": "contextpolicy-restore", "namespace": "contextpolicy-system"}
    ]


@pytest.mark.parametrize("settings", [(), ("watchNamespaces={robot}",)])
def test_it_may_read_the_message_definitions_that_are_named_and_nothing_else(render, settings):
    rendered = render("rosTypes={robot-types,vision}", *settings)
    role = rendered["Role" if settings else "ClusterRole", "contextpolicy"]
    [rule] = [rule for rule in role["rules"] if "configmaps" in rule["resources"]]
    assert rule == {
        "apiGroups": [""],
        "resources": ["configmaps"],
        "resourceNames": ["robot-types", "vision"],
        "verbs": ["get"],
    }


@pytest.mark.parametrize("settings", [(), ("watchNamespaces={robot}",)])
def test_it_may_change_only_its_own_leases(render, settings):
    """A Lease of its namespaces' other tenants, or of the control plane, is none of its business."""
    rendered = render(*settings)
    own = rendered["Role", "contextpolicy-lease"]
    served = rendered["Role" if settings else "ClusterRole", "contextpolicy"]
    assert own["metadata"]["namespace"] == "contextpolicy-system"
    assert rights(own) == {("coordination.k8s.io", "leases"): {"get", "list", "watch", "update", "create", "delete"}}
    rules = [rule for role in (own, served) for rule in role["rules"] if rule["resources"] == ["leases"]]
    assert all(rule.get("resourceNames") == ["contextpolicy"] or rule["verbs"] == ["create"] for rule in rules)


def test_it_may_read_only_its_originals_key(render):
    """It makes the key itself; only the Job that ends the release may delete it."""
    rendered = render()
    for account, verb in (("contextpolicy-originals", "patch"), ("contextpolicy-restore-key", "delete")):
        [rule] = rendered["Role", account]["rules"]
        assert rule == {
            "apiGroups": [""],
            "resources": ["secrets"],
            "resourceNames": ["contextpolicy-originals"],
            "verbs": ["get", verb],
        }
        assert rendered["Role", account]["metadata"]["namespace"] == "contextpolicy-system"
    secret = rendered["Secret", "contextpolicy-originals"]
    assert not secret.keys() & {"data", "stringData"}, "a template would make another key at each sync"
    assert secret["metadata"]["annotations"]["helm.sh/resource-policy"] == "keep"


@pytest.mark.parametrize("namespaces", [[], ["robot", "lab"]])
def test_changing_originals_requires_a_cluster_wide_right(render, namespaces):
    rendered = render(*([f"watchNamespaces={{{','.join(namespaces)}}}"] if namespaces else []))
    spec = rendered["ValidatingAdmissionPolicy", "contextpolicy-originals"]["spec"]
    [rule] = spec["matchConstraints"]["resourceRules"]
    assert (rule["resources"], rule["operations"]) == (["contextpolicies/status"], ["UPDATE"])
    selector = spec["matchConstraints"].get("namespaceSelector")
    assert (selector["matchExpressions"][0]["values"] if selector else []) == namespaces
    assert ".namespace(" not in spec["validations"][0]["expression"], "a Role of a namespace must not be enough"
    binding = rendered["ValidatingAdmissionPolicyBinding", "contextpolicy-originals"]["spec"]
    assert binding == {"policyName": "contextpolicy-originals", "validationActions": ["Deny"]}


@pytest.mark.parametrize("aggregated", [False, True])
def test_namespace_editors_write_policies_only_if_the_administrator_allows_it(render, aggregated):
    rendered = render(*(["rbac.aggregateToUserRoles=true"] if aggregated else []))
    for name in ("viewer", "editor"):
        labels = rendered["ClusterRole", f"contextpolicy-{name}"]["metadata"]["labels"]
        assert any("aggregate-to" in label for label in labels) is aggregated


def test_the_doctor_asks_for_no_right_that_the_chart_does_not_give():
    asked = {(group, f"{kind}/{part}" if part else kind): set(verbs) for group, kind, part, verbs in RIGHTS}
    assert [resource for resource, verbs in asked.items() if not verbs <= IN_A_NAMESPACE[resource]] == []


def test_users_get_policies_and_nothing_else(render):
    rendered = render()
    for name in ("viewer", "editor"):
        allowed = rights(rendered["ClusterRole", f"contextpolicy-{name}"])
        assert allowed.keys() == {("contextpolicy.dev", "contextpolicies"), ("coordination.k8s.io", "leases")}
        assert set(allowed["coordination.k8s.io", "leases"]) == {"get"}, "to see whether an operator serves them"


def test_certificates_are_written_into_the_charts_secrets_and_no_other(render):
    """Who may create Secrets can have himself the token of any account of the namespace."""
    rendered = render("agent.enabled=true")
    [rule] = rendered["Role", "contextpolicy-certificates"]["rules"]
    secrets = {name for kind, name in rendered if kind == "Secret"} - {ORIGINALS}
    assert (set(rule["resourceNames"]), set(rule["verbs"])) == (secrets, {"get", "patch"})


def test_no_other_role_may_read_secrets(render):
    rendered = render("agent.enabled=true")
    roles = [item for (kind, _), item in rendered.items() if kind in ("Role", "ClusterRole")]
    readers = {item["metadata"]["name"]: item for item in roles if ("", "secrets") in rights(item)}
    assert readers.keys() == {"contextpolicy-certificates", ORIGINALS, "contextpolicy-restore-key"}
    for name in (ORIGINALS, "contextpolicy-restore-key"):
        assert [rule["resourceNames"] for rule in readers[name]["rules"]] == [[ORIGINALS]]


def test_no_rule_has_a_wildcard(render):
    roles = [item for (kind, _), item in render(*EVERYTHING).items() if kind in ("Role", "ClusterRole")]
    assert roles
    assert "*" not in {part for role in roles for rule in role["rules"] for field in rule.values() for part in field}


def test_rbac_can_be_disabled(render):
    kinds = {kind for kind, _ in render("rbac.create=false")}
    assert not kinds & {"Role", "RoleBinding", "ClusterRole", "ClusterRoleBinding"}


@pytest.mark.parametrize(
    "workload",
    [("Deployment", "contextpolicy"), ("Deployment", "contextpolicy-router"), ("Job", "contextpolicy-restore")],
)
def test_all_but_the_agent_pass_the_restricted_standard(render, workload):
    rendered = render()[workload]
    pod = rendered["spec"]["template"]["spec"]
    assert pod["securityContext"]["runAsNonRoot"] is True
    assert pod["securityContext"]["runAsUser"] > 0
    assert pod["securityContext"]["seccompProfile"] == {"type": "RuntimeDefault"}
    assert not pod.keys() & {"hostNetwork", "hostPID", "hostIPC"}
    assert [volume for volume in pod.get("volumes", ()) if volume.keys() != {"name", "secret"}] == []
    assert container(rendered)["securityContext"] == {
        "allowPrivilegeEscalation": False,
        "readOnlyRootFilesystem": True,
        "capabilities": {"drop": ["ALL"]},
    }


def test_only_components_that_use_the_api_get_a_token(render):
    rendered = render("agent.enabled=true")
    router, agent = rendered["Deployment", "contextpolicy-router"], rendered["DaemonSet", "contextpolicy-agent"]
    assert [one["spec"]["template"]["spec"]["automountServiceAccountToken"] for one in (router, agent)] == [
        False,
        False,
    ]
    bound = [
        s["name"] for (kind, _), item in rendered.items() if kind.endswith("RoleBinding") for s in item["subjects"]
    ]
    assert sorted(set(bound)) == [
        *("contextpolicy", "contextpolicy-certificates", "contextpolicy-doctor", "contextpolicy-restore")
    ]


@pytest.mark.parametrize(
    ("realtime", "capabilities"), [(False, {"drop": ["ALL"]}), (True, {"drop": ["ALL"], "add": ["SYS_NICE"]})]
)
def test_the_agent_has_what_writing_cgroups_needs(render, realtime, capabilities):
    agent = render("agent.enabled=true", f"agent.realtime={str(realtime).lower()}")["DaemonSet", "contextpolicy-agent"]
    pod = agent["spec"]["template"]["spec"]
    assert pod["hostPID"] is realtime
    assert not pod.keys() & {"hostNetwork", "hostIPC"}
    assert [volume["hostPath"] for volume in pod["volumes"] if "hostPath" in volume] == [
        {"path": "/sys/fs/cgroup", "type": "Directory"},
        {"path": "/run/contextpolicy", "type": "DirectoryOrCreate"},
        {"path": "/var/log/pods", "type": "Directory"},
    ]
    writable = {mount["name"] for mount in container(agent)["volumeMounts"] if not mount.get("readOnly")}
    assert writable == {"cgroup", "state"}
    security = container(agent)["securityContext"]
    assert security["capabilities"] == capabilities
    assert security["allowPrivilegeEscalation"] is False
    assert "privileged" not in security


def test_every_container_has_a_weight_and_none_is_throttled(render):
    workloads = [item for (kind, _), item in render(*EVERYTHING).items() if kind in ("Deployment", "DaemonSet", "Job")]
    assert len(workloads) == 5
    for workload in workloads:
        resources = container(workload)["resources"]
        assert resources["requests"].keys() == {"cpu", "memory"}
        assert resources["limits"].keys() == {"memory"}


@pytest.mark.parametrize("realtime", ["false", "true"])
def test_the_supervisor_has_the_agents_rights_but_no_key(render, realtime):
    agent = render("agent.enabled=true", f"agent.realtime={realtime}")["DaemonSet", "contextpolicy-agent"]
    (supervisor,) = agent["spec"]["template"]["spec"]["initContainers"]
    assert supervisor["restartPolicy"] == "Always"
    assert supervisor["image"] == container(agent)["image"]
    assert supervisor["securityContext"] == container(agent)["securityContext"]
    assert supervisor["resources"]["limits"].keys() == {"memory"}
    wanted = [mount for mount in container(agent)["volumeMounts"] if mount["name"] in ("cgroup", "state", "bus")]
    assert len(wanted) == 3
    assert supervisor["volumeMounts"] == wanted
    assert [variable for variable in supervisor["env"] if variable not in container(agent)["env"]] == []
    assert {variable["name"] for variable in supervisor["env"]} == {
        "CGROUP_ROOT",
        "LOG_FORMAT",
        "LOG_LEVEL",
        "NODE_NAME",
        "ZENOH_CONNECT",
        "ZENOH_CREDENTIALS",
    }
