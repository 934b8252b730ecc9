"""Context decides who gets the CPU.

Zenoh sample -> stream -> score -> context -> weights -> shares -> plan -> actuator -> cgroup

`planning` decides and knows no I/O, no clock, no Kubernetes and no Zenoh; `streams` reads, `actuators` writes,
`telemetry` tells, `controller` joins them for one policy and `handlers` ties policies to their life in the cluster.
"""
