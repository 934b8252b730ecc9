"""I/O out: what makes a plan real.

The contract, `Actuator` in `contextpolicy.controller`: `apply` is idempotent and level-triggered: it is told the whole
of what should be, and may be told it again. It is called on the loop's thread and must not block.
"""
