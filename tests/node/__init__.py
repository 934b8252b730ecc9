"""A real single-node Kubernetes for tests and demos: built from source, started, inspected and removed.

Belongs here: how the node's programs are built, configured, started and stopped, and how images get into it.
Forbidden: anything that knows the product under test, and any dependency beyond the standard library.
"""
