"""Real input for timelines: recordings made on this machine, in the formats of the public data sets.

A recording is a folder in `build/datasets`; `python -m timelines.datasets` makes missing and outdated ones. A real
EuRoC sequence, unpacked to `build/datasets/<name>/mav0`, is read the same way. Generators are deterministic.
"""
