"""Speech to train on: commands and much else, said by Debian's voices with several sizes and speeds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from modules.speech.confusable import confusable, dictionary, holds_command
from modules.speech.keywords import KEYWORDS
from modules.speech.synthesis import ESPEAK, FESTIVAL_VOICES, speak

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    import numpy as np

    from modules.speech.spectrum import Samples

FLITE_VOICES = ("rms", "slt", "awb", "kal16", "kal")
ESPEAK_VOICES = tuple(
    f"{ESPEAK}{language}+{variant}"
    for language in ("en-us", "en-gb", "en-gb-scotland", "en-gb-x-rp")
    for variant in ("m1", "m3", "m7", "f2", "f4", "f5")
)
PHRASES = {
    "forward": ("forward", "forward", "go forward", "forward please"),
    "backward": ("backward", "backward", "go backward", "backward please"),
    "left": ("left", "left", "turn left", "left now"),
    "right": ("right", "right", "turn right", "right now"),
    "stop": ("stop", "stop", "please stop", "stop now"),
}
# Everyday words that sound like a command, or like a part of one, but hold none: these decide how many false alarms
# there are. The dictionary has many more, by `confusable`.
ALIKE = """
forty four ford for fort forget forest force former foreign ward word world awkward toward reward award afterward four
walls or what order warden forward-looking fourth sword board bored hardware shoreward wayward back backyard backed
bad word black bag packed bakery basket battery jackpot blackbird lackluster backpack lift laugh let leaf loft lest
less last loved leave felt elf shelf deaf theft led leg lend lunch level lettuce elephant letter lemon lectern gift
draft soft after lived laughed best rest west left-over yet met white light ride rice rat rate route root wrong try
rye wry ripe rise rhyme riot ray tried night kite bite fight sight height arrive around rabbit arrived might quite why
wide rider private top shop stock step stuff star stark start stub stab stack stamp store storm stoop stone stoke hop
pop cop drop crop sob swap spot stomp tub tap tape type sharp chop shot soap map cup up steep strap strip stump stud
"""
WORDS = """
zero one two three four five six seven eight nine ten eleven twelve hundred thousand yes no on off up down go house
dog cat bird tree bed happy wow follow learn visual marvin sheila cow horse table chair window kitchen water coffee
music robot computer hello thanks please sorry okay maybe never always again people mother father brother sister
morning evening summer winter yellow purple green orange paper pencil doctor teacher market city river mountain
hurry listen open close faster slower battery charge camera arm lift drop hand head turn come wait look where how
alexander elizabeth michael sarah thomas jessica monday friday january october telephone television university
answer question number letter picture garden bottle pocket button circle square triangle little nothing something
"""
LITTLE = """
a the of to and in that it is was for on as with his her he she they you we i at by not be had have from but what all
were when there said one so an which their if will would up no out could them then into him more do who now my me our
"""
SENTENCES = """
the birch canoe slid on the smooth planks
glue the sheet to the dark blue background
it is easy to tell the depth of a well
these days a chicken leg is a rare dish
rice is often served in round bowls
the juice of lemons makes fine punch
the box was thrown beside the parked truck
the hogs were fed chopped corn and garbage
four hours of steady work faced us
a large size in stockings is hard to sell
the boy was there when the sun rose
a rod is used to catch pink salmon
the source of the huge river is the clear spring
kick the ball straight and follow through
help the woman get back to her feet
a pot of tea helps to pass the evening
smoky fires lack flame and heat
the soft cushion broke the man's fall
the salt breeze came across from the sea
the girl at the booth sold fifty bonds
the small pup gnawed a hole in the sock
the fish twisted and turned on the bent hook
press the pants and sew a button on the vest
the swan dive was far short of perfect
the beauty of the view stunned the young boy
two blue fish swam in the tank
her purse was full of useless trash
the colt reared and threw the tall rider
it snowed rained and hailed the same morning
read verse out loud for pleasure
i would like two tickets for the early show
what time does the train to london leave
the queen of hearts and the ten of spades
my mother bought a dozen eggs this morning
we talked about the weather for an hour
her brother works in a shop near the harbour
she told him that nobody would believe the story
the meeting begins at half past nine on tuesday
can you tell me how late it is
the family of dashwood had long been settled in sussex
their estate was large and their residence was in the centre of their property
"""


_CONFUSABLE = 300
"""How many words of the dictionary count as confusable with a command: all that are a third or less away from it."""


@dataclass(frozen=True, slots=True)
class Spoken:
    """A text by a voice; `keyword` is what it holds, or nothing."""

    text: str
    keyword: str | None
    voice: str
    size: float
    tempo: float

    def samples(self) -> Samples:
        """The speech itself."""
        return speak(self.text, self.voice, size=self.size, tempo=self.tempo)


def voices() -> tuple[str, ...]:
    """All voices; flite's and festival's sound the most like people."""
    return FLITE_VOICES + FESTIVAL_VOICES + ESPEAK_VOICES


def script(rng: np.random.Generator, scale: float = 1) -> Iterator[Spoken]:
    """What to say: each command by each voice, other words and talk by some; `scale` says how often."""
    for voice in voices():
        repeats = scale * (1 if voice.startswith(ESPEAK) else 2 if voice in FESTIVAL_VOICES else 8)
        for keyword in KEYWORDS:
            for text in _repeated(PHRASES[keyword], repeats, rng):
                yield _person(text, keyword, voice, rng)
    for text in _others(rng, scale):
        yield _person(text, None, _any_voice(rng), rng)


def _others(rng: np.random.Generator, scale: float) -> Iterator[str]:
    for texts, repeats in ((ALIKE.split(), 4 * scale), (WORDS.split(), 3 * scale), (_sentences(), 4 * scale)):
        yield from _repeated(texts, repeats, rng)
    for keyword in KEYWORDS:
        yield from map(str, rng.choice(confusable(keyword, _CONFUSABLE), _about(80 * scale, rng), replace=False))
    yield from talk(rng, _about(500 * scale, rng))


def _repeated(texts: Iterable[str], repeats: float, rng: np.random.Generator) -> Iterator[str]:
    return (text for text in texts for _ in range(_about(repeats, rng)))


def talk(rng: np.random.Generator, count: int) -> Iterator[str]:
    """Connected speech without commands: little words, others of the whole dictionary, and some that are confusable."""
    alike = [word for keyword in KEYWORDS for word in confusable(keyword, _CONFUSABLE)]
    kinds = (LITTLE.split(), dictionary()[0], [*alike, *ALIKE.split(), *WORDS.split()])
    for _ in range(count):
        drawn = rng.choice(len(kinds), rng.integers(6, 13), p=[0.45, 0.35, 0.2])
        words = [kinds[kind][rng.integers(len(kinds[kind]))] for kind in drawn]
        yield " ".join(word for word in words if not holds_command(word))


def _person(text: str, keyword: str | None, voice: str, rng: np.random.Generator) -> Spoken:
    return Spoken(text, keyword, voice, round(rng.uniform(0.88, 1.28), 3), round(rng.uniform(0.75, 1.3), 3))


def _any_voice(rng: np.random.Generator) -> str:
    draw = rng.random()
    group = FLITE_VOICES if draw < 0.7 else ESPEAK_VOICES if draw < 0.95 else FESTIVAL_VOICES
    return str(rng.choice(group))


def _about(number: float, rng: np.random.Generator) -> int:
    return int(number + rng.random())


def _sentences() -> list[str]:
    return SENTENCES.strip().splitlines()
