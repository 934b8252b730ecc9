"""Context decides who gets the CPU.

Zenoh sample -> stream -> score -> context -> weights -> shares -> plan -> actuator -> cgroup

`planning` decides, without I/O, clock, Kubernetes or Zenoh; `streams` reads, `actuators` writes, `telemetry` reports,
`policies` joins them for each policy, and `app` ties policies to their life cycle in the cluster.
"""
