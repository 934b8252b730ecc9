import json
import tomllib

import pytest

from tests.node import __main__ as command_line
from tests.node import certificates, cgroups, components, configuration, layout
from tests.node.errors import ClusterError


def flags(component: components.Component) -> dict[str, str]:
    return dict(word.removeprefix("--").split("=", 1) for word in component.argv if "=" in word)


def test_the_kubelet_starts_after_its_dependencies():
    order = components.names()
    assert order.index("kine") < order.index("apiserver") < order.index("kubelet")
    assert order.index("containerd") < order.index("kubelet")


@pytest.mark.parametrize("component", [*components.all_components(), components.etcd()], ids=lambda one: one.name)
def test_every_file_that_a_component_names_is_below_the_root(component):
    paths = [value for value in flags(component).values() if value.startswith("/")]
    assert all(path.startswith(f"{layout.ROOT}/") for path in paths)


@pytest.mark.parametrize(("chosen", "served"), [("", "kine"), ("kine", "kine"), ("etcd", "etcd")])
def test_the_api_server_uses_the_datastore_that_the_environment_chose(monkeypatch, chosen, served):
    monkeypatch.setenv(layout.DATASTORE_VARIABLE, chosen)
    _, endpoint = components.DATASTORES[served]
    assert components.names()[0] == served
    assert flags(components.apiserver())["etcd-servers"] == endpoint
    first = components.all_components()[0]
    assert endpoint in (flags(first).get("listen-address"), flags(first).get("listen-client-urls"))


def test_an_unknown_datastore_is_refused_with_the_known_ones(monkeypatch, caplog):
    monkeypatch.setenv(layout.DATASTORE_VARIABLE, "mysql")
    monkeypatch.setattr("sys.argv", ["tests.node", "status"])
    assert command_line.main() == 1
    assert "CONTEXTPOLICY_NODE_DATASTORE=mysql: it is one of kine, etcd" in caplog.text


def test_calls_of_pods_are_audited_and_the_nodes_own_are_not():
    policy = json.loads(configuration.audit_policy())
    levels = [(rule.get("userGroups"), rule["level"]) for rule in policy["rules"]]
    assert levels[-2:] == [(["system:serviceaccounts"], "Metadata"), (None, "None")]
    assert flags(components.apiserver())["audit-log-path"] == str(layout.AUDIT_LOG)


def test_client_certificates_carry_user_and_group():
    command = certificates.issue(certificates.KUBELET)
    assert f"/O=system:nodes/CN=system:node:{layout.NODE_NAME}" in command
    assert "extendedKeyUsage=clientAuth" in command


def test_shim_sockets_fit_into_the_limit_of_containerd():
    config = tomllib.loads(configuration.containerd())
    assert len(config["plugins"]["io.containerd.shim.v1.manager"]["socket_dir"]) <= 42


def test_kubelet_accepts_cgroup_v1_and_reads_static_pods():
    config = json.loads(configuration.kubelet())
    assert (config["failCgroupV1"], config["cgroupDriver"]) == (False, "cgroupfs")
    assert config["staticPodPath"] == str(layout.MANIFESTS)


def test_kubeconfig_points_to_the_api_server_with_the_identity():
    config = json.loads(configuration.kubeconfig(certificates.ADMIN))
    assert config["clusters"][0]["cluster"]["server"] == layout.API_URL
    assert config["users"][0]["user"]["client-key"].endswith("/admin.key")


def test_pods_get_addresses_from_the_range_of_the_proxy():
    bridge = json.loads(configuration.cni())["plugins"][0]
    assert bridge["ipam"]["ranges"] == [[{"subnet": flags(components.proxy())["cluster-cidr"]}]]


def test_kubelet_and_containerd_use_the_same_cgroup_driver(monkeypatch):
    def agreed():
        toml = tomllib.loads(configuration.containerd())["plugins"]["io.containerd.cri.v1.runtime"]
        options = toml["containerd"]["runtimes"]["runc"]["options"]
        return json.loads(configuration.kubelet())["cgroupDriver"], options["SystemdCgroup"]

    assert agreed() == ("cgroupfs", False)
    monkeypatch.setenv(layout.CGROUP_DRIVER_VARIABLE, "systemd")
    assert agreed() == ("systemd", True)


def test_components_stay_in_the_systemd_service(monkeypatch):
    monkeypatch.setenv(layout.CGROUP_DRIVER_VARIABLE, "systemd")
    assert cgroups.components_folder() == cgroups.MOUNT / "system.slice" / "contextpolicy-node.service"


def test_an_unknown_cgroup_driver_is_refused_with_the_known_ones(monkeypatch):
    monkeypatch.setenv(layout.CGROUP_DRIVER_VARIABLE, "v2")
    with pytest.raises(ClusterError, match="DRIVER=v2: it is one of cgroupfs, systemd"):
        configuration.kubelet()
