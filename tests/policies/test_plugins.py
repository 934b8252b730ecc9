from __future__ import annotations

import pytest

from contextpolicy.errors import PolicyError
from contextpolicy.policies import plugins
from contextpolicy.policies.plugins import load
from tests.planning.builders import a_policy, a_stream, a_task


class Entry:
    """An installed entry point."""

    def __init__(self, name, function=None, error=None):
        self.name, self._function, self._error = name, function, error

    def load(self):
        if self._error:
            raise self._error
        return self._function


@pytest.fixture
def installed(monkeypatch):
    entries: list[object] = []
    monkeypatch.setattr(plugins, "entry_points", lambda group: entries if group == plugins.GROUP else [])
    return entries


def policy_with(*names):
    tasks = [a_task(f"t{n}", activity=[{"initiative": name}]) for n, name in enumerate(names)]
    return a_policy(streams=[a_stream("imu")], tasks=tasks)


def test_a_policy_without_plugged_in_functions_loads_none(installed):
    installed.append(Entry("bumps", error=ImportError("never asked for")))
    assert load(a_policy(streams=[a_stream("imu")], tasks=[a_task("slam")])) == {}


def test_functions_are_found_by_name(installed):
    installed += [Entry("bumps", print), Entry("turns", len), Entry("other")]
    assert load(policy_with("bumps", "turns", "bumps")) == {"bumps": print, "turns": len}


def test_functions_that_are_not_installed_are_named_all_at_once(installed):
    installed += [Entry("bumps", print), Entry("turns", len)]
    with pytest.raises(PolicyError) as caught:
        load(policy_with("bumps", "dumps", "burns"))
    assert [(f.field, f.value, f.allowed) for f in caught.value.findings] == [
        ("spec.tasks[t1].activity.initiative", "dumps", "expected an installed function: bumps, turns"),
        ("spec.tasks[t2].activity.initiative", "burns", "expected an installed function: bumps, turns"),
    ]


@pytest.mark.usefixtures("installed")
def test_missing_plug_ins_are_reported():
    with pytest.raises(PolicyError, match="expected an installed function: there is none"):
        load(policy_with("bumps"))


@pytest.mark.parametrize("error", [ImportError("no numpy"), AttributeError("gone"), RuntimeError("at import")])
def test_a_plug_in_import_error_is_a_policy_error(installed, error):
    installed.append(Entry("bumps", error=error))
    with pytest.raises(PolicyError, match=f"{type(error).__name__}: {error}"):
        load(policy_with("bumps"))
