"""ATE and RPE, against cases that are known and against the evo package."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

from modules.slam.geometry import quaternion, transform
from modules.slam.trajectory import associate, trajectory
from modules.slam.trajectory_error import absolute_errors, align, end_drift, relative_errors, statistics

TURN = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
PATH = np.array([[0, 0, 0], [1, 0, 0], [1, 2, 0], [1, 2, 3], [4, 2, 3]], dtype=float)


def upright(positions):
    return trajectory((index, (*place, 0, 0, 0, 1)) for index, place in enumerate(positions))


def rmse(estimated, truth):
    return statistics(absolute_errors(upright(estimated), upright(truth)))["rmse"]


def wandering(seed, noise=0.0):
    """A path with turns, at 20 Hz; with noise it drifts."""
    rng, other = np.random.default_rng(seed), np.random.default_rng(seed + 1)
    pose, rows = np.eye(4), []
    for index in range(200):
        rows.append((1_000_000_000 + index * 50_000_000, (*pose[:3, 3], *quaternion(pose[:3, :3]))))
        turned = rng.normal(0, 0.05, 3) + other.normal(0, noise, 3)
        angle = np.linalg.norm(turned)
        x, y, z = turned / angle
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        rotation = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
        pose = pose @ transform(rotation, np.array([0.1, 0, 0]) + other.normal(0, noise, 3))
    return trajectory(rows)


def test_a_turned_and_shifted_copy_has_no_error():
    assert rmse(PATH @ TURN.T + (5, 6, 7), PATH) == pytest.approx(0, abs=1e-9)
    assert align(PATH, PATH @ TURN.T + (5, 6, 7)) == pytest.approx(transform(TURN, np.array([5.0, 6, 7])))


def test_mirroring_and_scaling_count_as_errors():
    assert rmse(PATH * (1, 1, -1), PATH) > 0.1
    assert rmse(PATH * 1.1, PATH) > 0.1


def test_the_drift_of_the_end_is_that_since_the_first_pose():
    assert end_drift(upright(PATH + 7), upright(PATH)) == pytest.approx(0)
    assert end_drift(upright([*PATH[:-1], [4, 2, 3.5]]), upright(PATH)) == pytest.approx(0.5)


@pytest.mark.filterwarnings("ignore")  # evo's, and those of what it brings along
def test_errors_match_evo():
    from evo.core import metrics, sync  # noqa: PLC0415 - slow, and it warns
    from evo.core.trajectory import PoseTrajectory3D  # noqa: PLC0415

    def theirs(ours):
        turned = np.roll(ours.orientations, 1, axis=1)
        return PoseTrajectory3D(ours.positions.copy(), turned, ours.stamps / 1e9)

    truth, poses = wandering(1), wandering(1, noise=0.004)
    poses = poses.at(np.arange(3, 190, 2))
    reference, estimate = sync.associate_trajectories(theirs(truth), theirs(poses))
    estimated, true = associate(poses, truth)
    assert len(estimated) == estimate.num_poses
    units: dict[Literal["frames", "metres"], float] = {"frames": 3, "metres": 1.0}
    for unit, delta in units.items():
        their_unit = {"frames": metrics.Unit.frames, "metres": metrics.Unit.meters}[unit]
        relations = (metrics.PoseRelation.translation_part, metrics.PoseRelation.rotation_angle_deg)
        for relation, errors in zip(relations, relative_errors(estimated, true, delta, unit), strict=True):
            rpe = metrics.RPE(relation, delta, their_unit)
            rpe.process_data((reference, estimate))
            assert statistics(errors) == pytest.approx(
                {name: rpe.get_all_statistics()[name] for name in statistics(errors)}
            )
    estimate.align(reference)
    ape = metrics.APE(metrics.PoseRelation.translation_part)
    ape.process_data((reference, estimate))
    ours = statistics(absolute_errors(estimated, true))
    assert ours["rmse"] > 0.01
    assert ours == pytest.approx({name: ape.get_all_statistics()[name] for name in ours})
