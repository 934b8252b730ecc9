"""One problem in a file."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from contextpolicy.policy.validation.documents import WHOLE_FILE

if TYPE_CHECKING:
    from contextpolicy.policy.validation.documents import Position


MAX_SHOWN = 80
"""Characters of a value that a line of output quotes at most."""


class Severity(StrEnum):
    """Whether the file is refused or only questionable."""

    ERROR = "error"
    WARNING = "warning"


@dataclass(frozen=True, slots=True)
class Problem:
    """A sentence with its place; `allowed` is None where the value itself is not the problem."""

    file: str
    position: Position
    message: str
    policy: str = ""
    field: str = ""
    value: object = None
    allowed: str | None = None
    severity: Severity = Severity.ERROR

    def __str__(self) -> str:
        """As compilers print it, so that editors can jump there."""
        field = f"{self.field}: " if self.field else ""
        place = self.file if self.position == WHOLE_FILE else f"{self.file}:{self.position.line}:{self.position.column}"
        return f"{place}: {self.severity}: {field}{self.message}"

    def as_json(self) -> dict[str, Any]:
        """JSON-serialisable, with `line` and `column` instead of `position`."""
        value = self.value if _is_plain(self.value) else short(self.value)
        fields = asdict(replace(self, value=value)) | asdict(self.position)
        del fields["position"]
        return fields


def short(value: object) -> str:
    """The value's repr, cut to MAX_SHOWN characters."""
    text = repr(value)
    return text if len(text) <= MAX_SHOWN else text[: MAX_SHOWN - 3] + "..."


def _is_plain(value: object) -> bool:
    return value is None or isinstance(value, str | int | float | bool)
