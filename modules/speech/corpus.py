"""Speech to train on: commands and much else, said by Debian's voices with several sizes and speeds, in noisy rooms."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from modules.speech.spotter import KEYWORDS
from timelines.datasets.speech import ESPEAK, FESTIVAL_VOICES, RATE, speak

if TYPE_CHECKING:
    from collections.abc import Iterator

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
# What sounds like a command, or like a part of one, decides how many false alarms there are.
ALIKE = """
forty four ford for fort forget forest force former foreign ward word world awkward toward reward award afterward
four walls or what order warden forward-looking fourth sword board bored hardware shoreward wayward back backyard
backed bad word backwards black bag packed bakery basket battery jackpot blackbird lackluster backpack lift laugh
let leaf loft lest less last loved leave lefty felt elf shelf deaf cleft theft led leg lend lunch level lettuce
elephant letter lemon lectern gift draft soft after lived laughed best rest west left-over yet met write white
light ride rice rat rate route root wrong bright fright try rye wry ripe rise rhyme riot ray tried night kite bite
fight sight height arrive around rabbit arrived might quite why wide rider private top shop stock step stuff star
stark start stub stab stack stamp store storm stoop stone stoke hop pop cop drop crop sob swap spot stomp tub tap
tape type sharp chop shot soap map cup up steep stopped strap strip stump stud
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
    """What to say: each command by each voice, other words and sentences by some; `scale` says how often."""
    for voice in voices():
        repeats = scale * (1 if voice.startswith(ESPEAK) else 2 if voice in FESTIVAL_VOICES else 8)
        for keyword in KEYWORDS:
            for text in PHRASES[keyword]:
                for _ in range(_about(repeats, rng)):
                    yield _person(text, keyword, voice, rng)
    for texts, repeats in ((ALIKE.split(), 5 * scale), (WORDS.split(), 4 * scale), (_sentences(), 5 * scale)):
        for text in texts:
            for _ in range(_about(repeats, rng)):
                yield _person(text, None, _any_voice(rng), rng)


def in_a_room(speech: Samples, rng: np.random.Generator) -> Samples:
    """Put speech into a room with an echo and noise, before a microphone that may clip; its times stay."""
    sound = _echo(speech, rng) if rng.random() < 0.6 else speech
    sound = _coloured(sound, rng)
    loudness = np.sqrt(np.mean(speech**2))
    noise = _noise(len(sound), rng) * loudness * 10 ** (-rng.uniform(4, 40) / 20)
    sound = (sound + noise) * rng.choice([0.3, 1, 1, 2, 6])
    clipped: Samples = np.clip(sound, -32768, 32767)
    return clipped


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


def _echo(sound: Samples, rng: np.random.Generator) -> Samples:
    """Reflections die away by 60 dB within 0.1 s (a small room) to 0.6 s (a hall)."""
    decay = rng.uniform(0.1, 0.6)
    times = np.arange(round(decay * RATE)) / RATE
    response = rng.normal(0, 0.02 * rng.uniform(0.2, 1.5), len(times)) * 10 ** (-3 * times / decay)
    response[0] = 1
    size = _fast(len(sound) + len(response))
    echoed: Samples = np.fft.irfft(np.fft.rfft(sound, size) * np.fft.rfft(response, size), size)[: len(sound)]
    return echoed


def _coloured(sound: Samples, rng: np.random.Generator) -> Samples:
    """A microphone favours some frequencies: by up to 6 dB, changing slowly over the spectrum."""
    spectrum = np.fft.rfft(sound, _fast(len(sound)))
    corners = rng.uniform(-6, 6, 7)
    gain = np.interp(np.linspace(0, 1, len(spectrum)), np.linspace(0, 1, len(corners)), corners)
    coloured: Samples = np.fft.irfft(spectrum * 10 ** (gain / 20))[: len(sound)]
    return coloured


def _noise(length: int, rng: np.random.Generator) -> Samples:
    """Noise of power 1 whose spectrum falls with frequency: white (0), pink (1) or a rumble (2)."""
    size = _fast(length)
    spectrum = np.fft.rfft(rng.normal(0, 1, size))
    slope = rng.uniform(0, 2)
    spectrum *= np.maximum(np.arange(len(spectrum)), 20 * size / RATE) ** (-slope / 2)
    noise = np.fft.irfft(spectrum)[:length]
    even: Samples = noise / np.sqrt(np.mean(noise**2))
    return even


def _fast(length: int) -> int:
    """The next power of two: the Fourier transform of a prime length takes ten times as long."""
    return 1 << (length - 1).bit_length()
