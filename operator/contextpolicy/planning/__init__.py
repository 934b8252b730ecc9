"""Pure decisions: samples in, plans out.

Nothing here does I/O, reads a clock, or knows Kubernetes or Zenoh: time is always an argument, so the same samples
give the same plans live, in replay and in simulation. `tests/architecture/test_purity.py` enforces it. Only
`observable.py` knows Rx. `conditions` says what holds now, `allocation` who gets what; neither knows the other.
`planner` joins them; `inheritance` is what an edit keeps, `plan_json` is the form in which a plan leaves the process.
"""
