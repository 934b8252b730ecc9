"""The parser of every command: options in full, help as wide as the terminal."""

from __future__ import annotations

import argparse
import re
import sys
import textwrap
from typing import TYPE_CHECKING, Any, NoReturn

from contextpolicy.commands.exit_codes import FAILED
from contextpolicy.commands.terminal import columns

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

_TERM = re.compile(r"  \S+ {2,}\S")
"""The first line of a definition: a term and its text, in two columns."""
_BRACKETED = re.compile(r"\[[^][|]{,30}\]")
_KEPT = "\N{NO-BREAK SPACE}"
_WORDS: dict[str, Any] = {"break_long_words": False, "break_on_hyphens": False}


class CommandParser(argparse.ArgumentParser):
    """Its sub-parsers are of the same class.

    Abbreviated options are refused: the next version may have another that begins so, and a script would then do
    something else.
    """

    def __init__(self, **settings: Any) -> None:
        super().__init__(**{"allow_abbrev": False, "formatter_class": HelpFormatter, **settings})
        self._intermixed = False

    def parse_known_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:  # type: ignore[override]
        """Report unknown words here: argparse leaves them to the parser of all commands, whose help would not help."""
        found, unknown = super().parse_known_args(args, namespace)
        if self._intermixed:
            return found, unknown
        if unknown and self._takes_fewer_words():
            found, unknown = self._parse_words_between_options(args, namespace)
        if unknown:
            options = (word.partition("=")[0] for word in unknown if word.startswith("-"))
            meant = next(filter(None, (_meant(one, self._option_string_actions) for one in options)), "")
            self.error(f"unrecognized arguments: {' '.join(unknown)}{meant}")
        return found, unknown

    def _takes_fewer_words(self) -> bool:
        """Whether a last word may be absent: argparse takes it for absent if an option stands before it."""
        return any(one.nargs == argparse.OPTIONAL for one in self._get_positional_actions())

    def _parse_words_between_options(self, args: Sequence[str] | None, namespace: Any) -> Any:
        self._intermixed = True
        try:
            return self.parse_known_intermixed_args(args, namespace)
        finally:
            self._intermixed = False

    def error(self, message: str) -> NoReturn:
        """The message and where to find help, as wide as the terminal, and exit code 2."""
        lines, width = [f"{self.prog}: error: {message}", f"Try '{self.prog} --help'."], columns(sys.stderr)
        wrapped = (textwrap.fill(line, width, **_WORDS) if width else line for line in lines)
        self.exit(FAILED, "".join(f"{line}\n" for line in wrapped))

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is None or value in action.choices:
            return
        meant = _meant(value, map(str, action.choices))
        if action.nargs == argparse.PARSER:
            self.error(f"unknown command {value!r}{meant}")
        listed = ", ".join(map(str, action.choices))
        raise argparse.ArgumentError(action, f"invalid choice: {value!r}, expected one of {listed}{meant}")

    def _print_message(self, message: str, file: Any = None) -> None:
        """Fail where help can't be written, which argparse ignores."""
        (file or sys.stderr).write(message)


def _meant(word: object, known: Iterable[str]) -> str:
    """The suggestion for a wrong word; loaded only then, as long-running commands need none."""
    from contextpolicy.policy.suggestions import did_you_mean

    return did_you_mean(word, known)


class HelpFormatter(argparse.HelpFormatter):
    """Wraps paragraphs and definitions at COLUMNS; what is indented otherwise is an example and stays as it is."""

    def _format_usage(self, usage: Any, actions: Any, groups: Any, prefix: Any) -> str:
        """Argparse indents by the program's name and keeps alternatives on one line, which a narrow terminal cuts."""
        text = super()._format_usage(usage, actions, groups, prefix)
        if all(len(line) <= self._width for line in text.splitlines()):
            return text
        whole = _BRACKETED.sub(lambda part: part[0].replace(" ", _KEPT), " ".join(text.split()))
        lines = textwrap.wrap(whole, self._width, subsequent_indent=" " * 7, **_WORDS)
        return "\n".join(lines).replace(_KEPT, " ") + "\n\n"

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return "\n\n".join("\n".join(_wrapped(part, width, indent)) for part in text.split("\n\n"))


def _wrapped(paragraph: str, width: int, indent: str) -> Iterator[str]:
    lines = paragraph.splitlines()
    if not lines[0].startswith(" "):
        yield from textwrap.wrap(" ".join(lines), width, initial_indent=indent, subsequent_indent=indent)
    elif _TERM.match(lines[0]):
        yield from _definitions(lines, width)
    else:
        for line in lines:
            yield from _example(line, width)


def _example(line: str, width: int) -> Iterator[str]:
    """Code can't be wrapped, but the comment beside it can stand above it."""
    code, mark, comment = line.partition("  # ")
    if mark and len(line) > width:
        indent = f"{' ' * (len(code) - len(code.lstrip()))}# "
        yield from textwrap.wrap(comment.strip(), width, initial_indent=indent, subsequent_indent=indent)
        yield code.rstrip()
    else:
        yield line


def _definitions(lines: list[str], width: int) -> Iterator[str]:
    starts = [number for number, line in enumerate(lines) if _TERM.match(line)]
    for start, end in zip(starts, [*starts[1:], len(lines)], strict=True):
        term, text = lines[start].split(maxsplit=1)
        whole = " ".join([text, *map(str.strip, lines[start + 1 : end])])
        yield from textwrap.wrap(whole, width, initial_indent=f"  {term:6} ", subsequent_indent=" " * 9)
