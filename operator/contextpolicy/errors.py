"""Every error of contextpolicy.

ContextPolicyError
├── PolicyError         a policy breaks rules; carries every finding at once
├── TimelineError       a timeline file breaks rules; carries every finding at once
├── SettingsError       an environment variable or flag has a value that makes no sense
├── DecodeError         a payload is not what its stream's encoding says
├── DefinitionError     message definitions (.msg, .idl) that can't be used
├── ExpressionError     a CEL expression failed on this sample
│   └── UndecidedError  it waits for a stream
├── ShareError          weights and bounds that no division can satisfy
├── ActuationError      an actuator could not make a plan real; says whether a retry helps
├── OrderError          a message on the decision bus that the node agent must not obey
├── ModuleFileError     a module.yaml that breaks rules; carries every finding at once (policy.module_file)
├── SigningKeyError     no key to sign plans with, or to check them by
├── DocumentError       a file that is no YAML (validation.documents)
├── PolicyFileError     a file that holds no valid policy (validation.policy_file)
├── ExpectationError    expectations that make no sense (simulation.expectations)
├── DrawingError        a picture that cannot be made
└── NoAnswerError       nobody on the bus answers (commands.explain)
"""

from __future__ import annotations

from dataclasses import dataclass


class ContextPolicyError(Exception):
    """Base class: everything contextpolicy raises on purpose."""


MAX_VALUE = 200
"""Characters of a refused value that a message repeats."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong: which field, what it holds, what is allowed."""

    field: str
    value: object
    allowed: str

    def __str__(self) -> str:
        return f"{self.field}: {_short(self.value)} is not allowed: {self.allowed}"


class FindingsError(ContextPolicyError):
    """An object with one or more bad fields; the message lists all of them."""

    def __init__(self, subject: str, findings: tuple[Finding, ...]) -> None:
        self.subject = subject
        self.findings = findings
        super().__init__("\n".join([f"{subject}:", *(f"  {finding}" for finding in findings)]))


class PolicyError(FindingsError):
    """A ContextPolicy that breaks rules."""


class TimelineError(FindingsError):
    """A timeline file that breaks rules."""


class SettingsError(FindingsError):
    """Settings from the environment or the command line that make no sense."""


class DecodeError(ContextPolicyError):
    """A payload that is not what its stream's encoding says; the sample is dropped and counted."""


class DefinitionError(ContextPolicyError):
    """Definitions of ROS 2 messages that can't be used; the message tells all that is wrong with them."""


class ExpressionError(ContextPolicyError):
    """A CEL expression that failed on this sample; it counts as false."""


class UndecidedError(ExpressionError):
    """A CEL expression that waits for `stream`: it was never heard, is silent, or a feature's window is empty."""

    def __init__(self, source: str, stream: str, reason: str) -> None:
        self.stream = stream
        super().__init__(f"{source}: {reason}")


class ShareError(ContextPolicyError):
    """Weights and bounds that no division can satisfy."""


class ActuationError(ContextPolicyError):
    """An actuator's refusal: `reason` is a CamelCase word for status and events.

    `retriable` says whether the same may succeed in a moment, `retry_after` for how many seconds it can't. `in_doubt`
    says that there was no usable answer: it may have been carried out all the same.
    """

    def __init__(
        self, reason: str, message: str, *, retriable: bool, retry_after: float = 0.0, in_doubt: bool = False
    ) -> None:
        self.reason = reason
        self.retriable = retriable
        self.retry_after = retry_after
        self.in_doubt = in_doubt
        super().__init__(message)


def unexpected(error: Exception) -> ActuationError:
    """What nobody foresaw, as an outcome that is told and tried again."""
    return ActuationError("Unexpected", f"{type(error).__name__}: {error}", retriable=True, in_doubt=True)


class OrderError(ContextPolicyError):
    """The node agent's refusal to obey: `reason` is a CamelCase word by which refusals are counted."""

    def __init__(self, reason: str, message: str) -> None:
        self.reason = reason
        super().__init__(message)


class SigningKeyError(ContextPolicyError):
    """There is no key to sign plans with, or to check them by."""


class DrawingError(ContextPolicyError):
    """A picture that cannot be made."""


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= MAX_VALUE else f"{text[: MAX_VALUE - 3]}..."
