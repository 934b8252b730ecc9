from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from modules.lidar.rplidar import Capsule, Node
from modules.lidar.scan import BINS, HALF_BIN, RUN, CapsuleParser, NodeParser, Turns, ranges


def a_turn(*, step=1.0, distance=1000.0):
    count = round(360 / step)
    return [Node(index * step, distance, 15, start=index == 0) for index in range(count)]


def whole(turns, nodes):
    """The nodes of each turn that these complete."""
    return [turn.nodes for turn in turns.add(nodes)]


def wire(nodes):
    return b"".join(node.encode() for node in nodes)


@given(st.data())
def test_nodes_arrive_however_they_are_cut(data):
    nodes = a_turn(step=4.0)
    sent = wire(nodes)
    cut = data.draw(st.integers(0, len(sent)))
    parser = NodeParser()
    assert parser.feed(sent[:cut]) + parser.feed(sent[cut:]) == nodes
    assert parser.skipped == 0


@given(st.integers(1, 200), st.integers(1, 12), st.binary(max_size=12))
def test_after_lost_and_added_bytes_it_finds_the_nodes_again(at, lost, noise):
    nodes = a_turn(distance=2500.0) * 2
    sent = wire(nodes)
    parser = NodeParser()
    heard = parser.feed(sent[:at] + noise + sent[at + lost :])
    after = -(-(at + lost) // 5) + RUN
    assert heard[-(len(nodes) - after) :] == nodes[after:]
    false = [node for node in heard if node not in nodes]
    assert len(false) <= 2  # nodes have no checksum: the first ones after a gap may fit by chance


@given(st.binary(max_size=600))
def test_noise_is_discarded_without_an_error(noise):
    parser = NodeParser()
    parser.feed(noise)
    assert len(parser._buffer) < RUN * 5


def capsules(count):
    return [Capsule(index * 16.0 % 360, (1000 + index,) * 32, (0,) * 32, index == 0) for index in range(count)]


def test_nodes_are_delayed_by_one_capsule():
    parser = CapsuleParser()
    heard = [parser.feed(capsule.encode()) for capsule in capsules(3)]
    assert [len(nodes) for nodes in heard] == [0, 32, 32]
    assert heard[1][1].angle == 0.5


@given(st.integers(0, 83), st.integers(1, 90), st.binary(max_size=50))
def test_after_lost_and_added_bytes_it_finds_the_capsules_again(at, lost, noise):
    sent = b"".join(capsule.encode() for capsule in capsules(6))
    parser = CapsuleParser()
    heard = parser.feed(sent[:at] + noise + sent[at + lost :])
    assert heard[-64:] == CapsuleParser().feed(sent)[-64:]
    assert {node.distance for node in heard} <= {1000.0 + index for index in range(6)}


@given(st.binary(max_size=600))
def test_noise_is_not_a_capsule(noise):
    parser = CapsuleParser()
    parser.feed(noise)
    assert len(parser._buffer) < 84


def test_a_capsule_that_was_lost_does_not_stretch_its_neighbour():
    first, _, third, fourth = (capsule.encode() for capsule in capsules(4))
    damaged = bytes([first[0] ^ 1]) + first[1:]
    heard = CapsuleParser().feed(first + damaged + third + fourth)
    assert {node.distance for node in heard} == {1002.0}


def test_turns_begin_at_the_zero_angle_and_the_first_piece_is_left_out():
    turns = Turns()
    piece = a_turn()[200:]
    first, second = a_turn(distance=1000.0), a_turn(distance=2000.0)
    assert whole(turns, [*piece, *first]) == []
    assert whole(turns, second[:1]) == [first]


def test_a_scan_that_begins_with_a_start_mark_is_whole():
    turns = Turns()
    first = a_turn()
    assert whole(turns, [*first, a_turn()[0]]) == [first]


@pytest.mark.parametrize("hole", [slice(100, 130), slice(0, 30), slice(330, 360)])
def test_an_incomplete_turn_is_counted_and_dropped(hole):
    torn = a_turn()
    del torn[hole]
    turns = Turns()
    given = whole(turns, [*a_turn(), *torn, *a_turn(), *a_turn(), a_turn()[0]])
    assert given in ([a_turn()] * 3, [a_turn()] * 2)  # a hole at the zero angle spoils both of its turns
    assert turns.lost == 4 - len(given)


def test_jitter_at_the_zero_angle_makes_no_turn_of_its_own():
    jitter = [Node(0.1, 1, 1), Node(359.9, 1, 1), Node(0.3, 1, 1)]
    turns = Turns()
    assert len(turns.add([*a_turn(), *jitter, *a_turn()[1:], Node(0.0, 1, 1)])) == 2


def test_a_turn_counts_the_nodes_after_it():
    turns = Turns()
    added = turns.add([*a_turn(), *a_turn(step=2.0), *a_turn()[:50]])
    assert [(len(turn.nodes), turn.later) for turn in added] == [(360, 230), (180, 50)]


def test_turns_begin_at_the_front():
    (turn,) = Turns(front=90.5).add([*a_turn(), *a_turn()])
    assert [turn.nodes[at].angle for at in (0, 1, 358, 359)] == [91, 92, 89, 90]


@pytest.mark.parametrize("forward", [0.0, 90.0, -37.25])
def test_the_ranges_of_a_turn_that_begins_past_the_front_are_in_backward_order(forward):
    """So one stamp and one time between rays say when each was measured."""
    nodes = [Node(angle, 1000.0 + number, 15) for number, angle in enumerate([*range(360), *range(360)])]
    (turn,) = Turns(forward + HALF_BIN).add(nodes)
    found = ranges(turn.nodes, forward=forward)
    assert found == sorted(found, reverse=True)


def test_a_turn_in_which_bytes_are_missing_is_dropped():
    turns = Turns()
    turns.add(a_turn()[:200])
    turns.forget()
    assert turns.lost == 1
    assert whole(turns, [*a_turn()[200:], *a_turn(), a_turn()[0]]) == [a_turn()]


@pytest.mark.parametrize("parser", [NodeParser(), CapsuleParser()])
def test_a_parser_forgets_what_is_incomplete(parser):
    sent = wire(a_turn()) if isinstance(parser, NodeParser) else b"".join(each.encode() for each in capsules(3))
    parser.feed(sent[:-1])
    parser.forget()
    assert (len(parser._buffer), parser.held) == (0, 0)


def test_nodes_that_arrived_and_wait_are_counted():
    parser = CapsuleParser()
    for capsule in capsules(2):
        parser.feed(capsule.encode())
    assert parser.held == 32
    assert NodeParser().held == 0


def test_ranges_are_counter_clockwise_in_metres_and_the_nearest_wins():
    found = ranges([Node(90.0, 1500.0, 1), Node(90.2, 1400.0, 1), Node(0.0, 800.0, 1), Node(45.0, 0.0, 0)])
    assert found[270] == pytest.approx(1.4)
    assert found[0] == pytest.approx(0.8)
    assert sum(map(bool, found)) == 2


def test_a_lidar_that_is_mounted_askew_is_turned_ahead():
    assert ranges([Node(180.0, 1000.0, 1)], forward=180.0)[0] == 1.0


@given(st.lists(st.tuples(st.floats(0, 359.99), st.floats(0, 16000)), max_size=400), st.floats(-720, 720))
def test_any_turn_fits_into_the_bins(samples, forward):
    found = ranges([Node(angle, distance, 1) for angle, distance in samples], forward=forward)
    assert len(found) == BINS
    assert all(0 <= distance <= 16 for distance in found)
