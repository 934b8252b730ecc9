"""I/O out: what makes a plan real.

The contract, `Actuator`: `apply` is idempotent and level-triggered: it is told the whole of what should be and may be
told again; `release` puts everything back. Both are called on the loop's thread and must not block.
"""
