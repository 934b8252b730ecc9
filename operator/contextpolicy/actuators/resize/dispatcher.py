"""Send patches on workers, and process their outcomes on the loop."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Protocol, TypeVar

from contextpolicy.actuators.resize.pod_patch import Answer, Found, Patch, ask, send
from contextpolicy.cluster.container_names import container_id

if TYPE_CHECKING:
    from collections.abc import Callable

    from contextpolicy.actuators.resize.background import Background
    from contextpolicy.actuators.resize.conflict import Conflict
    from contextpolicy.actuators.resize.originals import Originals
    from contextpolicy.actuators.resize.pod_index import PodIndex
    from contextpolicy.actuators.resize.pod_patch import ResizeApi
    from contextpolicy.actuators.resize.tracked_pod import TrackedPod
    from contextpolicy.cluster.pods import Cpu
    from contextpolicy.errors import ActuationError


Result = TypeVar("Result")


class Observer(Protocol):
    """Receives the progress of resizes; called on the loop's thread."""

    def on_accepted(self, policy: str, container: str, cpu: Cpu, answered: float) -> None:
        """The API accepted the new resources; `answered` is the monotonic time of its answer."""

    def on_in_force(self, policy: str, container: str, limit: int) -> None:
        """The kubelet reports the plan's limit, in thousandths of a core, as in force."""

    def on_problem(self, policy: str, subject: str, error: ActuationError | None) -> None:
        """A write to a pod (`subject`), or to the policy's status, failed; None: it works again."""

    def on_conflict(self, policy: str, container: str, conflict: Conflict | None) -> None:
        """Another client resized a container of the policy, or has not done so for a while (None)."""

    def on_changed_by_other(self, policy: str) -> None:
        """Another client changed the originals in the policy's status; they are written again."""


class PatchListener(Protocol):
    """Continues when a patch has ended; called on the loop's thread."""

    def on_patch_end(self, pod: TrackedPod) -> None:
        """The answer about the pod's patch has come, and the pod's state reflects it."""


class Dispatcher:
    """Sends patches and asks what became of them.

    An answer about a pod that is gone meanwhile, or whose namespace another operator serves now, is ignored.
    """

    def __init__(  # noqa: PLR0913 - all that an answer concerns
        self,
        originals: Originals,
        pods: PodIndex,
        api: ResizeApi,
        background: Background,
        observer: Observer,
        *,
        listener: PatchListener,
    ) -> None:
        self._originals, self._pods, self._api, self._background = originals, pods, api, background
        self._observer, self._listener = observer, listener

    def send(self, pod: TrackedPod, patch: Patch) -> None:
        """Send a patch of an idle pod."""
        pod.state.send(patch)
        self._run(pod, partial(send, self._api, pod.view, patch), lambda answer: self._on_answer(pod, patch, answer))

    def ask(self, pod: TrackedPod, cause: ActuationError | None = None) -> None:
        """Read the pod to learn what became of its patch; `cause` is the error that answered it, if any."""
        patch = pod.state.patch
        if patch is not None:
            self._run(pod, partial(ask, self._api, pod.view), lambda found: self._on_found(pod, patch, found, cause))

    def recovered(self, policy: str, pod: TrackedPod) -> None:
        """Report that the policy has no problem with the pod any more."""
        if policy in pod.troubled:
            pod.troubled.discard(policy)
            self._observer.on_problem(policy, pod.view.name, None)

    def _run(self, pod: TrackedPod, work: Callable[[], Result], then: Callable[[Result], None]) -> None:
        self._background.run(work, lambda result: then(result) if self._pods.holds(pod) else None)

    def _on_answer(self, pod: TrackedPod, patch: Patch, answer: Answer) -> None:
        now, error = self._background.now(), answer.error
        if error is None:
            pod.state.accept(answer.version, now)
            self._take_effect(pod, patch, answer.received)
        elif error.reason == "NotFound":
            pod.state.miss()
            self.ask(pod, error)
        elif error.in_doubt:
            pod.state.lose(error, now)
            self._tell(patch, pod, error)
        elif error.retriable:
            pod.state.postpone(error, now)
            self._tell(patch, pod, error)
        else:
            pod.state.refuse()
            self._refuse(pod, patch, error)
        self._listener.on_patch_end(pod)

    def _on_found(
        self, pod: TrackedPod, patch: Patch, found: Found | ActuationError, cause: ActuationError | None
    ) -> None:
        now = self._background.now()
        if isinstance(found, Found):
            if pod.find(found.view, now):
                self._take_effect(pod, patch, found.received)
            elif cause is not None:
                self._refuse(pod, patch, cause)  # the pod exists, so the 404 was for its subresource `resize`
        elif found.reason == "NotFound":
            pod.state.miss()
        else:
            pod.state.lose(found, now)
            self._tell(patch, pod, found)
        self._listener.on_patch_end(pod)

    def _take_effect(self, pod: TrackedPod, patch: Patch, received: float) -> None:
        pod.refusals.pop((patch.policy, patch.restore), None)
        pod.nudge_state.nudged()
        self.recovered(patch.policy, pod)
        for name, cpu in patch.resources.items():
            if patch.restore:
                self._originals.drop(pod.uid, name)
            else:
                pod.give(patch.policy, name, cpu)
            self._observer.on_accepted(patch.policy, container_id(pod.view, name), cpu, received)

    def _refuse(self, pod: TrackedPod, patch: Patch, error: ActuationError) -> None:
        pod.refuse(patch, self._background.now())
        self._tell(patch, pod, error)

    def _tell(self, patch: Patch, pod: TrackedPod, error: ActuationError) -> None:
        pod.troubled.add(patch.policy)
        self._observer.on_problem(patch.policy, pod.view.name, error)
