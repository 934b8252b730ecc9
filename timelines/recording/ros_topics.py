"""What `ros2 bag` would say of what is on the bus: a topic's name, its type with definition and hash, its QoS."""

from __future__ import annotations

import json
import re
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from contextpolicy.policy.ros_types import is_known, type_store
from contextpolicy.policy.stream_spec import RosRelease
from contextpolicy.streams.recorded_message import Topic

if TYPE_CHECKING:
    from collections.abc import Mapping

RELEASES = (RosRelease.LATEST, RosRelease.KILTED, RosRelease.JAZZY, RosRelease.HUMBLE)
RIHS = "RIHS01_"
"""How the hash of a type begins (REP 2016)."""
_KEY = re.compile(r"\d+/(?P<name>.+)/(?P<package>\w+)::msg::dds_::(?P<type>\w+)_(?:/(?P<hash>[^/]+))?")


class RosTopics:
    """Finds the topic of a key; `known` has those with more details than their key gives."""

    def __init__(self, known: Mapping[str, Topic] | None = None) -> None:
        self._known = dict(known or {})
        self._offers: dict[str, list[dict[str, Any]]] = {}

    def offer(self, name: str, profile: Mapping[str, Any]) -> None:
        """Note the QoS that a publisher of a topic offers."""
        profiles = self._offers.setdefault(name, [])
        if profile not in profiles:
            profiles.append(dict(profile))

    def of(self, key: str) -> Topic | None:
        """The topic that is published on a key; None if it is none of ROS."""
        if key not in self._known:
            found = _of_key(key)
            if found is None:
                return None
            self._known[key] = found
        topic = self._known[key]
        offers = self._offers.get(topic.name)
        return topic._replace(qos=json.dumps(offers)) if offers and not topic.qos else topic


def topic_name(key: str) -> str:
    """The name of the topic that is published on a key of rmw_zenoh or of zenoh-bridge-ros2dds."""
    found = _KEY.fullmatch(key)
    return f"/{found['name'] if found else key}"


def completed(topic: Topic) -> Topic:
    """With the definition and the hash of a type that a release of ROS has, if the topic lacks them."""
    if topic.definition and topic.hash:
        return topic
    known = topic.hash if topic.hash.startswith(RIHS) else ""
    if topic.definition:
        return topic._replace(hash=known or _hash(topic.type, topic.definition))
    definition, type_hash = _definition(topic.type, known)
    return topic._replace(definition=definition, hash=type_hash)


def _of_key(key: str) -> Topic | None:
    found = _KEY.fullmatch(key)
    if found is None:
        return None
    type_hash = found["hash"] if (found["hash"] or "").startswith(RIHS) else ""
    return completed(Topic(f"/{found['name']}", "cdr", f"{found['package']}/msg/{found['type']}", 0, type_hash))


@lru_cache(maxsize=256)
def _hash(name: str, definition: str) -> str:
    """The hash of a type by its own definition; empty if that can't be read."""
    store = get_typestore(Stores.EMPTY)
    try:
        store.register(get_types_from_msg(definition, name))
        return store.hash_rihs01(name)
    except (TypesysError, KeyError):
        return ""


@lru_cache(maxsize=256)
def _definition(name: str, type_hash: str) -> tuple[str, str]:
    """The .msg text of a type with all that it contains, and its hash; of the release that has it with that hash.

    Both are empty, or only the text, for a type that no release has: a wrong definition would be worse than none.
    """
    for release in RELEASES:
        store = type_store(release)
        if is_known(name, store) and type_hash in ("", store.hash_rihs01(name)):
            return store.generate_msgdef(name, ros_version=2)[0], store.hash_rihs01(name)
    return "", type_hash
