"""The node agent: hears plans on the decision bus and makes them real on its own node, without the API server.

    bus message -> order -> admission -> steps -> cgroup files and threads, with a ledger of what was there before

`layout`, `orders`, `admission`, `steps` and `capabilities` are pure. Everything else runs on the loop's thread.

What "undo" means. The API and the kubelet own every CPU limit: the agent only writes what a resize is about to write,
a little sooner. For each file that it wrote the ledger keeps `theirs`, what anybody else last wrote there, and `ours`.
The kernel tells when somebody else writes the file:

- `ours`: the resize came and agrees. The entry is closed, there is nothing left to undo.
- a value of an earlier plan: a resize that was under way when the plan changed. It becomes `theirs`; ours is put back.
- anything else: the owner has spoken. The value stays until the next plan, and there is nothing left to undo.

To undo is to write `theirs` back where the file still holds `ours`. That happens when a plan no longer names the
container, when the policy leaves Enforce or is deleted, when the policy's plans have had no source for the grace
period, and at SIGTERM. The ledger is on disk before the first write, so an agent that was killed knows all this when
it starts again: what still holds `ours` then waits for the policy's plan, which says what the API has by now, and is
undone after the grace period if none comes. One thing it can't know: a resize that agreed while no agent ran, for a
policy whose operator is gone too. The older value is then put back, and the next resize or plan corrects it.

No one else writes realtime budgets and CPU limits of suspended realtime tasks, so nobody ever agrees with those: they
stay in the ledger until they are undone.
"""
