import pytest

from tests.node import __main__ as command_line
from tests.node import access, layout, lifecycle, network
from tests.node.errors import ClusterError


@pytest.fixture
def user_cluster(monkeypatch):
    monkeypatch.setenv("KUBECONFIG", "/home/user/config")


@pytest.mark.usefixtures("user_cluster")
def test_the_users_cluster_is_left_alone(caplog):
    caplog.set_level("INFO")
    lifecycle.up()
    lifecycle.down()
    assert caplog.messages == [
        "using the cluster of KUBECONFIG=/home/user/config",
        "leaving the cluster of KUBECONFIG=/home/user/config as it is",
    ]


@pytest.mark.usefixtures("user_cluster")
def test_commands_for_the_users_cluster_run_as_they_are():
    assert access.command(["kubectl", "get", "nodes"]) == ["kubectl", "get", "nodes"]
    assert access.environment()["KUBECONFIG"] == "/home/user/config"


@pytest.mark.usefixtures("user_cluster")
def test_components_of_the_users_cluster_are_not_stopped():
    with pytest.raises(ClusterError, match="cannot be stopped"):
        lifecycle.stop("kubelet")


def test_our_own_kubeconfig_is_not_a_users_cluster(monkeypatch):
    monkeypatch.setenv("KUBECONFIG", str(layout.KUBECONFIG))
    assert access.user_cluster() is None


def test_commands_for_our_node_enter_its_network(monkeypatch, tmp_path):
    monkeypatch.delenv("KUBECONFIG", raising=False)
    monkeypatch.setattr(access, "NETWORK_NAMESPACE", tmp_path)
    assert access.command(["true"]) == network.inside(["true"])
    assert access.environment()["PATH"].startswith(f"{layout.BIN}:")


def test_a_missing_node_is_reported(monkeypatch, tmp_path):
    monkeypatch.delenv("KUBECONFIG", raising=False)
    monkeypatch.setattr(access, "NETWORK_NAMESPACE", tmp_path / "net")
    with pytest.raises(ClusterError, match="up` first"):
        access.command(["true"])


def test_an_unknown_component_is_refused_with_the_known_ones(monkeypatch):
    monkeypatch.delenv("KUBECONFIG", raising=False)
    with pytest.raises(ClusterError, match=r"'dns'.*one of kine, apiserver"):
        lifecycle.component("dns")


def test_exec_passes_everything_after_the_dashes():
    arguments = command_line.parser().parse_args(["exec", "--", "kubectl", "-n", "robot", "get", "--", "pods"])
    assert arguments.argv[-6:] == ["kubectl", "-n", "robot", "get", "--", "pods"]
