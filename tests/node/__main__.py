"""The command line: python -m tests.node COMMAND."""

from __future__ import annotations

import argparse
import logging
import os
import sys
from pathlib import Path

from tests.node import access, autoscaler, build, components, images, lifecycle
from tests.node.errors import ClusterError


def parser() -> argparse.ArgumentParser:
    top = argparse.ArgumentParser(prog="python -m tests.node", description="A one-node Kubernetes.")
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    commands.add_parser("up", help="build what is missing, start the node and wait until it is Ready")
    down = commands.add_parser("down", help="end the node and leave nothing behind")
    down.add_argument("--keep-state", action="store_true", help="as a reboot: `up` goes on from there")
    commands.add_parser("status", help="show each component's state; exit 1 when one is not ready")
    for name in ("stop", "start"):
        single = commands.add_parser(name, help=f"{name} one component")
        single.add_argument("name", choices=components.names())
    inside = commands.add_parser("exec", help="run a command in the node's network, with kubectl, helm and ctr")
    inside.add_argument("argv", nargs=argparse.REMAINDER, metavar="-- COMMAND")
    vpa = commands.add_parser("autoscaler", help="build, start or stop a VerticalPodAutoscaler with its metrics-server")
    vpa.add_argument("deed", choices=("build", "start", "stop"))
    vpa.add_argument("--interval", type=int, default=autoscaler.INTERVAL, help="seconds between its looks (10)")
    image = commands.add_parser("image", help="build an image as NAME:dev and import it")
    image.add_argument("name")
    image.add_argument("dockerfile", type=Path)
    image.add_argument("context", type=Path)
    return top


def main() -> int:
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    try:
        return dispatch(parser().parse_args())
    except ClusterError as error:
        logging.getLogger(__name__).error("error: %s", error)  # noqa: TRY400, the message is the explanation
        return 1


def dispatch(arguments: argparse.Namespace) -> int:
    match arguments.command:
        case "up":
            lifecycle.up()
        case "down":
            lifecycle.down(keep_state=arguments.keep_state)
        case "status":
            return print_status()
        case "stop":
            lifecycle.stop(arguments.name)
        case "start":
            lifecycle.start(arguments.name)
        case "exec":
            execute([word for index, word in enumerate(arguments.argv) if index or word != "--"])
        case "autoscaler":
            autoscale(arguments.deed, arguments.interval)
        case "image":
            images.image(arguments.name, arguments.dockerfile, arguments.context.resolve())
    return 0


def autoscale(deed: str, interval: int) -> None:
    match deed:
        case "build":
            for program in build.AUTOSCALER:
                build.build(program)
        case "start":
            autoscaler.start(interval)
        case "stop":
            autoscaler.stop()


def print_status() -> int:
    if access.user_cluster():
        sys.stdout.write(f"using the cluster of KUBECONFIG={access.user_cluster()}\n")
        return 0
    states = lifecycle.status()
    sys.stdout.writelines(f"{name:<20} {state}\n" for name, state in states.items())
    return 0 if set(states.values()) == {"ready"} else 1


def execute(argv: list[str]) -> None:
    """Become the command."""
    if not argv:
        raise ClusterError("exec: no command given; it goes after `--`")
    line = access.command(argv)
    environment = access.environment()
    try:
        os.execvpe(line[0], line, environment)  # noqa: S606, there is no shell on purpose
    except FileNotFoundError as error:
        raise ClusterError(f"exec: {line[0]} is not on the PATH") from error


if __name__ == "__main__":
    sys.exit(main())
