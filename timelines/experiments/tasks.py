"""The tasks of a story's robot: those that its policy names. Each runs a module, and two may run the same one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from robotkit.module import load_module
from timelines.demo import deploy

if TYPE_CHECKING:
    from collections.abc import Mapping

    from robotkit.module import Module
    from timelines.experiments.stories import Story

MODULES = deploy.REPOSITORY / "modules"
SECOND: Mapping[str, Mapping[str, Any]] = yaml.safe_load(
    Path(__file__).with_name("values.yaml").read_text(encoding="utf-8")
)["modules"]
"""Tasks that run a module a second time, as values of the robot's chart."""
TASKS = (*deploy.TASKS, *SECOND)
"""All tasks that some story has."""


def tasks_of(story: Story) -> tuple[str, ...]:
    """The tasks that a story's policy names: its robot has no others."""
    document = yaml.safe_load(story.policy_file.read_text(encoding="utf-8"))
    return tuple(task["name"] for task in document["spec"]["tasks"])


def module(task: str) -> Module:
    """What a task's module.yaml says, with the keys that the task has instead."""
    own = SECOND.get(task, {})
    return load_module(MODULES / own.get("module", task) / "module.yaml", own.get("env"))


def inputs_of(task: str) -> dict[str, str]:
    """The key of each of a task's inputs."""
    return {name: entry.key for name, entry in module(task).inputs.items()}
