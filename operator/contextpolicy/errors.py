"""Every error of contextpolicy.

ContextPolicyError
├── PolicyError         a policy breaks rules; carries every finding at once
├── TimelineError       a timeline file breaks rules; carries every finding at once
├── SettingsError       an environment variable or flag has an invalid value
├── DecodeError         a payload is not what its stream's encoding says
├── DefinitionError     unusable message definitions (.msg, .idl)
├── ExpressionError     a CEL expression failed on this sample
│   └── UndecidedError  it waits for a stream
├── ShareError          weights and bounds that no division can satisfy
├── ActuationError      an actuator could not make a plan real; says whether a retry helps
├── OrderError          a message on the decision bus that the node agent must not obey
├── ModuleFileError     a module.yaml that breaks rules; carries every finding at once (policy.module_file)
├── SigningKeyError     no key to sign plans with or to verify them
├── DocumentError       a file that is not YAML (validation.documents)
├── PolicyFileError     a file without a valid policy (validation.policy_file)
├── ExpectationError    invalid expectations (simulation.expectations)
├── DrawingError        a picture that cannot be drawn
└── NoAnswerError       nobody on the bus answers (commands.explain)
"""

from __future__ import annotations

from dataclasses import dataclass


class ContextPolicyError(Exception):
    """Base class: everything contextpolicy raises on purpose."""


MAX_VALUE = 200
"""Characters of a refused value that a message quotes."""


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
    """Invalid settings from the environment or the command line."""


class DecodeError(ContextPolicyError):
    """A payload that is not what its stream's encoding says; the sample is dropped and counted."""


class DefinitionError(ContextPolicyError):
    """Unusable definitions of ROS 2 messages; the message lists everything that is wrong with them."""


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

    `retriable` says whether the same request may succeed later, but not within `retry_after` seconds. `in_doubt` says
    that there was no usable answer: the request may have taken effect all the same.
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
    """An unforeseen exception as an outcome that is reported and retried."""
    return ActuationError("Unexpected", f"{type(error).__name__}: {error}", retriable=True, in_doubt=True)


class OrderError(ContextPolicyError):
    """The node agent refuses a message; refusals are counted by `reason`, a CamelCase word."""

    def __init__(self, reason: str, message: str) -> None:
        self.reason = reason
        super().__init__(message)


class SigningKeyError(ContextPolicyError):
    """There is no key to sign plans with or to verify them."""


class DrawingError(ContextPolicyError):
    """A picture that cannot be drawn."""


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= MAX_VALUE else f"{text[: MAX_VALUE - 3]}..."
