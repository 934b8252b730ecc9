"""The node agent: receives plans from the decision bus and makes them real on its own node, without the API server.

    bus message -> order -> admission -> steps -> cgroup files and threads, with a ledger of what was there before

`node_orders`, `admission` and `steps` are pure. Everything runs on the loop's thread, but for the callbacks of Zenoh
(`bus_link`), the blocked read of `inotify`, and the HTTP server of `service`.

What "undo" means. The API and the kubelet own every CPU limit: the agent only writes what a resize is about to write,
a little sooner. For each file that it wrote the ledger keeps `theirs`, what anybody else last wrote there, and `ours`.
`inotify` reports when another process writes the file:

- `ours`: the resize came and agrees. From then on `theirs` is the same; only the original is left to put back.
- a value of an earlier plan: a resize that was under way when the plan changed. It becomes `theirs`; ours is put back.
- `theirs` again: nothing new was decided. systemd, which makes the cgroups of most robots, writes all of a unit's
  settings again at `daemon-reload` and `set-property`, with the limit it last got from the kubelet. Ours is restored.
- `ours`, but we wrote it over something that `inotify` had yet to report, or after the report was read: the report is
  of what was there before. The entry stays open.
- anything else: a decision of the owner. The value stays until the next plan, which has it too if the owner has won
  against the operator (`actuators.resize.conflict`); nothing is left to undo.

Pods grow with their containers, as their limit is the sum of these. One with a limit of its own (`spec.resources`) does
not: that is never written, no container in the pod gets more, and one without a limit has the pod's, as the kubelet
writes it. So the pod's file says what to put back there, also after its owner has changed it.

To undo is to put back the original, the limit that the container had before any policy: the plan says which. A pod, and
a container whose original is unknown, gets `theirs`. Files that hold neither `ours` nor `theirs` by now are left alone.
That happens when a plan no longer names the container, when the policy leaves Enforce or is deleted, and when the
policy's plans have had no source for the grace period: nothing else would restore it then. At
SIGTERM everything gets `theirs` while the policy's source lives: what the API has is its plan, and the next agent, or
the operator without one, goes on from there. The same when a newer plan of the operator is refused: it resizes instead,
and what was written for the plan before would only be defended against that.

The ledger is saved before the first write, so a restarted agent, or the supervisor of one that is not, knows all this:
files then wait for the policy's plan, which says what the API has by now, and are undone after the grace period if none
comes. Where the operator lives, it has the kubelet write the API's limits once more (`actuators.resize.takeover`).

What can't be written, or can't be journalled first, stays as it is. The confirmation of the plan names those
containers, and those that the plan dropped and that could not be undone; the operator resizes them itself. It is tried
again with each repetition of the plan, and after growing pauses for as long as it fails (`retries`).

CPU weights are the agent's alone while a plan wants them: whatever others write is `theirs`, and ours is put back. So
are quotas that the API can't have, such as 10m below a container's request.

Only the agent writes realtime budgets and the CPU limits of suspended realtime tasks, so no resize ever confirms those:
they stay in the ledger until they are undone.
"""
