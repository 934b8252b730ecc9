"""Callables that are assigned onto another object, where its constructor should take them."""

from __future__ import annotations

import ast
from dataclasses import dataclass

from tests.architecture.constructors import means_collaborator, protocols_of

OWN = {"self", "threading", "memo"}
"""A component's own attributes, `threading.excepthook`, which Python has for this, and what kopf's handlers share."""
ADD = {"append", "add", "appendleft", "insert"}
GIVE = ADD | {"extend", "update", "setdefault"}
SETTERS = {"setattr", "__setattr__"}
WRAPPERS = {"Optional", "Union", "Final", "ClassVar", "Annotated"}


@dataclass(frozen=True)
class Known:
    """The names that stand for callables."""

    functions: set[str]
    """Functions, methods and lambdas; not what some class has as a property or field under the same name."""
    slots: set[str]
    """Attributes that hold a callable, without their leading underscores."""
    types: set[str]
    """`Callable`, and what is an alias of it."""
    protocols: frozenset[str]
    """The types of collaborators: protocols, and classes that do something."""

    def __or__(self, other):
        return Known(
            self.functions | other.functions,
            self.slots | other.slots,
            self.types | other.types,
            self.protocols | other.protocols,
        )

    def is_given(self, annotation):
        """Whether an annotation means what a component notifies others with."""
        return means_callable(annotation, self.types) or means_collaborator(annotation, self.protocols)


def known(*trees):
    """What the text of some modules says of names."""
    nodes = [node for tree in trees for node in ast.walk(tree)]
    types = {"Callable"}.union(*(_aliases(node) for node in nodes))
    functions = set().union(*(_functions(node) for node in nodes))
    fields = {ast.unparse(one.target) for node in nodes if isinstance(node, ast.ClassDef) for one in _annotated(node)}
    protocols = protocols_of(*trees) | {one.name for one in nodes if isinstance(one, ast.ClassDef) and _acts(one)}
    slots = set().union(*(_slots(node, Known(set(), set(), types, protocols)) for node in nodes))
    return Known(functions - fields, slots, types, protocols)


def patched_on(source, package):
    """Every place where a callable or collaborator is assigned onto another object, or an attribute waits for that."""
    tree = ast.parse(source)
    own = known(tree)
    names = package | own
    callables = own.functions | _parameters(tree, lambda one: means_callable(one, names.types))
    found: set[ast.expr] = set()
    for node in ast.walk(tree):
        match node:
            case ast.Attribute(ctx=ast.Store()) if _is_foreign(node) and _is_slot(node.attr, names):
                found.add(node)
            case ast.Assign() | ast.AnnAssign():
                found |= _assigned(node, names, callables)
            case ast.AugAssign() | ast.Call():
                found |= _handed_over(node, names, callables)
            case ast.ClassDef():
                found |= _waiting_fields(node, names)
                found |= set().union(*(_set_only(method, names) for method in _methods(node)))
            case ast.Subscript(value=namespace, ctx=ast.Store()) if _is_foreign_namespace(namespace):
                found.add(namespace)
    return sorted({ast.unparse(node) for node in found})


def is_callable(value, own=frozenset(), methods=frozenset()):
    """Whether an expression may be a function: a lambda, a partial, the name of one, a method, or a choice of these."""
    match value:
        case ast.Call():
            return _last(value.func) in {"partial", "partialmethod"}
        case ast.BoolOp(values=parts) | ast.Dict(values=parts) | ast.List(elts=parts) | ast.Tuple(elts=parts):
            return any(is_callable(one, own, methods) for one in parts)
        case ast.IfExp():
            return is_callable(value.body, own, methods) or is_callable(value.orelse, own, methods)
        case ast.NamedExpr(value=inner):
            return is_callable(inner, own, methods)
    return isinstance(value, ast.Lambda) or _last(value) in (own if isinstance(value, ast.Name) else methods)


def means_callable(annotation, types):
    """Whether an annotation is `Callable`, also quoted, qualified, optional, or under another name."""
    match annotation:
        case ast.Constant(value=str(text)):
            return means_callable(ast.parse(text, mode="eval").body, types)
        case ast.BinOp():
            return means_callable(annotation.left, types) or means_callable(annotation.right, types)
        case ast.Subscript() if _last(annotation.value) in WRAPPERS:
            return any(means_callable(one, types) for one in getattr(annotation.slice, "elts", [annotation.slice]))
        case ast.Subscript():
            return means_callable(annotation.value, types)
    return _last(annotation) in types


def _handed_over(node, names, own):
    """What a call or an addition in place puts a callable into, or whose attribute it sets."""
    match node:
        case ast.Call(func=ast.Attribute(value=namespace, attr="update")) if _is_foreign_namespace(namespace):
            return {namespace}
        case ast.AugAssign(target=ast.Attribute() as held) if _is_foreign(held) and _holds(node, names, own):
            return {held}
        case ast.Call(func=ast.Attribute(value=ast.Attribute() as held, attr=attr)) if attr in GIVE:
            return {held} if _is_foreign(held) and _holds(node, names, own) else set()
        case ast.Call() if _last(node.func) in SETTERS and ast.unparse(_owner(node)) not in OWN:
            return {node}
    return set()


def _holds(node, names, own):
    """Whether a call or an addition in place hands over a callable."""
    given = [*node.args, *(one.value for one in node.keywords)] if isinstance(node, ast.Call) else [node.value]
    return any(is_callable(one, own, names.functions) for one in given)


def _owner(setter):
    """Whose attribute a call of `setattr`, `object.__setattr__` or `x.__setattr__` sets."""
    return setter.args[0] if len(setter.args) > 2 else setter.func.value


def _acts(node):
    """Whether a class is a component: it is made with what it needs, and has methods, unlike a record."""
    names = [one.name for one in _methods(node)]
    return "__init__" in names and len(names) > 1 and not node.decorator_list


def _last(node):
    """The last part of a dotted name; empty for anything else."""
    return getattr(node, "id", getattr(node, "attr", ""))


def _pairs(node):
    """What is assigned to what, tuples and lists taken apart."""
    for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
        if isinstance(target, ast.Tuple | ast.List) and isinstance(node.value, ast.Tuple | ast.List):
            for one, value in zip(target.elts, node.value.elts, strict=False):
                yield (one.value, node.value) if isinstance(one, ast.Starred) else (one, value)
        else:
            yield target, node.value


def _is_foreign(attribute):
    return ast.unparse(attribute.value) not in OWN


def _is_foreign_namespace(node):
    """Whether it is `vars(x)` or `x.__dict__` of another object."""
    match node:
        case ast.Call(func=ast.Name("vars"), args=[owner]) | ast.Attribute(value=owner, attr="__dict__"):
            return ast.unparse(owner) not in OWN
    return False


def _is_frozen(node):
    """Whether nothing can be assigned to what a class makes."""
    return any(
        "frozen=True" in ast.unparse(one) or _last(one) == "NamedTuple" for one in node.decorator_list + node.bases
    )


def _is_slot(name, names):
    own = name.lstrip("_")
    return own.startswith("on_") or own.endswith("listener") or own in names.slots


def _assigned(node, names, own):
    """The targets of an assignment that are another object's and get a callable, or are public and made for one."""
    found = set()
    annotated = isinstance(node, ast.AnnAssign) and means_callable(node.annotation, names.types)
    for target, value in _pairs(node):
        held = target
        while isinstance(held, ast.Subscript):
            held = held.value
        if not isinstance(held, ast.Attribute):
            continue
        patched = _is_foreign(held) and is_callable(value, own, names.functions)
        waits = held is target and not held.attr.startswith("_") and (annotated or is_callable(value))
        if patched or waits:
            found.add(target)
    return found


def _set_only(method, names):
    """The attributes in which a public method keeps what it was given to notify others with.

    A callable counts if the method does nothing but keep things; it may be what to do once. A collaborator always does.
    """
    if method.name.startswith("_"):
        return set()
    kept = list(_kept(method.body))
    only = len(kept) == _statements(method.body[ast.get_docstring(method) is not None :])
    reported = _parameters(method.args, names.is_given) if only else set()
    reported |= _parameters(method.args, lambda one: means_collaborator(one, names.protocols))
    return {
        target
        for pairs in kept
        for target, value in pairs
        if isinstance(target, ast.Attribute) and isinstance(value, ast.Name) and value.id in reported
    }


def _kept(body):
    """What each statement puts where, if it does only that; branches count as what is in them."""
    for one in body:
        match one:
            case ast.Assign() | ast.AnnAssign():
                yield list(_pairs(one))
            case ast.Expr(ast.Call(func=ast.Attribute(value=target, attr=attr), args=[*_, value])) if attr in ADD:
                yield [(target, value)]
            case ast.If():
                yield from _kept([*one.body, *one.orelse])


def _statements(body):
    return sum(_statements([*one.body, *one.orelse]) if isinstance(one, ast.If) else 1 for one in body)


def _waiting_fields(node, names):
    """The public fields of a class that hold a callable, unless it comes through the constructor of a dataclass.

    A default that is a function waits to be replaced. None does not where nothing can be assigned later: such a value
    is one of a table's rows that lacks its function.
    """
    is_dataclass = any("dataclass" in ast.unparse(one) for one in node.decorator_list)
    found = set()
    for statement in node.body:
        for target, value in _pairs(statement) if isinstance(statement, ast.Assign | ast.AnnAssign) else ():
            annotated = isinstance(statement, ast.AnnAssign) and means_callable(statement.annotation, names.types)
            waits = annotated and not _is_frozen(node) and not (is_dataclass and value is None)
            if not ast.unparse(target).startswith("_") and (waits or is_callable(value)):
                found.add(target)
    return found


def _methods(node):
    return [one for one in node.body if isinstance(one, ast.FunctionDef)]


def _annotated(node):
    return [one for one in node.body if isinstance(one, ast.AnnAssign)]


def _functions(node):
    match node:
        case ast.FunctionDef() | ast.AsyncFunctionDef():
            return {node.name} if not any("property" in ast.unparse(one) for one in node.decorator_list) else set()
        case ast.Assign(targets=[ast.Name(id=name)], value=ast.Lambda()):
            return {name}
    return set()


def _parameters(tree, is_meant):
    """The names of parameters whose annotation is meant."""
    arguments = (node for node in ast.walk(tree) if isinstance(node, ast.arg))
    return {one.arg for one in arguments if one.annotation and is_meant(one.annotation)}


def _aliases(node):
    match node:
        case ast.Assign(targets=[ast.Name(id=name)], value=ast.Subscript() as value):
            return {name} if means_callable(value, {"Callable"}) else set()
        case ast.AnnAssign(target=ast.Name(id=name), annotation=kind) if _last(kind) == "TypeAlias":
            return {name} if means_callable(node.value, {"Callable"}) else set()
    return set()


def _slots(node, names):
    """The attributes that a class keeps callables or collaborators in; those of frozen ones nobody can assign."""
    match node:
        case ast.FunctionDef(name="__init__"):
            return _parameters(node.args, names.is_given)
        case ast.AnnAssign(target=ast.Attribute(attr=name)) if names.is_given(node.annotation):
            return {name.lstrip("_")}
        case ast.ClassDef() if not _is_frozen(node):
            fields = _annotated(node)
            return {ast.unparse(one.target).lstrip("_") for one in fields if names.is_given(one.annotation)}
    return set()
