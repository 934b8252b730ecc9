"""What each command's exit code means: one table, which `--help` of every command shows."""

from __future__ import annotations

OK, NO, FAILED = 0, 1, 2
INTERRUPTED = 130
"""128 + SIGINT."""
READER_GONE = 141
"""128 + SIGPIPE."""

WRITTEN = ("done", "written, but no operator serves the namespace: it takes effect once one does")
MODES = ("pause", "resume", "dry-run", "promote")

ANSWERS = {
    "COMMAND": ("success", "a negative result: each command's --help says which"),
    "status": ("every policy is Ready", "a policy is not Ready, or no operator serves it"),
    **dict.fromkeys(("force", *MODES), WRITTEN),
    "certificates": ("all are valid", "one in a robot's namespace could not be read or written; the others are valid"),
    "doctor": ("nothing is wrong", "something is wrong"),
    "why-not": ("explained", "the named context holds"),
    "restore": ("all containers are restored", "some are not restored: run it again"),
    "validate": ("all policies are valid (perhaps with warnings)", "a policy is invalid, or there is none"),
    "simulate": ("it ran, and all expectations hold", "an expectation does not hold"),
    "suggest": ("every task meets its goal with the patch, or without one", "a task does not meet its goal"),
    "skeleton": ("the policy is printed", "a module.yaml is invalid"),
    "agent": ("stopped by SIGTERM or SIGINT", "a thread failed, or another agent is running: start it again"),
    "agent-supervisor": ("nothing is left to undo", "something could not be undone: start it again"),
    "run": ("stopped by SIGTERM or SIGINT", "it failed: start it again"),
    "router": ("stopped by SIGTERM or SIGINT", None),
    "top": ("shown, or ended by Ctrl-C", None),
}
"""What 0 and 1 mean by command; None where there is no 1. Commands that are not named only succeed or fail."""


def described(command: str) -> str:
    """The exit codes of a command, as a paragraph of its help."""
    yes, no = ANSWERS.get(command, ("done", None))
    answers = f"0 {yes}; 1 {no}" if no else f"0 {yes}"
    return (
        f"exit codes: {answers}; {FAILED} it could not run (wrong usage, a file that can't be read or written, no "
        f"cluster, no permission, no answer); {INTERRUPTED} interrupted (128 + SIGINT); {READER_GONE} the output pipe "
        "was closed (128 + SIGPIPE)"
    )
