"""A virtual machine with what robots run: Debian's kernel, systemd, cgroup v2; and a node in it, with tests."""
