"""`contextpolicy skeleton`: the first policy for a robot, from the module.yaml files of what runs on it."""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from contextpolicy.policy.module_file import ModuleFile

_NAME = re.compile(r"[a-z0-9]([a-z0-9-]{0,61}[a-z0-9])?")


def add(subparsers: Any) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "skeleton",
        help="write a first policy from a robot's module.yaml files",
        description="Print a valid policy with a task for each module: its needs, its streams, an activity for each "
        "input that a policy can read, and a context that raises its weight when it misses its deadlines. The policy "
        "is in mode DryRun: edit it before you enforce it.",
    )
    parser.add_argument("modules", nargs="+", metavar="MODULE", help="a module.yaml, or the folder that holds it")
    parser.add_argument("--name", type=_name, default="robot", help="the policy's name (default: robot)")
    parser.add_argument("--namespace", type=_name, default="robot", help="the policy's namespace (default: robot)")
    parser.set_defaults(main=main)


def main(arguments: argparse.Namespace) -> int:
    """Read all modules; print the policy, or everything that is wrong with them."""
    from contextpolicy.errors import unreadable
    from contextpolicy.policy.module_file import ModuleFileError
    from contextpolicy.policy.skeleton import skeleton

    modules: list[ModuleFile] = []
    refused = []
    for name in arguments.modules:
        path = Path(name) / "module.yaml" if Path(name).is_dir() else Path(name)
        try:
            modules.append(_load(path, taken=[module.name for module in modules]))
        except ModuleFileError as error:
            refused.append(str(error))
        except (OSError, UnicodeDecodeError) as error:
            print(f"{path}: {unreadable(error)}", file=sys.stderr)
            return 2
    if refused:
        print("\n".join(refused), file=sys.stderr)
        return 1
    print(skeleton(modules, name=arguments.name, namespace=arguments.namespace), end="")
    return 0


def _load(path: Path, *, taken: list[str]) -> ModuleFile:
    from contextpolicy.errors import Fault, Finding
    from contextpolicy.policy.module_file import ModuleFileError, parse_module
    from contextpolicy.policy.validation.documents import DocumentError, read

    try:
        documents = list(read(path.read_text(encoding="utf-8")))
    except DocumentError as error:
        raise ModuleFileError(str(path), (Finding("", None, str(error), Fault.FILE),)) from error
    if len(documents) != 1:
        raise ModuleFileError(str(path), (Finding("file", f"{len(documents)} documents", "one YAML document"),))
    module = parse_module(documents[0].body, subject=str(path))
    if module.name in taken:
        raise ModuleFileError(str(path), (Finding("module.name", module.name, "a name that is not used yet"),))
    return module


def _name(text: str) -> str:
    if not _NAME.fullmatch(text):
        raise argparse.ArgumentTypeError(f"invalid value {text!r}: expected lower-case letters, digits and dashes")
    return text
