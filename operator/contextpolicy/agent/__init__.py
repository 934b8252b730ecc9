"""The node agent: receives plans from the decision bus and makes them real on its own node, without the API server.

    bus message -> order -> admission -> steps -> cgroup files and threads, with a ledger of what was there before

`node_orders`, `admission` and `steps` are pure. Everything runs on the loop's thread, but for the callbacks of Zenoh
(`bus_link`), the blocked read of `inotify`, and the HTTP server of `service`.

What "undo" means. The API and the kubelet own every CPU limit: the agent only writes what a resize is about to write,
a little sooner. For each file that it wrote the ledger keeps `theirs`, what anybody else last wrote there, and `ours`.
`inotify` reports when somebody else writes the file:

- `ours`: the resize came and agrees. The entry is closed; nothing is left to undo.
- a value of an earlier plan: a resize that was under way when the plan changed. It becomes `theirs`; ours is put back.
- `theirs` again: nothing new was decided. systemd, which makes the cgroups of most robots, writes all of a unit's
  settings anew at `daemon-reload` and `set-property`, with the limit that the kubelet last told it. Ours is put back.
- `ours`, but we wrote it over something that `inotify` had yet to report: the report is of that, which is `theirs`
  now. The entry stays open.
- anything else: a decision of the owner. The value stays until the next plan; nothing is left to undo.

To undo is to write `theirs` back where the file still holds `ours`. That happens when a plan no longer names the
container, when the policy leaves Enforce or is deleted, when the policy's plans have had no source for the grace
period, and at SIGTERM. The ledger is saved before the first write, so a restarted agent knows all this: files that
still hold `ours` then wait for the policy's plan, which says what the API has by now, and are undone after the grace
period if none comes. One thing it can't know: that a resize agreed while no agent ran, for a policy whose operator is
gone too. The older value is then put back, and the next resize or plan corrects it.

What can't be written, or can't be journalled first, stays as it is. The confirmation of the plan names those
containers, the operator resizes them itself, and each repetition of the plan tries again.

Nobody else writes realtime budgets and the CPU limits of suspended realtime tasks, so no resize ever confirms those:
they stay in the ledger until they are undone.
"""
