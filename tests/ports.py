"""TCP ports of 127.0.0.1 for servers that must know theirs before they listen, or keep it over a restart."""

from __future__ import annotations

import random
import socket

PORTS = range(20_000, 30_000)
"""Below those that Linux gives to outgoing connections (`net.ipv4.ip_local_port_range`): none of these can take the
port between two lives of a server, or find itself there in place of a server that is not up yet."""


def free_port() -> int:
    """A port at which nobody listens. Others may ask at the same time: it is one of many, at random."""
    for port in random.SystemRandom().sample(PORTS, len(PORTS)):
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
            return port
    raise OSError(f"no port of {PORTS.start} to {PORTS.stop - 1} is free")
