"""Context decides who gets the CPU.

Zenoh sample -> stream -> score -> context -> weights -> shares -> plan -> actuator -> cgroup

`planning` decides, without I/O, clock, Kubernetes or Zenoh; `streams` reads, `actuators` writes, `telemetry` reports,
`controller` joins them for one policy, and `handlers` ties policies to their life cycle in the cluster.
"""
