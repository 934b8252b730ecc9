"""Words of the dictionary that sound like a command."""

from __future__ import annotations

import pytest

from modules.speech.confusable import COMMANDS, confusable, dictionary, holds_command
from modules.speech.keywords import KEYWORDS


def test_every_keyword_has_the_phones_of_the_dictionary():
    words, phones = dictionary()
    known = dict(zip(words, phones, strict=True))
    assert {keyword: " ".join(known[keyword]) for keyword in KEYWORDS} == COMMANDS


@pytest.mark.parametrize(
    ("command", "alike"),
    [("forward", "shoreward"), ("backward", "backwoods"), ("left", "laughed"), ("right", "ride"), ("stop", "stapp")],
)
def test_similar_sounding_words_come_first(command, alike):
    found = confusable(command, 300)
    assert alike in found
    assert not {"zebra", "music"} & set(found)


@pytest.mark.parametrize("command", COMMANDS)
def test_no_word_holds_the_command_itself(command):
    assert not [word for word in confusable(command, 300) if holds_command(word)]


@pytest.mark.parametrize("word", ["stopped", "copyright", "leftist", "forwarded"])
def test_a_command_inside_another_word_is_found(word):
    assert holds_command(word)


@pytest.mark.parametrize("word", ["stock", "light", "ward", "lift"])
def test_similar_words_do_not_contain_a_command(word):
    assert not holds_command(word)
