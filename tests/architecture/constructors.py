"""What constructors take: how a component notifies its collaborators."""

from __future__ import annotations

import ast

EFFECTS = {"None", "object", "NoReturn", "Any"}
"""What a callable returns that is called for what it does."""
TIME = {"wait"}
"""A clock is a function too: what lets time pass answers nothing."""


def bare_callbacks(source, aliases, protocols=frozenset()):
    """The parameters of constructors that are called for what they do, and the collaborators that may be missing.

    A collaborator is what is annotated with one of these protocols, or has a listener's name.
    """
    found = []
    for node in (node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.ClassDef)):
        for argument, default in _parameters(node):
            acts = _acts(argument.annotation, aliases) and argument.arg not in TIME
            if acts or _is_missing_at_times(argument.annotation, default, protocols):
                found.append(f"{node.name}({argument.arg})")
    return sorted(found)


def aliases_of(*sources):
    """The names that modules give to types, with the types."""
    found = {}
    for node in (node for source in sources for node in ast.walk(ast.parse(source))):
        match node:
            case ast.Assign(targets=[ast.Name(id=name)], value=ast.Subscript() as value):
                found[name] = value
            case ast.AnnAssign(target=ast.Name(id=name), annotation=ast.Name(id="TypeAlias"), value=value):
                found[name] = _unquoted(value)
    return found


def _parameters(node):
    """Of the constructor: of `__init__`, or the fields of a dataclass or named tuple; each with its default."""
    for one in node.body:
        match one:
            case ast.FunctionDef(name="__init__", args=arguments):
                positional = [*arguments.posonlyargs, *arguments.args][1:]
                absent = [None] * (len(positional) - len(arguments.defaults))
                yield from zip(positional, [*absent, *arguments.defaults], strict=True)
                yield from zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True)
            case ast.AnnAssign(target=ast.Name(id=name)) if node.decorator_list or node.bases:
                yield ast.arg(name, one.annotation), one.value


def _acts(annotation, aliases):
    """Whether it is a callable that answers nothing, also under another name, quoted, optional or in a container."""
    match _unquoted(annotation):
        case ast.Name(id=name) if name in aliases:
            return _acts(aliases[name], {})
        case ast.BinOp(left=left, right=right):
            return _acts(left, aliases) or _acts(right, aliases)
        case ast.Subscript(value=kind, slice=ast.Tuple(elts=[_, answer])) if ast.unparse(kind).endswith("Callable"):
            return ast.unparse(answer) in EFFECTS
        case ast.Subscript(value=kind) if ast.unparse(kind).endswith("Callable"):
            return False
        case ast.Subscript(slice=inner):
            return any(_acts(one, aliases) for one in getattr(inner, "elts", [inner]))
    return False


def _is_missing_at_times(annotation, default, protocols):
    """Whether it is a collaborator that need not be given."""
    names = named_in(annotation)
    return means_collaborator(annotation, protocols) and (default is not None or bool(names & {"None", "Optional"}))


def protocols_of(*trees):
    """The names of the protocols that some modules define."""
    classes = (node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.ClassDef))
    return frozenset(one.name for one in classes if any("Protocol" in named_in(base) for base in one.bases))


def means_collaborator(annotation, protocols):
    """Whether an annotation names one of the protocols, or a listener, itself or as one of a union."""
    match _unquoted(annotation):
        case ast.BinOp(left=left, right=right):
            return means_collaborator(left, protocols) or means_collaborator(right, protocols)
        case ast.Subscript(value=kind, slice=inner) if named_in(kind) & {"Optional", "Union"}:
            return any(means_collaborator(one, protocols) for one in getattr(inner, "elts", [inner]))
        case ast.Subscript(value=kind):
            return means_collaborator(kind, protocols)
        case ast.Name(id=name) | ast.Attribute(attr=name):
            return name in protocols or name.endswith("Listener")
    return False


def named_in(annotation):
    """All names in an annotation, with `None`."""
    nodes = list(ast.walk(_unquoted(annotation))) if annotation else []
    names = {getattr(node, "id", getattr(node, "attr", "")) for node in nodes}
    return names | {"None" for node in nodes if isinstance(node, ast.Constant) and node.value is None}


def _unquoted(annotation):
    match annotation:
        case ast.Constant(value=str(text)):
            return ast.parse(text, mode="eval").body
    return annotation
