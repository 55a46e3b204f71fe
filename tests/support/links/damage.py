"""What a bad wire does to the bytes of one frame, and whether the check byte shows it: an
independent few lines of each protocol.

An XOR does not see an even number of flips in one bit column, nor characters that changed places; a
sum does not see the latter either. Nothing here is the product's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import reduce
from operator import xor
from random import Random

STX, ETX = b"\x02", b"\x03"

Damage = Callable[[bytes, Random], bytes]


def jbc_holds(frame: bytes) -> bool:
    """Whether these bytes are one whole frame of JBC's with a good check byte."""
    return (
        len(frame) > 4
        and frame[:1] == STX
        and frame[-2:-1] == ETX
        and reduce(xor, frame[:-1]) == frame[-1]
    )


def omega_holds(frame: bytes) -> bool:
    """Whether these bytes are one whole frame of OMEGA's with a good sum."""
    text = frame[1:-3]
    return (
        len(frame) > 4
        and frame[:1] == STX
        and frame[-3:-2] == ETX
        and frame[-2:] == f"{sum(text) & 0xFF:02X}".encode()
    )


def _flipped(frame: bytes, places: list[int]) -> bytes:
    whole = int.from_bytes(frame, "big")
    for place in places:
        whole ^= 1 << place
    return whole.to_bytes(len(frame), "big")


def _bits(count: int) -> Damage:
    return lambda frame, random: _flipped(frame, random.sample(range(8 * len(frame)), count))


def _pair_in_a_column(frame: bytes, random: Random) -> bytes:
    """The same bit of two characters, what an XOR cannot see; of two digits mostly, so that it
    means something.
    """
    column = random.randrange(4 if random.random() < 0.8 else 8)
    digits = [place for place in range(len(frame)) if frame[place : place + 1].isdigit()]
    among = digits if random.random() < 0.8 and len(digits) > 1 else list(range(len(frame)))
    return _flipped(
        frame, [8 * (len(frame) - 1 - place) + column for place in random.sample(among, 2)]
    )


def _swapped(frame: bytes, random: Random) -> bytes:
    """Two adjacent characters of the data, the other way round."""
    place = random.randrange(max(len(frame) - 7, 0), len(frame) - 3)
    return (
        frame[:place] + frame[place + 1 : place + 2] + frame[place : place + 1] + frame[place + 2 :]
    )


def _burst(frame: bytes, random: Random) -> bytes:
    place = random.randrange(len(frame) - 2)
    return frame[:place] + random.randbytes(3) + frame[place + 3 :]


def _without_a_byte(frame: bytes, random: Random) -> bytes:
    place = random.randrange(len(frame))
    return frame[:place] + frame[place + 1 :]


def _with_a_byte(frame: bytes, random: Random) -> bytes:
    place = random.randrange(len(frame) + 1)
    return frame[:place] + random.randbytes(1) + frame[place:]


def _byte_twice(frame: bytes, random: Random) -> bytes:
    place = random.randrange(len(frame))
    return frame[: place + 1] + frame[place:]


def _begun_twice(frame: bytes, random: Random) -> bytes:
    """It breaks off and begins anew."""
    return frame[: random.randrange(1, len(frame))] + frame


def _never_ended(frame: bytes, random: Random) -> bytes:
    return frame.replace(ETX, b"0") + random.randbytes(random.randrange(300)).replace(ETX, b"0")


def _noise(frame: bytes, random: Random) -> bytes:
    return random.randbytes(random.randint(1, 100)) + frame


def _noise_behind(frame: bytes, random: Random) -> bytes:
    return frame + random.randbytes(random.randint(1, 100))


def _noise_instead(_frame: bytes, random: Random) -> bytes:
    return random.randbytes(random.randint(1, 300))


DAMAGES: Mapping[str, Damage] = {
    "one_bit": _bits(1),
    "two_bits": _bits(2),
    "three_bits": _bits(3),
    "four_bits": _bits(4),
    "pair_in_a_column": _pair_in_a_column,
    "swapped": _swapped,
    "burst": _burst,
    "without_a_byte": _without_a_byte,
    "with_a_byte": _with_a_byte,
    "byte_twice": _byte_twice,
    "begun_twice": _begun_twice,
    "never_ended": _never_ended,
    "noise": _noise,
    "noise_behind": _noise_behind,
    "noise_instead": _noise_instead,
}
"""Each by its name; `frame` has five bytes at the least."""
