"""The robot's chart: every module as a pod that a policy can resize, with or without its hardware."""

from __future__ import annotations

import pytest
import yaml

from tests.charts.conftest import CHART, set_all

ROBOT = CHART.parent / "robot"
MODULES = sorted(path.parent.name for path in (CHART.parents[1] / "modules").glob("*/module.yaml"))
DEVICES = ("arm", "lidar", "navigation")


@pytest.fixture(scope="module")
def robot(helm):
    """The pods' specs by module."""

    def pods(*settings):
        done = helm("template", "robot", str(ROBOT), "--namespace", "robot", *set_all(settings))
        assert done.returncode == 0, done.stderr
        deployments = [document for document in yaml.safe_load_all(done.stdout) if document]
        return {one["metadata"]["name"]: one["spec"]["template"] for one in deployments}

    return pods


@pytest.fixture(scope="module")
def whole(robot):
    return robot(*(f"modules.{name}.enabled=true" for name in MODULES))


def test_every_module_is_rendered(whole):
    assert sorted(whole) == MODULES


def test_it_lints(helm):
    done = helm("lint", "--strict", str(ROBOT))
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize("name", MODULES)
def test_a_policy_can_resize_its_cpu_and_nothing_else_changes(name, whole):
    template = whole[name]
    assert template["metadata"]["labels"]["app"] == name
    (container,) = template["spec"]["containers"]
    assert container["name"] == name
    assert container["image"].startswith(f"contextpolicy-{name}:")
    assert {"resourceName": "cpu", "restartPolicy": "NotRequired"} in container["resizePolicy"]
    requests, limits = container["resources"]["requests"], container["resources"]["limits"]
    assert (requests["cpu"], limits["cpu"]) == ("10m", "1")
    assert requests["memory"] != limits["memory"]  # equal ones make the pod Guaranteed once CPU agrees


def test_a_module_may_run_twice_with_keys_of_its_own(robot):
    left = {"module": "signs", "enabled": "true", "memory.request": "64Mi", "memory.limit": "512Mi"}
    left |= {"env.INPUT_PICTURE": "robot/camera/left", "device.simulated": "true", "device.path": "/dev/null"}
    template = robot(*(f"modules.signs-left.{name}={value}" for name, value in left.items()))["signs-left"]
    (container,) = template["spec"]["containers"]
    environment = {one["name"]: one["value"] for one in container["env"]}
    assert (container["name"], template["metadata"]["labels"]["app"]) == ("signs-left", "signs-left")
    assert container["image"].startswith("contextpolicy-signs:")
    assert (environment["POLICY_TASK"], environment["INPUT_PICTURE"]) == ("signs-left", "robot/camera/left")
    assert "modules.signs.simulator" in template["spec"]["initContainers"][0]["command"]


def test_cpu_before_any_policy_can_be_chosen(robot):
    pods = robot("modules.slam.cpu.request=300m", "modules.slam.cpu.limit=300m", "modules.speech.cpu.limit=")
    slam, speech = (pods[name]["spec"]["containers"][0]["resources"] for name in ("slam", "speech"))
    assert (slam["requests"]["cpu"], slam["limits"]["cpu"]) == ("300m", "300m")
    assert (speech["requests"]["cpu"], "cpu" in speech["limits"]) == ("10m", False)


@pytest.mark.parametrize("name", MODULES)
def test_without_hardware_it_passes_the_restricted_standard(name, whole):
    spec = whole[name]["spec"]
    assert spec["securityContext"]["runAsNonRoot"]
    for container in (*spec.get("initContainers", ()), *spec["containers"]):
        assert container["securityContext"]["allowPrivilegeEscalation"] is False
        assert container["securityContext"]["capabilities"] == {"drop": ["ALL"]}
    assert [volume for volume in spec.get("volumes", ()) if "hostPath" in volume] == []


def environment(container):
    return {entry["name"]: entry["value"] for entry in container.get("env", ())}


@pytest.mark.parametrize("name", DEVICES)
def test_a_module_with_hardware_runs_beside_its_simulator(name, whole):
    simulator, *guards = whole[name]["spec"]["initContainers"]
    assert simulator["command"][2] == f"modules.{name}.simulator"
    (module,) = whole[name]["spec"]["containers"]
    opened = "tcp://127.0.0.1:4100" if guards else "tcp://127.0.0.1:4000"
    assert environment(module)["SERIAL_PORT"] == opened


@pytest.mark.parametrize("name", DEVICES)
def test_only_the_container_that_opens_the_device_is_privileged(name, robot):
    spec = robot(f"modules.{name}.device.simulated=false")[name]["spec"]
    guards, (module,) = spec.get("initContainers", []), spec["containers"]
    opens = guards[0] if guards else module
    path = environment(opens)["ROBOT_PORT" if guards else "SERIAL_PORT"]
    assert path.startswith("/dev/tty")
    assert {"name": "device", "mountPath": path} in opens["volumeMounts"]
    assert [one["name"] for one in (*guards, module) if one["securityContext"].get("privileged")] == [opens["name"]]


@pytest.mark.parametrize("name", DEVICES)
def test_device_plugin_avoids_privileged_containers(name, robot):
    settings = ("simulated=false", "resource=robot.example.com/tty")
    spec = robot(*(f"modules.{name}.device.{setting}" for setting in settings))[name]["spec"]
    containers = (*spec.get("initContainers", ()), *spec["containers"])
    assert not [one for one in containers if one["securityContext"].get("privileged")]
    holders = [one["name"] for one in containers if one["resources"]["limits"].get("robot.example.com/tty") == 1]
    assert holders == ["guard" if name == "navigation" else name]


def test_credentials_and_shared_memory_reach_the_modules_only(robot):
    spec = robot("zenoh.secret=bus", "sharedMemory=/memory/robot")["navigation"]["spec"]
    sidecars, (module,) = spec["initContainers"], spec["containers"]
    assert environment(module).items() >= {"ZENOH_CREDENTIALS": "/etc/robot/bus", "SHARED_MEMORY": "true"}.items()
    assert {mount["name"]: mount["mountPath"] for mount in module["volumeMounts"]} == {
        "bus": "/etc/robot/bus",
        "shm": "/dev/shm",  # noqa: S108 - the mount that Zenoh uses
    }
    assert not [one for one in sidecars if "volumeMounts" in one]
    shared = next(volume for volume in spec["volumes"] if volume["name"] == "shm")
    assert shared["hostPath"] == {"path": "/memory/robot", "type": "Directory"}


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("modules.lidar.device.path=ttyUSB0", "modules/lidar/device/path"),
        ("modules.slam.memory.limit=much", "modules/slam/memory/limit"),
        ("modules.slam.enabld=true", "enabld"),
        ("zenoh.connect=robot.local:7447", "zenoh/connect"),
    ],
)
def test_it_refuses(setting, message, helm):
    done = helm("template", "robot", str(ROBOT), "--set", setting)
    assert done.returncode != 0
    assert message in done.stderr
