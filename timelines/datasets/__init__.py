"""Real input for timelines: recordings made on this machine, in the formats of the public data sets.

A recording is a folder of `build/datasets`; `python -m timelines.datasets` makes those that are missing or outdated. A
real EuRoC sequence, unpacked to `build/datasets/<name>/mav0`, is read the same way. Generators are deterministic.
"""
