"""All checks over all documents."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

from contextpolicy.errors import Finding, PolicyError
from contextpolicy.policy.custom_resource import API_VERSION
from contextpolicy.policy.definition_files import config_maps, with_definitions
from contextpolicy.policy.parsing import parse
from contextpolicy.policy.suggestions import did_you_mean
from contextpolicy.policy.validation import crd_rules, crd_schema
from contextpolicy.policy.validation.advice import advice
from contextpolicy.policy.validation.documents import Document, DocumentError, Position, read
from contextpolicy.policy.validation.mistakes import mistakes_in
from contextpolicy.policy.validation.overlaps import Overlap, overlaps
from contextpolicy.policy.validation.problem import MAX_SHOWN, Problem, Severity
from contextpolicy.policy.validation.workloads import probe_findings, workloads

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from contextpolicy.policy.definition_files import Definitions
    from contextpolicy.policy.spec import Policy

KIND = "ContextPolicy"


class Source(NamedTuple):
    """One object inside a file; `prefix` is its path in the document, for items of a List."""

    file: str
    document: Document
    body: dict[str, Any]
    prefix: str = ""

    def position(self, path: str, value: object = None) -> Position:
        """Where to report a finding: at the key or list item that its value names, if any, else at its field."""
        full = self.prefix + path
        if not isinstance(value, str):
            return self.document.position(full)
        if f"{full}.{value}" in self.document.positions:
            return self.document.positions[f"{full}.{value}"]
        named = [index for index, item in enumerate(_get(self.body, path)) if item.get("name") == value]
        return self.document.position(f"{full}[{named[-1]}]" if named else full)


@dataclass(slots=True)
class CheckReport:
    """What the files hold and what is wrong with them.

    `seen` counts policies, valid or not; `skipped` has a note for each object of another kind. `types` are the message
    definitions of streams whose ConfigMap is in none of the files, None if not given.
    """

    policies: list[tuple[Source, Policy]] = field(default_factory=list)
    problems: list[Problem] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)
    seen: int = 0
    types: Definitions | None = None
    config_maps: dict[tuple[str, str], Definitions] = field(default_factory=dict)

    @property
    def errors(self) -> list[Problem]:
        """The problems for which a file is refused."""
        return [problem for problem in self.problems if problem.severity is Severity.ERROR]


def check(files: Iterable[tuple[str, str]], types: Definitions | None = None) -> CheckReport:
    """Check (name, text) pairs; problems come in the order of the files."""
    report = CheckReport(types=types)
    documents: list[tuple[str, Document | DocumentError]] = []
    # All documents are read before any is checked: a ConfigMap may come after the policy that names it.
    for file, text in files:
        try:
            for document in read(text):
                documents.append((file, document))
                report.config_maps |= config_maps(document.body)
        except DocumentError as error:
            documents.append((file, error))
    for file, known in documents:
        if isinstance(known, DocumentError):
            report.problems.append(Problem(file, known.position, str(known)))
        else:
            _check_document(file, known, report)
    report.problems += _repeated(report)
    report.problems += [_claimed(report, overlap) for overlap in overlaps(_latest(report))]
    pods = [one for _, known in documents if isinstance(known, Document) for one in workloads(known.body)]
    report.problems += [
        _warning(source, finding) for source, policy in report.policies for finding in probe_findings(policy, pods)
    ]
    return report


def _check_document(file: str, document: Document, report: CheckReport) -> None:
    sources = list(_objects(file, document))
    if not sources and _means_policy(document.body):
        report.problems.append(Problem(file, document.position("kind"), _wrong_kind(document.body), field="kind"))
    elif not sources:
        report.skipped.append(f"{file}:{document.position('').line}: not a {KIND}: {_kind(document.body)}")
    for source in sources:
        report.seen += 1
        _check_object(source, report)


def _means_policy(body: object) -> bool:
    """Whether an object of another kind is probably a misspelt policy: skipping it would look like a pass."""
    if not isinstance(body, dict):
        return False
    group = str(body.get("apiVersion", "")).partition("/")[0]
    return group == API_VERSION.partition("/")[0] or bool(did_you_mean(body.get("kind"), [KIND]))


def _wrong_kind(body: dict[str, Any]) -> str:
    return Finding("kind", body.get("kind"), KIND).problem(MAX_SHOWN)


def _objects(file: str, document: Document) -> Iterator[Source]:
    body = document.body
    if not isinstance(body, dict):
        return
    if body.get("kind") == KIND:
        yield Source(file, document, body)
    elif isinstance(body.get("items"), list):
        for index, item in enumerate(body["items"]):
            if isinstance(item, dict) and item.get("kind") == KIND:
                yield Source(file, document, item, f"items[{index}].")


def _check_object(source: Source, report: CheckReport) -> None:
    findings = list(_duplicates(source))
    if source.body.get("apiVersion") != API_VERSION:
        findings.append(Finding("apiVersion", source.body.get("apiVersion"), API_VERSION))
    policy = None
    try:
        policy = _parse(source.body, report)
    except PolicyError as error:
        findings += error.findings
    findings += _of_the_definition(source.body, {finding.field for finding in findings})
    report.problems += _yes_and_no_keys(source)
    report.problems += sorted(
        (_refusal(source, finding) for finding in findings),
        key=lambda problem: (problem.position.line, problem.position.column),
    )
    # Advice takes a valid policy for granted; beside errors it would be noise.
    if policy is not None and not findings:
        report.problems += [_warning(source, finding) for finding in advice(policy)]
        report.policies.append((source, policy))


def _of_the_definition(body: dict[str, Any], reported: set[str]) -> list[Finding]:
    """What else the API server refuses, except in the fields that the parser has `reported` in better words."""
    schema = crd_schema.schema()
    stored = crd_schema.as_stored(body, schema)
    found = [finding for finding in crd_schema.findings(stored) if finding.field not in reported]
    return [*found, *crd_rules.findings(stored, schema, reported | {finding.field for finding in found})]


def _parse(body: dict[str, Any], report: CheckReport) -> Policy:
    """The operator's parser relies on metadata, which every object in the API has; a file may lack it."""
    if not isinstance(body.get("metadata"), dict):
        finding = Finding("metadata", body.get("metadata"), "an object with a name")
        raise PolicyError("", (finding,))

    def complete(policy: Policy) -> Policy:
        return with_definitions(policy, lambda name: report.config_maps.get((policy.namespace, name), report.types))

    return complete(parse(body, lambda policy: mistakes_in(complete(policy))))


def _duplicates(source: Source) -> Iterator[Finding]:
    for path in source.document.duplicates:
        if path.startswith(source.prefix):
            yield Finding(path.removeprefix(source.prefix), path.rpartition(".")[2], "each key once in an object")


def _repeated(report: CheckReport) -> Iterator[Problem]:
    """Policies of one name: an error within a file, a warning across files, which may be alternatives."""
    first: dict[str, Source] = {}
    for source, policy in report.policies:
        other = first.setdefault(policy.reference, source)
        if other is source:
            continue
        line = other.position("metadata.name").line
        message = f"{policy.reference} is also defined at {other.file}:{line}: of two with one name the last one wins"
        severity = Severity.ERROR if other.file == source.file else Severity.WARNING
        place = source.position("metadata.name")
        yield Problem(source.file, place, message, policy.name, "metadata.name", policy.name, severity=severity)


def _latest(report: CheckReport) -> list[Policy]:
    """The last policy of each name: the API never holds two editions of one policy at once."""
    return list({policy.reference: policy for _, policy in report.policies}.values())


def _claimed(report: CheckReport, overlap: Overlap) -> Problem:
    """An error if certain and within one file, else a warning: two files may be alternatives."""
    sources = {id(policy): source for source, policy in report.policies}
    earlier, later = overlap.earlier, overlap.later
    source, other = sources[id(later.policy)], sources[id(earlier.policy)]
    field = f"spec.tasks[{later.place}].selector"
    message = (
        f"task {later.task.name} {'claims' if overlap.certain else 'may claim'} container {later.task.container} of "
        f"the pods that task {earlier.task.name} of {earlier.policy.reference} ({other.file}) claims"
    )
    severity = Severity.ERROR if overlap.certain and source.file == other.file else Severity.WARNING
    return Problem(source.file, source.position(field), message, later.policy.name, field, severity=severity)


def _refusal(source: Source, finding: Finding) -> Problem:
    name = _name(source)
    place = source.position(finding.field, finding.value)
    message = f"{finding.problem(MAX_SHOWN)}{_yes_or_no(source, finding)}"
    return Problem(source.file, place, message, name, finding.field, finding.value, finding.allowed)


def _name(source: Source) -> str:
    metadata = source.body.get("metadata")
    return str(metadata.get("name", "")) if isinstance(metadata, dict) else ""


def _yes_or_no(source: Source, finding: Finding) -> str:
    """Why `name: y` is refused as true; empty for any other value."""
    word = source.document.yes_and_no.get(source.prefix + finding.field)
    return f"; YAML reads {word} as {str(finding.value).lower()}: put it in quotes" if word else ""


def _yes_and_no_keys(source: Source) -> Iterator[Problem]:
    """Keys that became true or false: a warning, since a label or a field of an example may have any name."""
    for path, word in source.document.yes_and_no_keys.items():
        if path.startswith(source.prefix):
            field = path.removeprefix(source.prefix)
            read = field.rpartition(".")[2]
            keys, them = ("keys", "them") if " and " in word else ("key", "it")
            message = f"YAML reads the {keys} {word} as {read}: put {them} in quotes"
            yield _warning(source, Finding(field, word, message))


def _warning(source: Source, finding: Finding) -> Problem:
    place, name = source.position(finding.field), _name(source)
    return Problem(source.file, place, finding.allowed, name, finding.field, finding.value, severity=Severity.WARNING)


def _get(body: Any, path: str) -> list[dict[str, Any]]:
    """The objects in the list at a path without indexes; empty if there is no list."""
    for name in path.split("."):
        body = body.get(name) if isinstance(body, dict) else None
    return [item for item in body if isinstance(item, dict)] if isinstance(body, list) else []


def _kind(body: object) -> str:
    kind = body.get("kind") if isinstance(body, dict) else None
    return f"kind {kind}" if kind else "not a Kubernetes object"
