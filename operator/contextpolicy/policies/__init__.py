"""The policies that one operator runs.

`loader` reads a ContextPolicy and what it names, `registry` holds all of them, `manager` starts and stops a
`policy_runner` for each, `binder` finds their pods, `promotion` swaps a shadow in, `status_publisher` and `queries`
report on them.
"""
