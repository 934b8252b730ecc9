"""The operator as a process: settings, leadership, kopf, probes, and the wiring of everything below.

`supervisor` runs one replica from start to end, `wiring` constructs its parts, `kopf_handlers` are the only code that
kopf calls.
"""
