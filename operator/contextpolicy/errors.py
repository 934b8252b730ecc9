"""Every error of contextpolicy.

ContextPolicyError
├── PolicyError         an invalid policy; lists every finding
├── TimelineError       an invalid timeline file; lists every finding
├── SettingsError       an environment variable or flag with an invalid value
├── DecodeError         a payload that does not match its stream's encoding
├── DefinitionError     message definitions (.msg, .idl) that can't be used
├── ExpressionError     a CEL expression failed on this sample
│   └── UndecidedError  it can't be evaluated while a stream has no value
├── ShareError          weights and bounds that no division can satisfy
├── ActuationError      an actuator could not make a plan real; says whether a retry helps
├── OrderError          a message on the decision bus that the node agent must not obey
├── ModuleFileError     an invalid module.yaml; lists every finding (policy.module_file)
├── SigningKeyError     no key to sign or verify plans with
├── DocumentError       a file that is not valid YAML (validation.documents)
├── PolicyFileError     a file without a valid policy (validation.policy_file)
├── ExpectationError    invalid expectations (simulation.expectations)
├── RecordingError      a recording that can't be read (streams.recorded_message)
├── DrawingError        a diagram that can't be drawn
└── NoAnswerError       no reply on the bus (commands.explain)
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from enum import Enum, auto


class ContextPolicyError(Exception):
    """Base class: everything contextpolicy raises on purpose."""


MAX_VALUE = 200
"""Characters of a refused value that a message quotes at most."""


class Fault(Enum):
    """What is wrong, and so how a finding reads."""

    VALUE = auto()
    """The field's value, or that it is missing; `allowed` follows the word expected."""
    RULE = auto()
    """The same; `allowed` is a whole sentence."""
    FIELD = auto()
    """The field is unknown; `allowed` lists the known ones."""
    FILE = auto()
    """The whole file; `allowed` is all that the finding says."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong: which field, what it holds (None: nothing), what is allowed."""

    field: str
    value: object
    allowed: str
    fault: Fault = Fault.VALUE

    def __str__(self) -> str:
        return ": ".join(filter(None, (self.field, self.problem())))

    def problem(self, limit: int = MAX_VALUE) -> str:
        """What is wrong, without the field; the value is cut to `limit` characters."""
        what = "missing" if self.value is None else f"invalid value {_short(self.value, limit)}"
        match self.fault:
            case Fault.VALUE:
                return f"{what}: expected {self.allowed}"
            case Fault.RULE:
                return f"{what}: {self.allowed}"
            case Fault.FIELD:
                return f"unknown field: expected {self.allowed}"
            case Fault.FILE:
                return self.allowed


class FindingsError(ContextPolicyError):
    """An object with one or more bad fields; the message lists all of them."""

    def __init__(self, subject: str, findings: tuple[Finding, ...]) -> None:
        self.subject = subject
        self.findings = findings
        super().__init__("\n".join([f"{subject}:", *(f"  {finding}" for finding in findings)]))


class PolicyError(FindingsError):
    """An invalid ContextPolicy."""


class TimelineError(FindingsError):
    """An invalid timeline file."""


class SettingsError(FindingsError):
    """Invalid settings from the environment or the command line."""


class DecodeError(ContextPolicyError):
    """A payload that does not match its stream's encoding; the sample is dropped and counted."""


class DefinitionError(ContextPolicyError):
    """Definitions of ROS 2 messages that can't be used; the message lists every fault."""


class ExpressionError(ContextPolicyError):
    """A CEL expression that failed on this sample; it counts as false."""


class UndecidedError(ExpressionError):
    """A CEL expression that waits for `stream`, which was never heard, is silent, or has an empty feature window."""

    def __init__(self, source: str, stream: str, reason: str) -> None:
        self.stream = stream
        super().__init__(f"{source}: {reason}")


class ShareError(ContextPolicyError):
    """Weights and bounds that no division can satisfy."""


class ActuationError(ContextPolicyError):
    """An actuator's failure: `reason` is a CamelCase word for status and events.

    `retriable`: the same request may soon succeed, but not before `retry_after` seconds. `in_doubt`: no usable answer
    came, so the request may have been carried out all the same.
    """

    def __init__(
        self, reason: str, message: str, *, retriable: bool, retry_after: float = 0.0, in_doubt: bool = False
    ) -> None:
        self.reason = reason
        self.retriable = retriable
        self.retry_after = retry_after
        self.in_doubt = in_doubt
        super().__init__(message)


def unreadable(error: OSError | UnicodeError) -> str:
    """What a message says of a file that can't be read, after its path."""
    return f"cannot read file: {error.strerror if isinstance(error, OSError) else error}"


def unexpected(error: Exception) -> ActuationError:
    """Wrap an unforeseen exception, so that it is reported and retried like any other failure."""
    return ActuationError("Unexpected", f"{type(error).__name__}: {error}", retriable=True, in_doubt=True)


class OrderError(ContextPolicyError):
    """The node agent's refusal of a message: `reason` is a CamelCase word, the label under which refusals are counted.

    `signed` is when the operator signed the message, in ns since 1970, where only its age speaks against it.
    """

    def __init__(self, reason: str, message: str, *, signed: int | None = None) -> None:
        self.reason = reason
        self.signed = signed
        super().__init__(message)


class SigningKeyError(ContextPolicyError):
    """The key to sign or verify plans is missing."""


class DrawingError(ContextPolicyError):
    """A diagram that can't be drawn."""


def _short(value: object, limit: int) -> str:
    text = _written(value)
    return text if len(text) <= limit else f"{text[: limit - 3]}..."


def _written(value: object) -> str:
    """As the user's YAML has it, where Python would write `True` or `None`."""
    if not isinstance(value, bool | dict | list):
        return repr(value)
    try:
        return json.dumps(value, ensure_ascii=False, default=repr)
    except (TypeError, ValueError):  # a key that JSON does not know, or an alias of what holds it
        return repr(value)
