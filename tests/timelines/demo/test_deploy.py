"""What the demo installs is what its verdict expects."""

from __future__ import annotations

from timelines.demo import deploy, verdict


def test_the_api_follows_the_agent_before_the_verdict_expects_it(monkeypatch):
    """The chart's default is longer than the demo's plans last: nothing would be in the API."""
    said: list[str] = []

    def run(*words, **_):
        said.extend(words)
        return ""

    monkeypatch.setattr(deploy, "run", run)
    monkeypatch.setattr(deploy, "_pod_logs", lambda: "/var/log/pods")
    monkeypatch.setattr(deploy, "free_address", lambda: "10.43.7.47")
    monkeypatch.setattr(deploy, "install_robot", lambda *_, **__: None)
    list(deploy.up(agent=True))
    assert f"agent.settleSeconds={deploy.SETTLE:g}" in said
    assert deploy.SETTLE < verdict.PATCHED
