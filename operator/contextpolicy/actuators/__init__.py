"""I/O out: what makes a plan real.

The contract is `Actuator` in `contextpolicy.policies.policy_runner`. `apply` is idempotent and level-triggered: each
order states everything the policy wants, and may be repeated. It is called on the loop's thread and must not block.
"""
