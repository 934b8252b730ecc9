"""I/O in: everything that produces samples. Zenoh live, timelines in virtual time."""
