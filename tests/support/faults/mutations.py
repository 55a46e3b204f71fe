"""Files and streams made of good ones, as a fuzzer feeds them. The good ones, and what once broke
something: tests/data/fuzz.
"""

from __future__ import annotations

import copy
import json
import random
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

CORPUS = Path(__file__).parents[2] / "data" / "fuzz"
Rng = random.Random

JUNK: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1, 2**31, 2**62, -(2**62), 0.5, -0.0, 1e18, 1e300),
    *(
        "",
        "x",
        "0",
        "-1",
        "١",
        "\n",
        "\t",
        "\x1b[2J",
        "\u202e",
        "\ud800",
        "../../x",
        "x" * 5000,
        "1970-01-01T00:00:00Z",
    ),
    *([], [[]], {}, {"": {}}, [None], {"a": []}),
)


def corpus(target: str) -> list[bytes]:
    """The files of one target, in the order of their names."""
    return [path.read_bytes() for path in sorted((CORPUS / target).iterdir())]


def cases(seeds: Sequence[bytes], words: Sequence[bytes]) -> st.SearchStrategy[bytes]:
    """A seed with some alterations; `words` are what may come into it."""
    return st.builds(
        lambda seed, rng, count: altered(seed, seeds, words, rng, count), *_random(seeds)
    )


def json_cases(seeds: Sequence[bytes]) -> st.SearchStrategy[bytes]:
    """Lines of JSON of which some values are others; the form is kept."""
    return st.builds(lambda seed, rng, count: _altered_json(seed, rng, count), *_random(seeds))


def _random(
    seeds: Sequence[bytes],
) -> tuple[st.SearchStrategy[bytes], st.SearchStrategy[Rng], st.SearchStrategy[int]]:
    return st.sampled_from(list(seeds)), st.integers(0, 2**32).map(Rng), st.integers(0, 8)


def altered(
    seed: bytes, seeds: Sequence[bytes], words: Sequence[bytes], rng: Rng, count: int
) -> bytes:
    """`seed` with `count` alterations: bits, bytes, words, lines, pieces of it and of others."""
    data = bytearray(seed)
    for _ in range(count):
        place, size = rng.randrange(len(data) + 1), rng.choice((1, 1, 2, 4, 16, 200))
        what = rng.randrange(8)
        if what == 0 and place < len(data):
            data[place] ^= 1 << rng.randrange(8)
        elif what == 1:
            data[place:place] = rng.randbytes(size)
        elif what == 2:
            del data[place : place + size]
        elif what == 3:
            data[place : place + rng.choice((0, size))] = (
                rng.choice(words) if words else bytes(size)
            )
        elif what == 4:
            other = rng.choice(seeds)
            start = rng.randrange(len(other) + 1)
            data[place:place] = other[start : start + size]
        elif what == 5:
            data[place : place + size] = bytes(size)
        elif what == 6:
            _move_line(data, rng)
        else:
            del data[rng.randrange(len(data) + 1) :]
    return bytes(data)


def _move_line(data: bytearray, rng: Rng) -> None:
    """A line more, one less, or one in another place."""
    lines = bytes(data).split(b"\n")
    line = lines.pop(rng.randrange(len(lines)))
    for _ in range(rng.randrange(3)):
        lines.insert(rng.randrange(len(lines) + 1), line)
    data[:] = b"\n".join(lines)


def _altered_json(seed: bytes, rng: Rng, count: int) -> bytes:
    lines = _trees(seed)
    for _ in range(count):
        number = rng.randrange(len(lines))
        lines[number] = with_junk(lines[number], rng)
    return (
        "\n".join(json.dumps(line, ensure_ascii=rng.random() < 0.8) for line in lines).encode(
            errors="replace"
        )
        + b"\n"
    )


def _trees(seed: bytes) -> list[Any]:
    """The JSON of a file: one, or one a line."""
    try:
        return [json.loads(seed)]
    except ValueError:
        return [json.loads(line.decode(errors="replace")) for line in seed.splitlines()]


def with_junk(tree: Any, rng: Rng) -> Any:
    """A copy in which one value, key or item is another, is there twice, or is gone."""
    made = copy.deepcopy(tree)
    here: Any = made
    while isinstance(here, dict | list) and here:
        key = rng.choice([*here] if isinstance(here, dict) else range(len(here)))
        if isinstance(here[key], dict | list) and here[key] and rng.random() < 0.8:
            here = here[key]
            continue
        what = rng.randrange(6)
        if what == 0:
            del here[key]
        elif what == 1 and isinstance(here, list):
            here.insert(rng.randrange(len(here)), copy.deepcopy(here[key]))
        elif what == 1:
            here[str(rng.choice(JUNK))[:20]] = here.pop(key)
        else:
            here[key] = copy.deepcopy(rng.choice(JUNK))
        return made
    return copy.deepcopy(rng.choice(JUNK))
