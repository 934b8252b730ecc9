"""One policy from one file, for the commands that need exactly one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from contextpolicy.errors import ContextPolicyError, unreadable
from contextpolicy.policy.validation.check import check
from contextpolicy.policy.validation.documents import read, text_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from contextpolicy.policy.definition_files import Definitions
    from contextpolicy.policy.spec import Policy


class PolicyFileError(ContextPolicyError):
    """A file that does not hold exactly one valid policy; the message is what `validate` prints."""


def load_policy(path: str, types: Definitions | None = None) -> Policy:
    """Read a policy as the API server would; `types` are the ROS 2 messages of ConfigMaps that are not in the file.

    Raises PolicyFileError.
    """
    try:
        with Path(path).open(encoding="utf-8") as file:
            text = text_of(file)
    except (OSError, UnicodeDecodeError) as error:
        raise PolicyFileError(f"{path}: {unreadable(error)}") from error
    report = check([(path, text)], types)
    if report.errors:
        raise PolicyFileError("\n".join(str(problem) for problem in report.errors))
    if not report.policies:
        raise PolicyFileError(f"{path}: no ContextPolicy found")
    if len(report.policies) != 1:
        names = ", ".join(policy.reference for _, policy in report.policies)
        raise PolicyFileError(f"{path}: contains {len(report.policies)} policies ({names}): expected one")
    return report.policies[0][1]


def load_resource(path: str) -> Mapping[str, Any]:
    """The one policy of a file that `load_policy` accepted, as it is written."""
    bodies = [document.body for document in read(Path(path).read_text(encoding="utf-8"))]
    listed = [item for body in bodies if isinstance(body, dict) for item in body.get("items", [body])]
    resource: Mapping[str, Any] = next(body for body in listed if body.get("kind") == "ContextPolicy")
    return resource
