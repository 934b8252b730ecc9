"""I/O out that changes nothing: status, events, metrics and logs tell what was decided and why."""
