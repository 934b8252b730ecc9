"""I/O out that changes nothing: the decision bus, the status, events and metrics tell what was decided and why."""
