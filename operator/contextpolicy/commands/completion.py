"""`contextpolicy completion bash|zsh`: what the shell offers on Tab, also for `kubectl ctxp`.

The shell asks the program itself (`contextpolicy __complete WORDS`), so it offers what this version has, and the names
of the cluster's policies and contexts. kubectl asks plugins the same way, through `kubectl_complete-ctxp`.
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

SCRIPTS = {
    "bash": """\
_contextpolicy() {
  local word="${COMP_WORDS[COMP_CWORD]}"
  mapfile -t COMPREPLY < <(contextpolicy __complete "${COMP_WORDS[@]:1:COMP_CWORD}" 2>/dev/null | grep -- "^$word")
  [ "${#COMPREPLY[@]}" -gt 0 ] || mapfile -t COMPREPLY < <(compgen -f -- "$word")
}
complete -o filenames -F _contextpolicy contextpolicy
""",
    "zsh": """\
#compdef contextpolicy
_contextpolicy() {
  local -a found
  found=("${(@f)$(contextpolicy __complete "${(@)words[2,CURRENT]}" 2>/dev/null)}")
  [[ -n "$found" ]] && compadd -a found || _files
}
compdef _contextpolicy contextpolicy
""",
}
FROM_CLUSTER = frozenset(
    {"status", "force", "pause", "resume", "dry-run", "promote", "shadow", "adopt", "record", "why-not", "explain"}
)
"""Commands whose first argument is a policy of the cluster."""


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "completion",
        help="print the completion script of a shell",
        description="Print a script for the shell's start-up file: source <(contextpolicy completion bash). "
        "kubectl completes `kubectl ctxp` by itself where kubectl_complete-ctxp is on the PATH.",
    )
    parser.add_argument("shell", choices=sorted(SCRIPTS))
    parser.set_defaults(main=lambda arguments: print(SCRIPTS[arguments.shell], end="") or 0)


def candidates(
    parser: argparse.ArgumentParser, words: Sequence[str], names: Callable[[str, int], list[str]]
) -> list[str]:
    """What may stand in place of the last of `words`; `names(command, place)` are those of the cluster."""
    *before, word = words or [""]
    commands = _commands(parser)
    command = next((one for one in before if one in commands), None)
    if command is None:
        return [one for one in (*commands, *_options(parser)) if one.startswith(word)]
    own = commands[command]
    rest = before[before.index(command) + 1 :]
    taking = _option(own, rest[-1]) if rest else None
    if taking is not None and taking.nargs != 0:
        return [str(choice) for choice in taking.choices or () if str(choice).startswith(word)]
    offered = _options(own) if word.startswith("-") else _places(own, command, _positional(own, rest), names)
    return [one for one in offered if one.startswith(word)]


def reply(parser: argparse.ArgumentParser, words: Sequence[str], *, directive: bool = False) -> int:
    """Print the candidates, one a line, and a directive if kubectl asks, as Cobra's completion has it."""
    print(*candidates(parser, words, _names), sep="\n")
    if directive:
        print(":4")  # no file names
    return 0


def _names(command: str, place: int) -> list[str]:
    """Policies of the current namespace; without a cluster nothing is offered."""
    from contextpolicy.commands.cluster_access import api_server, current_namespace
    from contextpolicy.errors import ContextPolicyError

    if command not in FROM_CLUSTER or place != 0:
        return []
    try:
        with api_server() as api:
            return [policy["metadata"]["name"] for policy in api.policies(current_namespace())]
    except ContextPolicyError:
        return []


def _commands(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    [action] = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]  # noqa: SLF001
    return dict(action.choices)


def _options(parser: argparse.ArgumentParser) -> list[str]:
    return [name for action in parser._actions for name in action.option_strings if name.startswith("--")]  # noqa: SLF001


def _option(parser: argparse.ArgumentParser, word: str) -> argparse.Action | None:
    return next((action for action in parser._actions if word in action.option_strings), None)  # noqa: SLF001


def _positional(parser: argparse.ArgumentParser, words: Sequence[str]) -> int:
    """How many positional arguments were given already."""
    count, skip = 0, False
    for word in words:
        action = _option(parser, word)
        if skip:
            skip = False
        elif action is not None:
            skip = action.nargs != 0
        else:
            count += not word.startswith("-")
    return count


def _places(
    parser: argparse.ArgumentParser, command: str, place: int, names: Callable[[str, int], list[str]]
) -> Iterator[str]:
    positional = [action for action in parser._actions if not action.option_strings]  # noqa: SLF001
    if place < len(positional) and positional[place].choices:
        yield from map(str, positional[place].choices or ())
    yield from names(command, place)
