"""The ROS 2 message types that streams may name, without a ROS installation."""

from __future__ import annotations

from functools import lru_cache
from threading import RLock
from typing import TYPE_CHECKING

from contextpolicy.errors import DefinitionError, Finding
from contextpolicy.policy.stream_spec import Encoding, RosRelease

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

    from contextpolicy.policy.definition_files import Definitions
    from contextpolicy.policy.spec import Policy
    from contextpolicy.policy.stream_spec import Stream

_LOADING = RLock()
"""Policies are loaded on several threads; stores are shared, and rosbags adds generated code to them without a lock."""


def type_store(release: RosRelease = RosRelease.LATEST, definitions: Definitions = ()) -> Typestore:
    """A release's messages plus custom `definitions`; loaded on first use, because they take megabytes.

    DefinitionError says what is wrong with the custom ones. May be called on any thread.
    """
    with _LOADING:
        return _type_store(release, definitions)


def store_of(stream: Stream) -> Typestore:
    """The message types that a stream may have; DefinitionError as for `type_store`."""
    return type_store(stream.ros, stream.definitions or ())


def is_known(type_name: str, store: Typestore | None = None) -> bool:
    """Whether there is a message of this type."""
    return type_name in (store or type_store()).fielddefs


def type_findings(policy: Policy) -> list[Finding]:
    """The streams whose ROS type can't be decoded; parsing cannot see it, as it knows no message definitions.

    Also generates their converters, which takes a tenth of a second, so that no sample waits for that.
    """
    found = (_finding(f"spec.streams[{index}]", stream) for index, stream in enumerate(policy.streams))
    return [finding for finding in found if finding is not None]


def _finding(path: str, stream: Stream) -> Finding | None:
    if stream.encoding is not Encoding.CDR or not stream.type:
        return None
    try:
        store = store_of(stream)
    except DefinitionError as error:
        return Finding(f"{path}.types", stream.types, f"valid message definitions; {error}")
    if not is_known(stream.type, store):
        if stream.types and stream.definitions is None:
            return None  # it may be in the ConfigMap, which has not been read
        own = f" or {stream.types}" if stream.types else "; types names a ConfigMap with further ones"
        return Finding(f"{path}.type", stream.type, f"a message of ROS 2 {stream.ros}{own}")
    with _LOADING:
        store.get_msgdef(stream.type)
    return None


@lru_cache(maxsize=16)
def _type_store(release: RosRelease, definitions: Definitions) -> Typestore:
    from rosbags.typesys import TypesysError  # noqa: PLC0415

    from contextpolicy.policy.message_definitions import check_references, parse  # noqa: PLC0415

    store = _standard(release)
    if not definitions:
        return store
    types = parse(definitions)
    check_references(types, store.fielddefs)
    try:
        store.register(types)
    except TypesysError as error:
        raise DefinitionError(f"ros: {release}: {error}") from error
    return store


def _standard(release: RosRelease) -> Typestore:
    """A new store, so that what is registered in it does not show up in others."""
    from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415

    if release is not RosRelease.LATEST:
        return get_typestore(Stores[f"ROS2_{release.name}"])
    store, older = get_typestore(Stores.ROS2_LYRICAL), get_typestore(Stores.ROS2_KILTED)
    for name in older.fielddefs.keys() - store.fielddefs.keys():  # removed from Lyrical, still used by robots
        store.fielddefs[name], store.types[name] = older.fielddefs[name], older.types[name]
    return store
