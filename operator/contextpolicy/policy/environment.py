"""Settings from environment variables: each is read once, and all mistakes are reported together."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from contextpolicy.errors import Finding, SettingsError

if TYPE_CHECKING:
    from collections.abc import Mapping

DEFAULT_CONNECT = "tcp/127.0.0.1:7447"
LOG_FORMATS = ("text", "json")
LOG_LEVELS = ("debug", "info", "warning", "error")


class Environment:
    """Reads variables; an empty one counts as unset. A mistake goes to `findings`, and the default is returned."""

    def __init__(self, variables: Mapping[str, str]) -> None:
        self.findings: list[Finding] = []
        self._variables = variables

    def check(self) -> None:
        """SettingsError with every mistake found so far."""
        if self.findings:
            raise SettingsError("environment", tuple(self.findings))

    def text(self, name: str, default: str = "") -> str:
        """The variable as it is."""
        return self._variables.get(name, "") or default

    def words(self, name: str) -> tuple[str, ...]:
        """A list separated by commas."""
        return tuple(word.strip() for word in self.text(name).split(",") if word.strip())

    def endpoints(self, name: str) -> tuple[str, ...]:
        """Zenoh endpoints; by default the router of this machine."""
        endpoints = self.words(name) or (DEFAULT_CONNECT,)
        expected = "endpoints such as tcp/router:7447, comma separated"
        self.findings += [Finding(name, endpoint, expected) for endpoint in endpoints if "/" not in endpoint]
        return endpoints

    def directory(self, name: str) -> Path | None:
        """A directory that exists."""
        text = self.text(name)
        if text and not Path(text).is_dir():
            self.findings.append(Finding(name, text, "a directory, such as a mounted Secret"))
        return Path(text) if text else None

    def port(self, name: str, default: int) -> int:
        """A TCP port."""
        return self.whole(name, default, most=65535, expected="a port from 1 to 65535")

    def whole(self, name: str, default: int, *, most: int, expected: str) -> int:
        """An integer from 1 to `most`."""
        text = self.text(name, str(default))
        if text.isdecimal() and 0 < int(text) <= most:
            return int(text)
        self.findings.append(Finding(name, text, expected))
        return default

    def pair(self, name: str, expected: str) -> tuple[str, str] | None:
        """Two words with a slash between them."""
        text = self.text(name)
        first, _, second = text.partition("/")
        if text and not (first and second and "/" not in second):
            self.findings.append(Finding(name, text, expected))
        return (first, second) if text else None

    def word(self, name: str, allowed: tuple[str, ...], default: str) -> str:
        """One of several words, in any case."""
        text = self.text(name, default).lower()
        if text not in allowed:
            self.findings.append(Finding(name, text, "one of " + ", ".join(allowed)))
        return text
