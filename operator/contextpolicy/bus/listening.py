"""The addresses that servers listen on, where there are both IPv4 and IPv6, or only one of them."""

from __future__ import annotations

import socket
from socketserver import TCPServer

DUAL = socket.has_dualstack_ipv6()
"""A kernel can be booted without IPv6; then there is no `::` to listen on."""
EVERYWHERE = "::" if DUAL else "0.0.0.0"  # noqa: S104 - kubelets and scrapers come from outside


class DualStack(TCPServer):
    """Mix into an HTTP server that listens at EVERYWHERE, to make it answer on both address families."""

    address_family = socket.AF_INET6 if DUAL else socket.AF_INET

    def server_bind(self) -> None:
        """Whatever the node's net.ipv6.bindv6only says."""
        if self.address_family is socket.AF_INET6:
            self.socket.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 0)
        super().server_bind()


def loopback() -> str:
    """The address at which only this machine is reached: in a network without IPv4 it may have none of IPv4."""
    with socket.socket() as probe:
        try:
            probe.bind(("127.0.0.1", 0))
        except OSError:
            return "::1"
    return "127.0.0.1"
