"""A scenario -> its timeline: which inputs reach the robot when, each with its ground truth.

What a policy reads is in the file (so that the simulation needs no recording): readings that hold are one line with a
rate. What only modules read (pictures, sound, the raw IMU at 200 Hz) is named, and lies in the recording.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from timelines.datasets import corridor, euroc
from timelines.datasets.motion import GRAVITY
from timelines.datasets.readers import CHUNK_S
from timelines.scenarios import mission

if TYPE_CHECKING:
    from collections.abc import Iterator

    from timelines.datasets.motion import Motion
    from timelines.scenarios.scenario import Phase, Scenario

    Entry: TypeAlias = dict[str, Any]

IMU_RATE, LEVEL_RATE, SCAN_RATE, ORDER_RATE = 50, 10, 5.5, 4
"""Hz. Drive orders expire after 0.5 s, so they are repeated."""
MOVING_STEP, RESTING_STEP, SCAN_STEP = 0.5, 2.5, 1.0
"""Seconds for which a reading stays the same."""
QUIET, DRIVING, SPEAKING = 0.004, 0.02, (0.14, 0.18, 0.12)
"""Levels of the microphone, 0 to 1; voices take turns."""
WORD_S = 1.2
"""Seconds that a spoken command lasts."""
BEAMS, REACH = 36, 8.0
"""Ranges of a scan, and how far the lidar sees in m (paper V)."""
SEED = 7


def timeline(scenario: Scenario) -> dict[str, Any]:
    """The timeline's document."""
    return {
        "$schema": "schema.json",
        "name": scenario.name,
        "description": scenario.description,
        "duration": scenario.duration,
        "phases": [_phase(phase) for phase in scenario.phases],
        "inputs": [
            *_recordings(scenario),
            *_imu(scenario),
            *_level(scenario),
            *_scans(scenario),
            *(_mission(scenario) if scenario.has_mission else _drive(scenario)),
            *_arm(scenario),
        ],
    }


def _phase(phase: Phase) -> Entry:
    return {"name": phase.name, "from": phase.start, "to": phase.end, "truth": {"moving": phase.moves}}


def _recordings(scenario: Scenario) -> Iterator[Entry]:
    """What is played from recordings: the cameras, the microphone and the raw IMU."""
    name, whole = scenario.name, {"from": 0, "to": scenario.duration}
    poses = f"{name}/mav0/state_groundtruth_estimate0"
    stereo = {"key": "robot/camera/stereo", "encoding": "binary", **whole, "dataset": f"{name}/stereo"}
    yield {**stereo, "rate": scenario.camera_rate, "truth": {"poses": poses}}
    yield _side(scenario, "robot/camera/side", 0)
    if scenario.has_mission:
        yield _side(scenario, "robot/camera/left", round(0.5 / scenario.side_rate, 6))
    words = [{"at": said.at, "keyword": said.keyword} for said in scenario.script.utterances]
    sound = {"key": "robot/microphone", "encoding": "binary", **whole, "dataset": f"speech/{name}"}
    yield {**sound, "rate": 1 / CHUNK_S, "truth": words}
    raw = {"key": "robot/imu/raw", "encoding": "json", **whole, "dataset": f"{name}/imu"}
    yield {**raw, "rate": euroc.IMU_RATE, "truth": {"moving": [list(span) for span in scenario.motion.moving]}}


def _side(scenario: Scenario, key: str, start: float) -> Entry:
    """A side camera. There are the same plates on the left, and its camera takes its pictures between the other's."""
    plates = scenario.side_view.plates
    signs = [{"from": start + plate.at, "to": start + plate.until, "text": plate.text} for plate in plates]
    recorded = {"from": start, "to": scenario.duration, "dataset": f"signs/{scenario.name}"}
    return {"key": key, "encoding": "binary", **recorded, "rate": scenario.side_rate, "truth": {"signs": signs}}


def _imu(scenario: Scenario) -> Iterator[Entry]:
    """Rates, accelerations and speed, as a driver with wheel encoders reports them."""
    rng, motion = np.random.default_rng(SEED), scenario.motion
    for start, end, moving in _steps(motion, MOVING_STEP, RESTING_STEP):
        value = _moving(motion, start, end) if moving else _resting(rng)
        yield _held("robot/imu", start, end, IMU_RATE, value, {"moving": moving})


def _moving(motion: Motion, start: float, end: float) -> Entry:
    """The strength of what is felt in this stretch, with the signs of its middle: a mean would cancel the sway."""
    times = np.linspace(start, end, 51)
    felt = {"gyro": motion.gyro_at(times), "accel": motion.accelerations_at(times)}
    strong = {name: np.sqrt((rows**2).mean(axis=0)) * np.sign(rows[25]) for name, rows in felt.items()}
    rounded = {name: [round(float(number), 3) + 0.0 for number in row] for name, row in strong.items()}
    return {**rounded, "speed": round(float(motion.speed_at(times).mean()), 3)}


def _resting(rng: np.random.Generator) -> Entry:
    gyro, accel = rng.normal(0, 0.002, 3), rng.normal(0, 0.02, 3) + GRAVITY
    return {"gyro": [round(float(n), 3) for n in gyro], "accel": [round(float(n), 2) for n in accel], "speed": 0.0}


def _level(scenario: Scenario) -> Iterator[Entry]:
    """How loud it is: quiet, wheels, or speech."""
    said = scenario.script.utterances
    edges = {at for one in said for at in (one.at, min(round(one.at + WORD_S, 6), scenario.duration))}
    edges |= {0.0, scenario.duration} | {at for span in scenario.motion.moving for at in span}
    ordered = sorted(edges)
    for start, end in pairwise(ordered):
        speaking = [index for index, one in enumerate(said) if one.at <= start < one.at + WORD_S - 1e-9]
        base = DRIVING if _moves(scenario.motion, start) else QUIET
        level = SPEAKING[speaking[-1] % len(SPEAKING)] if speaking else base
        yield _held("robot/microphone/level", start, end, LEVEL_RATE, {"level": level}, {"speech": bool(speaking)})


def _scans(scenario: Scenario) -> Iterator[Entry]:
    """What a lidar sees of the corridor's walls."""
    motion = scenario.motion
    ahead = float(motion.positions_at(np.array([scenario.duration]))[0, 0]) + euroc.BEYOND
    for start, end, moving in _steps(motion, SCAN_STEP, math.inf):
        middle = np.array([(start + end) / 2])
        place, heading = motion.positions_at(middle)[0], float(motion.angles_at(middle)[0][0])
        value = {"ranges": _ranges(float(place[0]), float(place[1]), heading, ahead)}
        yield _held("robot/lidar/scan", start, _last_scan(start, end), SCAN_RATE, value, {"moving": moving})


def _last_scan(start: float, end: float) -> float:
    """The end of a reading, or before its last scan where the next reading's first would follow that at once."""
    turn = 1 / SCAN_RATE
    return end if (end - start) % turn > turn / 4 else round(end - turn / 4, 6)


def _ranges(x: float, y: float, heading: float, ahead: float) -> list[float]:
    """Distances to the walls in m, counter-clockwise from straight ahead; 0 where nothing is in reach."""
    ranges = []
    for beam in range(BEAMS):
        angle = heading + 2 * math.pi * beam / BEAMS
        along, across = math.cos(angle), math.sin(angle)
        end, side = (ahead if along > 0 else corridor.LOW[0]), (corridor.HIGH_SIDE if across > 0 else corridor.LOW[1])
        nearest = min(gap / part for gap, part in ((end - x, along), (side - y, across)) if abs(part) > 1e-9)
        ranges.append(round(nearest, 2) if nearest <= REACH else 0.0)
    return ranges


def _drive(scenario: Scenario) -> Iterator[Entry]:
    """Orders of a person who drives the robot by hand."""
    order = {"drive": {"forward": scenario.speed, "turn": 0.0}}
    for start, end in scenario.motion.moving:
        yield _held("robot/navigation/order", start, end, ORDER_RATE, order, {"doing": "driving"})
        yield _once("robot/navigation/order", end, {"stop": True}, {"doing": "stopped"})


def _mission(scenario: Scenario) -> Iterator[Entry]:
    """No orders for the wheels: who hears the mission makes them of poses and commands, as the tasks find them."""
    for phase in scenario.phases:
        value = {"does": phase.does, "forward": scenario.speed if phase.moves else 0.0}
        yield _held(mission.KEY, phase.start, phase.end, mission.RATE, value, {"does": phase.does})


def _arm(scenario: Scenario) -> Iterator[Entry]:
    for phase in scenario.phases:
        yield from _followed(phase)
        for order in phase.arm:
            truth = {"doing": next((ended for name, ended in _ENDS.items() if name in order.order), "arrived")}
            yield _once("robot/arm/order", order.at, order.order, truth)


def _followed(phase: Phase) -> Iterator[Entry]:
    """A camera's orders to follow something that circles slowly, inside of the arm's reach.

    The camera knows of no phases: on average its first picture comes half a period after one has begun.
    """
    for index in range(math.ceil((phase.end - phase.start) * phase.follows - 1e-9)):
        at = (index + 0.5) / phase.follows
        place = [round(150 + 8 * math.cos(at), 1), round(20 * math.sin(at), 1), 50.0]
        yield _once("robot/arm/order", round(phase.start + at, 6), {"move": place}, {"follows": True})


_ENDS = {"stop": "stopped", "relax": "relaxed"}
"""What the arm does in the end, unless it arrives."""


def _steps(motion: Motion, moving: float, resting: float) -> Iterator[tuple[float, float, bool]]:
    """Stretches of at most these lengths, and whether the robot moves in them."""
    edges = sorted({0.0, motion.duration, *(at for span in motion.moving for at in span)})
    for start, end in pairwise(edges):
        moves = _moves(motion, start)
        count = max(1, math.ceil((end - start) / (moving if moves else resting) - 1e-9))
        cuts = [round(start + (end - start) * index / count, 6) for index in range(count + 1)]
        yield from ((low, high, moves) for low, high in pairwise(cuts))


def _moves(motion: Motion, at: float) -> bool:
    return any(start <= at < end for start, end in motion.moving)


def _held(key: str, start: float, end: float, rate: float, value: Entry, truth: Entry) -> Entry:  # noqa: PLR0913, PLR0917 - an entry's fields in order
    return {"key": key, "encoding": "json", "from": start, "to": end, "rate": rate, "value": value, "truth": truth}


def _once(key: str, at: float, value: Entry, truth: Entry) -> Entry:
    return {"key": key, "encoding": "json", "at": at, "value": value, "truth": truth}
