"""What the machine gets: units that start what exists, an environment that makes the node one of systemd's."""

import json
import os
import re
import subprocess
import sys

import pytest

from tests.node.build import DEBIAN_PACKAGES
from tests.node.layout import CGROUP_DRIVER_VARIABLE, REPOSITORY
from tests.vm import chart, guest, payload, system

UNITS = sorted(payload.UNITS.glob("*.service"))


def test_pods_of_one_node_reach_each_other_through_a_service(tmp_path):
    """The machine's kernel has as modules what others have built in."""
    for folder in ("systemd/system", "modules-load.d"):
        (tmp_path / "etc" / folder).mkdir(parents=True)
    (tmp_path / "var" / "log").mkdir(parents=True)
    payload._settings(tmp_path, [])
    assert "br_netfilter" in (tmp_path / "etc" / "modules-load.d" / "node.conf").read_text().split()


def test_the_machine_receives_the_tests_to_run():
    assert payload.environment(["test_running.py::test_one", "test_rebooted.py"])["CONTEXTPOLICY_VM_TESTS"] == (
        "test_running.py::test_one test_rebooted.py"
    )


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.stem)
def test_modules_and_units_named_by_units_exist(unit):
    text = unit.read_text()
    for module in re.findall(r"python3 -m (\S+)", text):
        assert (REPOSITORY / f"{module.replace('.', '/')}.py").is_file()
    named = set(re.findall(r"contextpolicy-[a-z-]+\.service", text))
    assert named <= {other.name for other in UNITS}


def test_the_node_survives_its_starter():
    text = next(unit for unit in UNITS if unit.stem == "contextpolicy-node").read_text()
    assert "KillMode=process" in text
    assert "Delegate=yes" in text


def test_the_system_has_the_packages_the_node_needs():
    """Except for the packages that only builds need."""
    builds = {"buildah", "gcc", "libc6-dev", "libseccomp-dev", "mmdebstrap", "pkg-config"}
    assert set(DEBIAN_PACKAGES) - builds <= set(system.PACKAGES)


def test_the_rendered_chart_has_its_namespaces_first(tmp_path):
    helm = tmp_path / "helm"
    helm.write_text("#!/bin/sh\nprintf 'kind: Service\\n---\\n---\\nkind: DaemonSet\\n'\n")
    helm.chmod(0o755)
    kinds = [one["kind"] for one in json.loads(chart.rendered(str(helm)))]
    assert kinds == ["Namespace", "Namespace", "Service", "DaemonSet"]


def test_the_tests_inside_need_no_more_than_the_machine_has():
    """That is the operator's packages and pytest."""
    collect = "import sys, pytest; sys.modules['hypothesis'] = None; sys.exit(pytest.main(sys.argv[1:]))"
    argv = [
        sys.executable,
        "-c",
        collect,
        "--collect-only",
        "-q",
        *guest.OWN_CONFTEST,
        *map(str, guest.TESTS.glob("test_*.py")),
    ]
    environment = {**os.environ, CGROUP_DRIVER_VARIABLE: "systemd", "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    environment.pop("PYTEST_ADDOPTS", None)  # may name plug-ins that the machine lacks
    done = subprocess.run(
        argv, cwd=REPOSITORY, env=environment, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
