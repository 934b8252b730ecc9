"""`contextpolicy completion bash|zsh`: what the shell offers on Tab, also for `kubectl ctxp`.

The shell asks the program itself (`contextpolicy __complete WORDS`), so it offers what this version has, and the names
of the cluster's policies and contexts. kubectl asks plugins the same way, through `kubectl_complete-ctxp`.
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

SCRIPTS = {
    "bash": """\
_contextpolicy() {
  local word="${COMP_WORDS[COMP_CWORD]#=}"
  mapfile -t COMPREPLY < <(contextpolicy __complete "${COMP_WORDS[@]:1:COMP_CWORD}" 2>/dev/null)
  [ "${#COMPREPLY[@]}" -gt 0 ] || mapfile -t COMPREPLY < <(compgen -f -- "$word")
}
complete -o filenames -F _contextpolicy contextpolicy
""",
    "zsh": """\
#compdef contextpolicy
_contextpolicy() {
  local -a found
  [[ "$PREFIX" == --*=* ]] && compset -P '*='
  found=("${(@f)$(contextpolicy __complete "${(@)words[2,CURRENT]}" 2>/dev/null)}")
  [[ -n "$found" ]] && compadd -a found || _files
}
(( $+functions[compdef] )) || { autoload -Uz compinit && compinit }
compdef _contextpolicy contextpolicy
[[ "$funcstack[1]" != _contextpolicy ]] || _contextpolicy
""",
}
FROM_CLUSTER = frozenset(
    {"status", "force", "pause", "resume", "dry-run", "promote", "shadow", "adopt", "record", "why-not", "explain"}
)
"""Commands whose first argument is a policy of the cluster."""
WITHIN = {"force": "contexts", "why-not": "contexts", "explain": "tasks"}
"""What the second is one of: a list in the policy's spec."""
SOURCE = ("namespace", "kubeconfig", "cluster")
"""The options that say where names come from."""


class Line(NamedTuple):
    """What stands on the command line before the word that is completed: positional arguments, and options' values."""

    command: str
    places: Sequence[str]
    options: argparse.Namespace
    word: str


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


def candidates(parser: argparse.ArgumentParser, words: Sequence[str], names: Callable[[Line], list[str]]) -> list[str]:
    """What may stand in place of the last of `words`; `names` are those of the cluster."""
    *before, word = _separated(words)
    commands = _commands(parser)
    command = next((one for one in before if one in commands), None)
    if command is None:
        return [one for one in (*commands, *_options(parser)) if one.startswith(word)]
    own = commands[command]
    rest = before[before.index(command) + 1 :]
    taking = _option(own, rest[-1]) if rest else None
    if taking is not None and taking.nargs != 0:
        return [str(choice) for choice in taking.choices or () if str(choice).startswith(word)]
    offered = _options(own) if word.startswith("-") else _places(own, _line(own, command, rest, word), names)
    return [one for one in offered if one.startswith(word)]


def _separated(words: Sequence[str]) -> list[str]:
    """`--option=value` as two words; bash makes it three, with the sign as one of them."""
    joined = [part for word in words for part in (word.split("=", 1) if word.startswith("-") else [word])]
    *before, word = joined or [""]
    return [*(part for part in before if part != "="), "" if word == "=" else word]


def reply(parser: argparse.ArgumentParser, words: Sequence[str], *, directive: bool = False) -> int:
    """Print the candidates, one a line, and a directive if kubectl asks, as Cobra's completion has it."""
    for candidate in candidates(parser, words, _names):
        print(candidate)
    if directive:
        print(":4")  # no file names
    return 0


def _names(line: Line) -> list[str]:
    """Policies of the namespace, or what a policy has; without a cluster nothing is offered."""
    from contextpolicy.commands.cluster_access import api_server, namespace_of, policy_object, reference_of
    from contextpolicy.errors import ContextPolicyError

    if line.command not in FROM_CLUSTER or len(line.places) > (line.command in WITHIN):
        return []
    try:
        with api_server(line.options) as api:
            if line.places:
                line.options.policy = line.places[0]
                spec = policy_object(api, *reference_of(line.options))["spec"]
                return [one["name"] for one in spec.get(WITHIN[line.command]) or ()]
            before, slash, _ = line.word.rpartition("/")
            found = api.policies(before or namespace_of(line.options))
            return [f"{before}{slash}{policy['metadata']['name']}" for policy in found]
    except ContextPolicyError:
        return []


def _commands(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    [action] = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]  # noqa: SLF001
    return dict(action.choices)


def _options(parser: argparse.ArgumentParser) -> list[str]:
    return [name for action in parser._actions for name in action.option_strings if name.startswith("--")]  # noqa: SLF001


def _option(parser: argparse.ArgumentParser, word: str) -> argparse.Action | None:
    return next((action for action in parser._actions if word in action.option_strings), None)  # noqa: SLF001


def _line(parser: argparse.ArgumentParser, command: str, words: Sequence[str], word: str) -> Line:
    places: list[str] = []
    options = dict.fromkeys(SOURCE)
    taking: argparse.Action | None = None
    for one in _short_values_apart(parser, words):
        action = _option(parser, one)
        if taking is not None:
            options |= {taking.dest: one} if taking.dest in SOURCE else {}
            taking = None
        elif action is not None:
            taking = action if action.nargs != 0 else None
        elif not one.startswith("-"):
            places.append(one)
    return Line(command, places, argparse.Namespace(**options), word)


def _short_values_apart(parser: argparse.ArgumentParser, words: Sequence[str]) -> Iterator[str]:
    """`-nlab` is `-n lab`."""
    for word in words:
        short = _option(parser, word[:2]) if not word.startswith("--") and len(word) > 2 else None
        yield from (word,) if short is None else (word[:2], word[2:])


def _places(parser: argparse.ArgumentParser, line: Line, names: Callable[[Line], list[str]]) -> Iterator[str]:
    positional = [action for action in parser._actions if not action.option_strings]  # noqa: SLF001
    if len(line.places) < len(positional):
        yield from map(str, positional[len(line.places)].choices or ())
    yield from names(line)
