"""An API server, a kubelet and a watch in memory; each acts when the test says so, and not before."""

from __future__ import annotations

from collections import deque
from copy import deepcopy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from contextpolicy.actuators.resize.originals import Original
from contextpolicy.actuators.resize.stored_originals import read
from contextpolicy.cluster.paging import Page
from contextpolicy.errors import ActuationError
from contextpolicy.policy.quantities import parse_cpu

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

LISTS = ("containers", "initContainers")


class Killed(BaseException):
    """The operator's process ends here."""


@dataclass(frozen=True)
class Unanswered:
    """The call has its effect; its answer is lost."""

    error: BaseException


def refusal(reason: str = "Invalid", *, retriable: bool = False) -> ActuationError:
    return ActuationError(reason, "no", retriable=retriable)


UNREACHABLE = ActuationError("Unreachable", "no", retriable=True, in_doubt=True)


class FakeCluster:
    """The API that the resizer talks to, with what the test does to it.

    `faults` are what the next calls end in (None: they work), `on_call` is called before each of them.
    """

    def __init__(self, *pods: dict[str, Any], observed_generation: bool = True) -> None:
        self.calls: list[tuple[str, str, Any]] = []
        self.faults: deque[BaseException | Unanswered | None] = deque()
        self.on_call: Callable[[], None] = lambda: None
        self.pods: dict[str, dict[str, Any]] = {}
        self.feeds: dict[str, deque[dict[str, Any]]] = {}
        self.policies: dict[str, dict[str, Any]] = {}
        """The policies that exist, with what the status of each holds as originals."""
        self.policy_versions: dict[str, int] = {}
        self.owners: dict[str, dict[str, Any]] = {}
        """Controllers by the path under which the API has them."""
        self._reports_generation = observed_generation
        self._version = 100
        self._specs: dict[str, list[tuple[int, dict[str, int], dict[str, dict[str, str]]]]] = {}
        """The versions of each spec that the kubelet has yet to act on: generation, limits and requests."""
        for pod in pods:
            self.create(pod)

    # the API server

    def resize(self, namespace: str, name: str, patch: Mapping[str, Any], manager: str) -> int:
        return self._call("resize", namespace, name, patch, lambda uid, it: self._resize(uid, it, manager))

    def read(self, path: str) -> dict[str, Any]:
        try:
            return self.owners[path]
        except KeyError:
            raise refusal("NotFound") from None

    def read_page(self, path: str, most: int | None) -> Page | None:
        namespace = path.partition("/namespaces/")[2].partition("/")[0]
        return Page({"items": [self.policy(one) for one in self.policies if one.split("/")[0] == namespace]}, most or 1)

    def pod(self, namespace: str, name: str) -> dict[str, Any]:
        self._call("get", namespace, name, {}, lambda *_: None)
        return deepcopy(self.pods[self._uid(namespace, name)])

    def write_originals(self, namespace: str, policy: str, changes: Mapping[str, Any]) -> int:
        self._enter("store", policy, changes)
        fault = self._fault()
        if f"{namespace}/{policy}" not in self.policies:
            raise refusal("NotFound")
        version = self.change_originals(f"{namespace}/{policy}", changes)
        if fault is not None:
            raise fault.error
        return version

    def change_originals(self, policy: str, changes: Mapping[str, Any]) -> int:
        """By anyone; the policy's version afterwards."""
        self.policies[policy] = merged(self.policies[policy], changes)
        self._version += 1
        self.policy_versions[policy] = self._version
        return self._version

    def policy(self, reference: str) -> dict[str, Any]:
        """A policy's object as far as it matters here."""
        namespace, _, name = reference.partition("/")
        version = str(self.policy_versions.get(reference, 1))
        metadata = {"namespace": namespace, "name": name, "resourceVersion": version}
        return {"metadata": metadata, "status": {"originals": deepcopy(self.policies[reference])}}

    def create(self, pod: dict[str, Any]) -> str:
        uid = str(pod["metadata"]["uid"])
        self.pods[uid], self.feeds[uid] = deepcopy(pod), deque()
        self._specs[uid] = [self._version_of(uid)]
        self._commit(uid)
        return uid

    def edit(self, uid: str, container: str, *, by: str = "vpa-updater", request: str = "", **limits: str) -> None:
        """Another writer resizes a container."""
        resources = {"limits": limits, **({"requests": {"cpu": request}} if request else {})}
        self._resize(uid, {"spec": {"containers": [{"name": container, "resources": resources}]}}, by)

    def terminate(self, uid: str) -> None:
        """Deletion begins: the containers still run."""
        self.pods[uid]["metadata"]["deletionTimestamp"] = "2026-01-01T00:00:00Z"
        self._commit(uid)

    def remove(self, uid: str) -> None:
        """The containers have ended and the object is gone."""
        for known in (self.pods, self.feeds, self._specs):
            known.pop(uid)

    # the kubelet

    def kubelet(self, uid: str, generation: int | None = None) -> None:
        """Put a version of the spec in force, by default the newest, and notify nobody yet."""
        specs = self._specs[uid]
        wanted = specs[-1][0] if generation is None else generation
        self._specs[uid] = [spec for spec in specs if spec[0] >= min(wanted, specs[-1][0])]

    def report(self, uid: str) -> None:
        """Write what is in force into the status."""
        generation, limits, requests = self._specs[uid][0]
        status = self.pods[uid]["status"]
        status.pop("observedGeneration", None)
        if self._reports_generation:
            status["observedGeneration"] = generation
        for kind in ("containerStatuses", "initContainerStatuses"):
            for entry in status[kind]:
                if "resources" in entry:
                    limit = {**entry["resources"]["limits"], "cpu": f"{limits[entry['name']]}m"}
                    entry["resources"] = {"requests": dict(requests[entry["name"]]), "limits": limit}
                    entry["allocatedResources"] = dict(requests[entry["name"]])
        self._commit(uid)

    def confirm(self, *uids: str) -> None:
        """Do and report all there is to do."""
        for uid in uids or tuple(self.pods):
            self.kubelet(uid)
            self.report(uid)

    # what a test asks

    def limits(self, uid: str) -> dict[str, int]:
        """The CPU limits of the spec."""
        return {
            c["name"]: parse_cpu(c["resources"]["limits"]["cpu"])
            for c in self._containers(uid)
            if "cpu" in c["resources"].get("limits", {})
        }

    def limit(self, name: str) -> int:
        """The limit of the container that its pod is named after."""
        return self.limits(f"uid-{name}")[name]

    def originals(self, uid: str) -> dict[str, Original]:
        """What the policies' statuses hold about a pod."""
        return {
            name: Original(policy, cpu)
            for policy, status in self.policies.items()
            for found, stored in read(policy, status)
            for name, cpu in stored.containers.items()
            if found == uid
        }

    def highest(self, uid: str) -> dict[str, int]:
        """The highest limit that each container may have at some instant: in force, or still to be put in force."""
        versions = [limits for _, limits, _ in self._specs[uid]]
        return {name: max(limits[name] for limits in versions) for name in versions[0]}

    def resizes(self) -> list[tuple[str, dict[str, str]]]:
        """Every accepted or refused resize: pod, and the limits that it asked for."""
        return [
            (name, {c["name"]: c["resources"]["limits"]["cpu"] for cs in patch["spec"].values() for c in cs})
            for call, name, patch in self.calls
            if call == "resize"
        ]

    def _call(
        self, call: str, namespace: str, name: str, content: Mapping[str, Any], act: Callable[[str, Any], None]
    ) -> int:
        self._enter(call, name, content)
        fault = self._fault()
        uid = self._uid(namespace, name)
        act(uid, content)
        if fault is not None:
            raise fault.error
        return int(self.pods[uid]["metadata"]["resourceVersion"])

    def _enter(self, call: str, name: str, content: Mapping[str, Any]) -> None:
        self.calls.append((call, name, deepcopy(dict(content))))
        self.on_call()

    def _fault(self) -> Unanswered | None:
        fault = self.faults.popleft() if self.faults else None
        if isinstance(fault, BaseException):
            raise fault
        return fault

    def _uid(self, namespace: str, name: str) -> str:
        for uid, pod in self.pods.items():
            if (pod["metadata"]["namespace"], pod["metadata"]["name"]) == (namespace, name):
                return uid
        raise refusal("NotFound")

    def _resize(self, uid: str, patch: Mapping[str, Any], manager: str) -> None:
        if patch.get("metadata", {}).get("uid", uid) != uid:
            raise ActuationError("Invalid", "metadata.uid: Invalid value: field is immutable", retriable=False)
        pod, before = deepcopy(self.pods[uid]), deepcopy(self.pods[uid]["spec"])
        for field in LISTS:
            by_name = {c["name"]: c for c in pod["spec"].get(field, [])}
            for change in patch["spec"].get(field, []):
                resources = by_name[change["name"]]["resources"]
                for kind, values in change["resources"].items():
                    if {**resources.get(kind, {}), **values} != resources.get(kind):
                        _note_manager(pod["metadata"], manager, field, change["name"], kind)
                    resources[kind] = {**resources.get(kind, {}), **values}
                if parse_cpu(resources["requests"]["cpu"]) > parse_cpu(resources["limits"]["cpu"]):
                    raise refusal("Invalid")
        if pod["spec"] == before:
            return
        pod["metadata"]["generation"] += 1
        self.pods[uid] = pod
        self._specs[uid].append(self._version_of(uid))
        self._commit(uid)

    def _version_of(self, uid: str) -> tuple[int, dict[str, int], dict[str, dict[str, str]]]:
        requests = {c["name"]: dict(c["resources"].get("requests", {})) for c in self._containers(uid)}
        return self.pods[uid]["metadata"]["generation"], self.limits(uid), requests

    def _commit(self, uid: str) -> None:
        self._version += 1
        self.pods[uid]["metadata"]["resourceVersion"] = str(self._version)
        self.feeds[uid].append(deepcopy(self.pods[uid]))

    def _containers(self, uid: str) -> list[dict[str, Any]]:
        spec = self.pods[uid]["spec"]
        return [*spec["containers"], *(c for c in spec["initContainers"] if c.get("restartPolicy") == "Always")]


def merged(kept: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """What a merge patch (RFC 7386) makes of an object."""
    result = dict(kept)
    for key, value in changes.items():
        if value is None:
            result.pop(key, None)
        elif isinstance(value, dict):
            before = result.get(key)
            result[key] = merged(before if isinstance(before, dict) else {}, value)
        else:
            result[key] = value
    return result


def _note_manager(metadata: dict[str, Any], manager: str, field: str, container: str, kind: str) -> None:
    """As the API server does: who changes a value owns it, and nobody else; who owns nothing more is forgotten."""
    entries = metadata.setdefault("managedFields", [])
    for entry in entries:
        entry["fieldsV1"].get("f:spec", {}).get(f"f:{field}", {}).get(_key(container), {}).get("f:resources", {}).pop(
            f"f:{kind}", None
        )
    nothing: dict[str, Any] = {"f:spec": {f"f:{field}": {_key(container): {"f:resources": {}}}}}
    entries[:] = [entry for entry in entries if entry["fieldsV1"] != nothing]
    path: dict[str, Any] = {_key(container): {"f:resources": {f"f:{kind}": {"f:cpu": {}}}}}
    entries.append({"manager": manager, "subresource": "resize", "fieldsV1": {"f:spec": {f"f:{field}": path}}})


def _key(container: str) -> str:
    return f'k:{{"name":"{container}"}}'
