"""No component assigns a callable onto another object."""

from __future__ import annotations

import ast

import pytest

from tests.architecture.patching import known, patched_on
from tests.architecture.source_code import PACKAGE

OBSERVER = "class Observer(Protocol): pass\n"
SHADOWS = "class Shadows:\n    def __init__(self): pass\n    def settle(self): pass\n"
HOLDER = f"{SHADOWS}class A:\n    def __init__(self): self.shadows: Shadows | None = None\n"
ALLOWED = {"entry.runner", "aiohttp.ClientResponse.json"}
"""A component that a record lists and never calls, and the decoder of kopf, which has no setting for it."""
NAMES = known(*(ast.parse(path.read_text(encoding="utf-8")) for path in PACKAGE.glob("**/*.py")))


@pytest.mark.parametrize("path", sorted(PACKAGE.glob("**/*.py")), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_collaborators_come_through_constructors(path):
    assert set(patched_on(path.read_text(encoding="utf-8"), NAMES)) <= ALLOWED


@pytest.mark.parametrize(
    ("planted", "found"),
    [
        ("runner.on_change = lambda: None", ["runner.on_change"]),
        ("made.signer, made.may_act = signer, lambda: True", ["made.may_act"]),
        ("def wake(): pass\nself.watch.on_refused = wake", ["self.watch.on_refused"]),
        ("class A:\n    def settle(self): pass\npromoter.on_change = self.policies.settle", ["promoter.on_change"]),
        ("x.board = partial(show, 1)", ["x.board"]),
        ("self.on_change: Callable[[], None] = lambda: None", ["self.on_change"]),
        ("self._on_change: Callable[[], None] = on_change", []),
        ("self._on_change = on_change", []),
        ("entry.runner = PolicyRunner(policy)", []),
        ("class A:\n    @property\n    def body(self): pass\nentry.body = body", []),
        ("def wire(watch, on_change):\n    watch.on_refused = on_change", ["watch.on_refused"]),
        ("def wire(watch, wake: Callable[[], None]):\n    watch.refused = wake", ["watch.refused"]),
        ("wake = lambda: None\nwatch.refused = wake", ["watch.refused"]),
        ("async def wake(): pass\nwatch.refused = wake", ["watch.refused"]),
        ("watch.on_refused = Waker()", ["watch.on_refused"]),
        ("watch.on_refused = None", ["watch.on_refused"]),
        ("for watch.on_refused in wakers: pass", ["watch.on_refused"]),
        ("watch.on_refused, *others = wakers", ["watch.on_refused"]),
        ("[watch.refused, b] = [lambda: None, 2]", ["watch.refused"]),
        ("watch.refused = wake or (lambda: None)", ["watch.refused"]),
        ("watch.refused = (lambda: None) if quiet else None", ["watch.refused"]),
        ("watch.handlers['refused'] = lambda: None", ["watch.handlers['refused']"]),
        ("setattr(watch, 'refused', x)", ["setattr(watch, 'refused', x)"]),
        ("object.__setattr__(self.watch, 'refused', x)", ["object.__setattr__(self.watch, 'refused', x)"]),
        ("class A:\n    def __init__(self, refused: Callable[[], None]): pass\nwatch.refused = x", ["watch.refused"]),
        ("class A:\n    def f(self):\n        self._refused: Callable[[], None] = x\nb._refused = y", ["b._refused"]),
        ("vars(watch).update(refused=x)", ["vars(watch)"]),
        ("vars(self.watch)['refused'] = x", ["vars(self.watch)"]),
        ("watch.__dict__.update(refused=x)", ["watch.__dict__"]),
        ("watch.__dict__['refused'] = x", ["watch.__dict__"]),
        ("class A:\n    def listen(self, wake: Callable[[], None]):\n        self._wake = wake", ["self._wake"]),
        ("class A:\n    def f(self, x: Callable[[], None]):\n        'Wakes.'\n        self._wake = x", ["self._wake"]),
        ("class A:\n    def listen(self, *, wake: 'Callable[[], None]'): self._a, self._b = 1, wake", ["self._b"]),
        ("self.on_change = lambda: None", ["self.on_change"]),
        ("self.on_change: Optional[Callable[[], None]] = None", ["self.on_change"]),
        ("self.on_change: None | Callable[[], None] = None", ["self.on_change"]),
        ("self.on_change: 'Callable[[], None] | None' = None", ["self.on_change"]),
        ("self.on_change: typing.Callable[[], None]", ["self.on_change"]),
        ("Listener: TypeAlias = 'Callable[[], None]'\nself.on_change: Listener = x", ["self.on_change"]),
        ("Listener = Callable[[], None]\nclass A:\n    on_change: Listener", ["on_change"]),
        ("class A:\n    on_change: Callable[[], None]", ["on_change"]),
        ("class A:\n    on_change = lambda: None", ["on_change"]),
        ("@dataclass\nclass A:\n    on_change: Callable[[], None] = lambda: None", ["on_change"]),
        ("@dataclass(frozen=True)\nclass A:\n    on_change: Callable[[], None] = lambda: None", ["on_change"]),
        ("@dataclass\nclass A:\n    on_change: Callable[[], None] | None = None", ["on_change"]),
        ("@dataclass\nclass A:\n    run: Callable[[], None]\nself.row.run = x", ["self.row.run"]),
        ("@dataclass(frozen=True)\nclass A:\n    run: Callable[[], None] | None = None\nself.publisher.run = 1", []),
        ("@dataclass\nclass A:\n    run: Callable[[], None]", []),
        ("class A:\n    _run: Callable[[], None]", []),
        ("self.handlers: dict[str, Callable[[], None]] = {}", []),
        ("def wire(watch, on_change): self.on_change = on_change", []),
        ("self._handlers['refused'] = lambda: None", []),
        ("class A:\n    def body(self): pass\nclass B:\n    body: str\nentry.text = b.body", []),
        ("object.__setattr__(self, 'refused', x)", []),
        ("vars(self).update(refused=x)\nprint(vars(watch)['refused'])", []),
        ("class A:\n    def __init__(self, wake: Callable[[], None]): self._wake = wake", []),
        ("class A:\n    def start(self, wake: Callable[[], None]):\n        self._wake = wake\n        wake()", []),
        ("class A:\n    def take(self, wake: float): self._wake = wake\n    def wake(self): pass", []),
        ("class A:\n    def f(self, wake: Callable[[], None]): self._a = other.wake", []),
        ("class A:\n    def f(self, wake: Callable[[], None]):\n        self._wakers.append(wake)", ["self._wakers"]),
        ("class A:\n    def f(self, x: Callable[[], None]):\n        if x: self._wake = x", ["self._wake"]),
        ("class A:\n    def listen(self, one: WakeListener): self._one = one", ["self._one"]),
        ("class A:\n    def listen(self, one: WakeListener):\n        self._one = one\n        go()", ["self._one"]),
        (f"{OBSERVER}class A:\n    def watch(self, x: Observer | None): self._x = x", ["self._x"]),
        (f"{OBSERVER}class A:\n    def __init__(self, seer: Observer): pass\na.seer = b", ["a.seer"]),
        (f"{OBSERVER}class A:\n    def __init__(self, seer: Observer): self._seer = seer", []),
        ("promoter.listener = self.publisher", ["promoter.listener"]),
        (f"{HOLDER}announcer.shadows = promoter", ["announcer.shadows"]),
        (f"{HOLDER}announcer.shadows = Shadows()", ["announcer.shadows"]),
        (f"{SHADOWS}class A:\n    def join(self, shadows: Shadows): self._shadows = shadows", ["self._shadows"]),
        (f"{SHADOWS}class A:\n    def _join(self, shadows: Shadows): self._shadows = shadows", []),
        ("class Kept:\n    def __init__(self): pass\nclass A:\n    kept: Kept\nb.kept = c", []),
        ("watch.wakers = [lambda: None]", ["watch.wakers"]),
        ("watch.wakers = {'refused': lambda: None}", ["watch.wakers"]),
        ("watch.wakers += [lambda: None]", ["watch.wakers"]),
        ("watch.refused, *watch.wakers = 1, lambda: None", ["watch.wakers"]),
        ("watch.refused = (wake := lambda: None)", ["watch.refused"]),
        ("watch.refused = partialmethod(wake)", ["watch.refused"]),
        ("watch.wakers.append(lambda: None)", ["watch.wakers"]),
        ("watch.wakers.extend([lambda: None])", ["watch.wakers"]),
        ("watch.wakers.update(refused=lambda: None)", ["watch.wakers"]),
        ("watch.wakers.setdefault('refused', lambda: None)", ["watch.wakers"]),
        ("self.wakers.append(lambda: None)", []),
        ("watch.names.append('refused')", []),
        ("builtins.setattr(watch, 'refused', x)", ["builtins.setattr(watch, 'refused', x)"]),
        ("watch.__setattr__('refused', x)", ["watch.__setattr__('refused', x)"]),
        ("self.publisher._listener = self", ["self.publisher._listener"]),
    ],
)
def test_a_callable_that_is_patched_on_is_found(planted, found):
    assert patched_on(planted, known()) == found
