"""Draws and joints in columns are those that were put in, and small."""

from __future__ import annotations

import tracemalloc
from math import inf

import numpy as np

from jbclog.analysis.joints.draws import JOINT, NOT_KNOWN, Draw
from jbclog.analysis.joints.packed import ROWS_AT_ONCE, Packed, column_of, dwells_of, kinds_of
from jbclog.analysis.joints.recovery import Joint

COUNT = 3 * ROWS_AT_ONCE + 7
BYTES_A_JOINT = 200


def joints(count: int = COUNT) -> list[Joint]:
    """Joints of which everything that may be missing is missing somewhere."""
    rng = np.random.default_rng(3)

    def known(value: object) -> object:
        return None if rng.random() < 0.2 else value

    made = []
    for place in range(count):
        numbers = rng.normal(0, 1, 14).tolist()
        draw = Draw(
            float(place),
            place + 0.5,
            numbers[0],
            known(numbers[1]),  # type: ignore[arg-type]
            known(numbers[2]),  # type: ignore[arg-type]
            place % 4,
            numbers[3],
            known("cut off"),  # type: ignore[arg-type]
            known(place % 2 == 0),  # type: ignore[arg-type]
            known(1.5),  # type: ignore[arg-type]
            place % 5 == 0,
        )
        figures = [known(inf if place == 9 else number) for number in numbers[4:12]]
        why = known(f"reason {place % 5}")
        made.append(Joint(draw, *figures[:7], known(place % 2 == 0), *figures[7:], why=why))  # type: ignore[arg-type]
    return made


def test_joints_are_those_that_were_put_in() -> None:
    every = joints()
    packed = Packed(Joint, every[:5])
    for first in range(5, COUNT, 100):
        packed.extend(every[first : first + 100])
    assert (len(packed), list(packed)) == (COUNT, every)
    assert [packed[0], packed[-1], *packed[1000:1100]] == [every[0], every[-1], *every[1000:1100]]
    assert {type(one.recovered) for one in packed} == {bool, type(None)}
    assert {type(one.draw.contacts) for one in packed} == {int}
    assert list(Packed(Joint)) == []


def test_columns_of_joints_in_columns_are_those_of_objects() -> None:
    every = joints()
    packed = Packed(Joint, every)
    for name in (*Joint._fields[1:], *Draw._fields):
        assert column_of(packed, name) == column_of(every, name), name
    assert dwells_of(packed) == dwells_of(every) == [one.dwell_s for one in every]
    assert kinds_of(packed) == kinds_of(every) == [one.kind for one in every]
    assert {*kinds_of(packed)} == {JOINT, NOT_KNOWN}


def test_a_place_is_found_by_its_moment() -> None:
    draws = [one.draw for one in joints(50)]
    packed = Packed(Draw, draws)
    for moment in (-1.0, 0.0, 0.5, 7.0, 49.0, 49.5, inf):
        found = packed[packed.place("start_s", moment) :]
        assert found == [one for one in draws if one.start_s >= moment]


def test_joints_in_columns_are_small() -> None:
    every = joints(20_000)
    tracemalloc.start()
    packed = Packed(Joint, every)
    taken = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert len(packed) == 20_000
    assert taken < BYTES_A_JOINT * len(packed)
