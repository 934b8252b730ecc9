"""Two versions of the chart, one after the other and back, while a policy is in force."""

import shutil
import subprocess

import pytest
import yaml

from tests.e2e.cluster import CHART, apply_definition, delete, get, run, until
from tests.e2e.releases import Release

DEFINITION = "contextpolicies.contextpolicy.dev"


@pytest.fixture(scope="module")
def older(tmp_path_factory):
    """The chart as an older version would be: its definition has neither the last printed column yet nor a field."""
    folder = tmp_path_factory.mktemp("older") / "contextpolicy"
    shutil.copytree(CHART, folder)
    chart = yaml.safe_load((folder / "Chart.yaml").read_text())
    (folder / "Chart.yaml").write_text(yaml.safe_dump({**chart, "version": "0.0.1"}))
    file = folder / "files" / f"{DEFINITION}.yaml"
    definition = yaml.safe_load(file.read_text())
    version = definition["spec"]["versions"][0]
    version["additionalPrinterColumns"].pop()
    spec = version["schema"]["openAPIV3Schema"]["properties"]["spec"]
    del spec["properties"]["enforcement"]["properties"]["minDwell"]
    file.write_text(yaml.safe_dump(definition))
    return folder


@pytest.fixture(scope="module")
def upgraded(older):
    """A release of the older version whose policy is in force."""
    release = Release("upgrade", 52)
    release.install(older, **{"crds.enabled": "true"})
    try:
        with release.robot() as robot:
            yield release, robot
    finally:
        release.remove()
        apply_definition()


def columns():
    template = "{.spec.versions[0].additionalPrinterColumns[*].name}"
    return len(run("kubectl", "get", "crd", DEFINITION, "-o", f"jsonpath={template}").split())


def enforcement(release):
    return get("ctxp", "robot", release.namespace)["spec"]["enforcement"]


def limits_during(robot, command):
    """Every set of limits that the kernel enforced while a command ran."""
    seen = []
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        assert process.stdout is not None
        while process.poll() is None:
            now = robot.limits("slam", "speech")
            seen += [now] if now not in seen else []
        assert process.returncode == 0, process.stdout.read()
    return seen


def test_upgrade_and_rollback_keep_policies_in_force(upgraded):
    release, robot = upgraded
    before = columns()
    moving = {"slam": 990, "speech": 10}
    upgrade = release.upgrade_command(CHART, **{"crds.enabled": "true"})
    assert limits_during(robot, upgrade) == [moving]
    assert columns() == before + 1
    robot.policy(enforcement={"minDwell": "100ms"})
    assert enforcement(release)["minDwell"] == "100ms"
    robot.drive(0.0)
    robot.expect(slam=500, speech=500)

    robot.drive(0.3)
    robot.expect(**moving)
    back = ("helm", "rollback", release.name, "1", "--namespace", release.system, "--wait", "--timeout", "120s")
    assert limits_during(robot, back) == [moving]
    assert columns() == before
    until("the older definition knows no such field", lambda: "minDwell" not in enforcement(release))
    robot.drive(0.0)
    robot.expect(slam=500, speech=500)


def test_deleted_policy_restores_containers_after_an_upgrade(upgraded):
    """What they had before the first version is known to the last."""
    release, robot = upgraded
    robot.drive(0.3)
    robot.expect(slam=990, speech=10)
    delete("ctxp", "robot", release.namespace)
    robot.expect(slam=500, speech=500)
    until("the policy is gone", lambda: run("kubectl", "get", "ctxp", "-n", release.namespace, "-o", "name") or True)
