"""The commands in our documents: what stands in a block of code, or between backticks, and begins with a program."""

from __future__ import annotations

import re
import shlex
import subprocess
from functools import cache
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
PROGRAMS = ("make", "contextpolicy", "kubectl", "helm", "python", ".venv/bin/python", "sudo", "buildah", "pip", "git")
_FENCE = re.compile(r"^```(\w*)\n(.*?)^```", flags=re.MULTILINE | re.DOTALL)
_INDENTED = re.compile(r"(?:^    .*\S.*\n)+", flags=re.MULTILINE)
_SPAN = re.compile(r"(?<!`)`([^`\n]+(?:\n[^`\n]+)?)`(?!`)")
_ASSIGNMENT = re.compile(r"^(?:[A-Z_]+=\S+ )+")


class Command(NamedTuple):
    """One command of one document, without comment and prompt.

    `whole` is one to be typed as it stands, in a block; between backticks a part of one may stand, to be talked about.
    `printed` is what the document says that it prints, for a session on a console.
    """

    document: str
    text: str
    whole: bool
    printed: str = ""

    @property
    def words(self) -> list[str]:
        """Program and arguments, up to a pipe or a redirection."""
        return shlex.split(re.split(r" [|>] ", _ASSIGNMENT.sub("", self.text))[0])


@cache
def commands() -> list[Command]:
    """Every command of every document that git knows."""
    listed = subprocess.run(["git", "ls-files", "*.md"], cwd=ROOT, capture_output=True, text=True, check=True)
    found = [one for name in listed.stdout.split() for one in _commands(name, (ROOT / name).read_text("utf-8"))]
    return list(dict.fromkeys(found))


def _commands(name: str, text: str) -> list[Command]:
    found = []
    for language, block in _FENCE.findall(text):
        found += _session(name, block) if language == "console" else []
    prose = _FENCE.sub("", text)
    for block in _INDENTED.findall(prose):
        lines = re.sub(r" *\\\n\s+", " ", block).splitlines()
        found += [Command(name, _bare(line), whole=True) for line in lines]
    spans = (re.sub(r"\s+", " ", span) for span in _SPAN.findall(_INDENTED.sub("", prose)))
    found += [Command(name, span, whole=False) for span in spans if " " in span]
    return [one for one in found if _program(one.text) in PROGRAMS]


def _session(name: str, block: str) -> list[Command]:
    parts = (part.partition("\n") for part in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:])
    return [Command(name, _bare(first), whole=True, printed=printed) for first, _, printed in parts]


def _bare(line: str) -> str:
    """Without prompt and comment."""
    return re.sub(r"\s+# .*$", "", line.strip().removeprefix("$ ")).strip()


def _program(text: str) -> str:
    return _ASSIGNMENT.sub("", text).split(" ")[0]
