"""The sample configuration can be read by the programs that it is for."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml

from tests.node import components, configuration, layout

ROOT = Path(__file__).parents[2]
GITOPS = sorted(path for path in (ROOT / "config" / "gitops").rglob("*.yaml") if path.name != "kustomization.yaml")


@pytest.mark.parametrize("path", GITOPS, ids=lambda path: path.name)
def test_every_gitops_document_is_an_object(path):
    documents = list(yaml.safe_load_all(path.read_text(encoding="utf-8")))
    assert documents
    assert all({"apiVersion", "kind", "metadata"} <= document.keys() for document in documents)


def test_gitops_points_at_the_chart_and_a_sample():
    text = "".join(path.read_text(encoding="utf-8") for path in GITOPS)
    assert text.count("charts/contextpolicy\n") == 2
    assert (ROOT / "charts" / "contextpolicy").is_dir()
    assert (ROOT / "config" / "policies" / "delivery-robot.yaml").exists()


def test_the_kubelet_restarts_a_crashed_operator_soon():
    config = yaml.safe_load((ROOT / "config" / "k3s" / "kubelet.conf").read_text(encoding="utf-8"))
    tested = json.loads(configuration.kubelet())
    assert {name: config[name] for name in ("apiVersion", "kind")} == {n: tested[n] for n in ("apiVersion", "kind")}
    assert config["crashLoopBackOff"] == {"maxContainerRestartPeriod": "2s"}
    assert "crashLoopBackOff" not in tested, "the node of the tests takes it from this very file"


def test_node_with_the_systemd_driver_has_k3s_arguments(monkeypatch):
    assert not any("reserved" in word for word in components.kubelet().argv)
    monkeypatch.setenv(layout.CGROUP_DRIVER_VARIABLE, "systemd")
    assert "--system-reserved=cpu=200m,memory=512Mi" in components.kubelet().argv


def test_k3s_configuration_allows_resizes():
    config = yaml.safe_load((ROOT / "config" / "k3s" / "config.yaml").read_text(encoding="utf-8"))
    assert [argument.partition("=")[0] for argument in config["kubelet-arg"]] == ["system-reserved"]


@pytest.mark.parametrize("script", ["config/k3s/try.sh", "tests/heavy/helm_job/entry.sh", ".ci/run"])
def test_shell_scripts_pass_shellcheck(script):
    """The checker comes with the development packages, next to this Python."""
    shellcheck = Path(sys.executable).parent / "shellcheck"
    found = subprocess.run([shellcheck, ROOT / script], capture_output=True, text=True, check=False)
    assert found.stdout == ""


def test_the_try_script_installs_what_the_tests_run_on():
    text = (ROOT / "config" / "k3s" / "try.sh").read_text(encoding="utf-8")
    minor, helm = layout.KUBERNETES_VERSION.rpartition(".")[0], layout.HELM_VERSION.partition(".")[0]
    assert f"INSTALL_K3S_CHANNEL={minor} " in text
    assert f"/get-helm-{helm.removeprefix('v')} " in text
    python = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["requires-python"]
    assert f"sys.version_info < ({python.removeprefix('>=').replace('.', ', ')})" in text


def test_k3s_helmchart_uses_a_local_chart_and_known_values():
    manifest = yaml.safe_load((ROOT / "config" / "k3s" / "helmchart.yaml").read_text(encoding="utf-8"))
    known = yaml.safe_load((ROOT / "charts" / "contextpolicy" / "values.yaml").read_text(encoding="utf-8"))
    assert manifest["spec"]["chart"].startswith("https://%{KUBERNETES_API}%/static/charts/")
    values = yaml.safe_load(manifest["spec"]["valuesContent"])
    assert all(name in known and set(below) <= set(known[name]) for name, below in values.items())


def test_files_used_by_the_try_script_exist():
    """It can run nowhere but on a robot; the files that it copies and the targets that it makes are ours."""
    script = ROOT / "config" / "k3s" / "try.sh"
    text = script.read_text(encoding="utf-8")
    assert script.stat().st_mode & 0o111
    assert all((ROOT / file).is_file() for file in re.findall(r"config/k3s/\S+\.(?:yaml|conf)", text))
    for file in ("config.yaml", "kubelet.conf"):
        [target] = re.findall(rf"config/k3s/{re.escape(file)} (\S+)", text)
        assert f"copy to {target} " in (ROOT / "config" / "k3s" / file).read_text(encoding="utf-8")
    targets = set(re.findall(r"^make (\w+)", text, re.MULTILINE))
    assert targets == {"demo"}
    assert all(f"\n{target}:" in (ROOT / "Makefile").read_text(encoding="utf-8") for target in targets)
