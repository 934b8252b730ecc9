"""What a pod's owner says that it was made of."""

from __future__ import annotations

from typing import Any

import pytest

from contextpolicy.cluster.pod_parsing import view
from contextpolicy.cluster.pod_templates import PATHS, Templates
from contextpolicy.cluster.pods import Cpu
from contextpolicy.errors import ActuationError
from tests.cluster.builders import a_pod, cpu


class Api:
    """Has one object."""

    def __init__(self, path: str, content: dict[str, Any]) -> None:
        self._path, self._content = path, content

    def read(self, path: str) -> dict[str, Any]:
        if path != self._path:
            raise ActuationError("NotFound", f"{path} (HTTP 404)", retriable=False)
        return self._content


def owned(kind: str = "ReplicaSet", version: str = "apps/v1", **labels: str) -> dict[str, Any]:
    other = {"apiVersion": "v1", "kind": "Node", "name": "x", "uid": "y"}
    owner = {"apiVersion": version, "kind": kind, "name": "slam", "uid": "uid-owner", "controller": True}
    dashed = {name.replace("_", "-"): value for name, value in labels.items()}
    return a_pod(ownerReferences=[other, owner], labels={"app": "slam", **dashed})


def owner(resources: dict[str, Any], *, annotations: dict[str, str] | None = None, **status: str) -> dict[str, Any]:
    spec = {"containers": [{"name": "slam", "resources": resources}], "initContainers": [{"name": "side"}]}
    metadata = {"uid": "uid-owner", "annotations": annotations or {}}
    return {"metadata": metadata, "spec": {"template": {"spec": spec}}, "status": status}


@pytest.mark.parametrize(("version", "kind"), PATHS)
def test_template_is_read_from_each_built_in_controller(version, kind):
    path = PATHS[version, kind].format("lab", "slam")
    assert path.startswith("/apis/" + version)
    found = Templates(Api(path, owner(cpu("100m", "500m")))).cpu(view(owned(kind, version)))
    assert found == {"slam": Cpu(100, 500), "side": Cpu(None, None)}


def test_owner_in_another_namespace_is_not_read():
    pod = owned()
    pod["metadata"]["ownerReferences"][1]["name"] = "../../else/replicasets/slam"
    path = PATHS["apps/v1", "ReplicaSet"].format("lab", "../../else/replicasets/slam")
    assert Templates(Api(path, owner(cpu("100m", "500m")))).cpu(view(pod)) == {}


def test_limit_without_a_request_is_also_the_request():
    api = Api(PATHS["apps/v1", "ReplicaSet"].format("lab", "slam"), owner({"limits": {"cpu": "1"}}))
    assert Templates(api).cpu(view(owned()))["slam"] == Cpu(1000, 1000)


GENERATION = {"deprecated.daemonset.template.generation": "3"}
SETS = [
    ("StatefulSet", {"controller_revision_hash": "slam-2"}, owner(cpu("1", "1"), updateRevision="slam-2"), True),
    ("StatefulSet", {"controller_revision_hash": "slam-1"}, owner(cpu("1", "1"), updateRevision="slam-2"), False),
    ("DaemonSet", {"pod_template_generation": "3"}, owner(cpu("1", "1"), annotations=GENERATION), True),
    ("DaemonSet", {"pod_template_generation": "2"}, owner(cpu("1", "1"), annotations=GENERATION), False),
]


@pytest.mark.parametrize(("kind", "labels", "made", "known"), SETS)
def test_changed_template_is_unknown(kind, labels, made, known):
    api = Api(PATHS["apps/v1", kind].format("lab", "slam"), made)
    assert bool(Templates(api).cpu(view(owned(kind, **labels)))) is known


@pytest.mark.parametrize("resources", [{"limits": {"cpu": "lots"}}, 5, {"limits": 7}])
def test_invalid_template_resources_are_unknown(resources):
    api = Api(PATHS["apps/v1", "ReplicaSet"].format("lab", "slam"), owner(resources))
    assert Templates(api).cpu(view(owned())) == {}
