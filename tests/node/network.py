"""The node's own network namespace: no packet of the node can leave the machine, no port clashes with it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tests.node.layout import NETWORK_NAMESPACE, NODE_ADDRESS
from tests.node.shell import run

if TYPE_CHECKING:
    from pathlib import Path

INTERFACE = "node0"


def create(namespace: Path = NETWORK_NAMESPACE) -> None:
    """Create the namespace; a bridge carries the node's address, for not every kernel has a dummy device."""
    namespace.parent.mkdir(parents=True, exist_ok=True)
    namespace.touch()
    run(["unshare", f"--net={namespace}", "true"])
    for command in commands():
        run(inside(command, namespace))


def exists(namespace: Path = NETWORK_NAMESPACE) -> bool:
    return namespace.exists()


def commands() -> tuple[tuple[str, ...], ...]:
    return (
        ("ip", "link", "set", "lo", "up"),
        ("ip", "link", "add", INTERFACE, "type", "bridge"),
        ("ip", "address", "add", f"{NODE_ADDRESS}/24", "dev", INTERFACE),
        ("ip", "link", "set", INTERFACE, "up"),
        # Packets to a service address need some route before kube-proxy's rules see them.
        ("ip", "route", "add", "default", "dev", INTERFACE),
        ("sysctl", "--quiet", "--write", "net.ipv4.ip_forward=1"),
    )


def inside(command: tuple[str, ...] | list[str], namespace: Path = NETWORK_NAMESPACE) -> list[str]:
    """Return the command that runs a command in the node's network and changes nothing else.

    `ip netns exec` would mount /sys again, which hides the cgroups.
    """
    return ["nsenter", f"--net={namespace}", "--", *command]
