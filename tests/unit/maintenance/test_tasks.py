"""The tasks file: what it gives, and all that is wrong with it at once, with line and key."""

from __future__ import annotations

from pathlib import Path

import pytest

from jbclog.config.tasks_file import Task, load_tasks, parse_tasks
from jbclog.core.errors import Problems

GOOD = """\
[[task]]
name = "tip-change"
title = "Change the tip"
counter = "work_h"
life_h = 400
families = ["dde", "ale"]

[[task]]
name = "rollers"
counter = "dispensed_mm"
life_m = 900
warn_percent = 90
stations = ["ale-1"]
of = "station"

[[task]]
name = "verification"
life_days = 90
"""


def wrong(text: str) -> list[str]:
    with pytest.raises(Problems) as found:
        parse_tasks(text)
    return str(found.value).splitlines()


def test_a_good_file_gives_its_tasks(tmp_path: Path) -> None:
    (tmp_path / "tasks.toml").write_text(GOOD, encoding="utf-8")
    tip, rollers, verification = load_tasks(tmp_path / "tasks.toml")
    assert tip == Task("tip-change", "Change the tip", "work_h", 400.0, families=("dde", "ale"))
    assert (rollers.life, rollers.warn_percent, rollers.of_station) == (900_000.0, 90.0, True)
    assert (verification.counter, verification.life, verification.title) == (
        "days",
        90.0,
        "verification",
    )


def test_a_task_is_of_its_families_and_stations() -> None:
    tip, rollers, verification = parse_tasks(GOOD)
    assert [one.is_of("dde-1", "dde") for one in (tip, rollers, verification)] == [
        True,
        False,
        True,
    ]
    assert [one.is_of("ale-1", "ale") for one in (tip, rollers, verification)] == [True, True, True]
    assert [one.is_of("x", None) for one in (tip, rollers, verification)] == [False, False, True]


def test_everything_that_is_wrong_is_said_at_once_where_it_stands() -> None:
    text = """\
[[task]]
name = "tip change"
counter = "work_hours"
life_h = 0

[[task]]
name = "rollers"
counter = "work_h"
life_m = 900
colour = "red"
warn_percent = 120

[[task]]
name = "rollers"
life_h = 3
life_days = 3
families = ["dda"]
"""
    said = wrong(text)
    assert [line.split(":")[1] for line in said] == [
        "2",
        "3",
        "4",
        "8",
        "10",
        "11",
        "13",
        "14",
        "17",
    ]
    assert (
        said[1]
        == 'tasks.toml:3: task[1].counter: "work_hours" is not allowed; did you mean work_h?'
    )
    assert (
        said[3] == "tasks.toml:8: task[2].counter: work_h is not counted so; with life_m one of"
        " dispensed_mm"
    )
    assert said[6].startswith(
        "tasks.toml:13: task[3]: life_h and life_days are given; exactly one of"
    )
    assert said[7] == "tasks.toml:14: task[3].name: rollers is given twice, first in line 7"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "task: missing; at least one [[task]]"),
        (
            '[[task]]\nname = "a"\n',
            "no service interval is given; exactly one of life_h, life_cycles, life_m, life_days",
        ),
        (
            '[[task]]\nname = "a"\nlife_h = 3\n',
            "task[1].counter: missing; with life_h one of plugged_h",
        ),
        (
            '[[task]]\nname = "a"\ncounter = "work_h"\nlife_days = 3\n',
            "days of the calendar and take no counter",
        ),
        ('[[task]]\nname = "counters-reset"\nlife_days = 3\n', "give the task another name"),
        (
            '[[task]]\nname = "a"\nlife_days = 1e-300\n',
            "life_days: 1e-300 is not allowed; days, 0.01 or more",
        ),
        (
            '[[task]]\nname = "a"\nlife_days = "3"\n',
            'life_days: "3" is not allowed; days, 0.01 or more',
        ),
        ('[task]\nname = "a"\n', "task"),
        ("[[task]\n", "not TOML"),
        ("task = []\n", "there is none; at least one [[task]]"),
    ],
)
def test_each_fault_has_its_sentence(text: str, sentence: str) -> None:
    assert any(sentence in line for line in wrong(text)), wrong(text)
