"""The tables beside the manuals, line by line: typed from the manuals a second time, apart from the
product's tables. The commands stand in `support/golden/letters.py`, all else here.
"""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from support.golden.letters import ROWS
from support.product import FAMILIES, Command, Scope


def _row(command: Command) -> tuple[str, str, str, str]:
    code = (
        command.letters
        + {Scope.STATION: "", Scope.PORT: "x", Scope.TOOL: "xy", Scope.CONDITION: "n"}[
            command.scope
        ]
    )
    return code, "/".join(command.access), command.unit or "-", _limits(command)


def _limits(command: Command) -> str:
    limits = command.limits
    if not limits.printed:
        return ("unprinted,off" if limits.off else "unprinted") if command.writable else "-"
    parts = []
    if limits.low is not None or limits.high is not None:
        low, high = ("" if one is None else f"{one:g}" for one in (limits.low, limits.high))
        parts.append(f"{low}..{high}")
    if limits.step is not None:
        parts.append(f"step={limits.step:g}")
    if limits.off:
        parts.append("off")
    return ",".join(parts) or "-"


@pytest.mark.parametrize("name", FAMILIES)
def test_the_commands_of_a_family(name: str) -> None:
    expected = {tuple(line.split()[:4]) for line in ROWS[name].splitlines() if line}
    assert {_row(command) for command in FAMILIES[name].commands.values()} == expected


@pytest.mark.parametrize(
    ("name", "ports"),
    [
        ("soldering", None),
        ("dde", (1, 2)),
        ("nae", (1, 2)),
        ("dme", (1, 2, 3, 4)),
        ("hde", None),
        ("ucr", (1,)),
        ("ale", (1,)),
        ("jtse", (1,)),  # manual 001, 4.2
        ("omega", (1,)),  # manual 003, 11.1: "Connecting number 1 on 1"
    ],
)
def test_the_ports(name: str, ports: tuple[int, ...] | None) -> None:
    """ "2-Tool", "4-Tool Control Unit" (manual 002); "1 Port 1" (manual 004, Ports); the line
    file's defaults else.
    """
    assert FAMILIES[name].ports == ports


TOOLS_OF_THE_BENCH = {
    0: "none",
    1: "T210",
    2: "T245/T470/TR245/TR470",
    3: "PA120/AM120",
    4: "HT420/AT420",
    5: "DS360",
    6: "DR560",
    7: "NT115",
    8: "NP115/AN115",
    9: "TRA245/TRA470/T470",  # T470 by what real stations say over USB (B-29)
}


@pytest.mark.parametrize(
    ("names", "tools"),
    [
        (
            ["soldering"],  # manual 000, 4.1
            {
                0: "none",
                1: "T210",
                2: "T245/T470",
                3: "PA",
                4: "HT",
                5: "DS",
                6: "DR",
                7: "NT105",
                8: "NP105",
            },
        ),
        (["dde", "nae", "dme", "hde", "ale"], TOOLS_OF_THE_BENCH),  # manual 002, "Tools"
        (["ucr"], {0: "none", 2: "TR245/TR470", 9: "TRA245/TRA470"}),  # manual 004, "Tools"
        (["jtse"], {0: "none", 1: "JT", 2: "TE"}),  # manual 001, 4.1
        (["omega"], {}),
    ],
)
def test_the_tools(names: list[str], tools: dict[int, str]) -> None:
    for name in names:
        assert FAMILIES[name].tools == tools


SOLDERING = [name for name in FAMILIES if name not in ("jtse", "omega")]


@pytest.mark.parametrize(
    ("names", "digits"),
    [
        # manual 000, 4.6; "Tool Operating Status", "Suction Status", "Motor Status" (manual 002)
        (SOLDERING, ("0", "012", "01", "01", "0123")),
        (["jtse"], ("0", "0", "01", "01", "01")),  # manual 001, 4.6
    ],
)
def test_a_status_word_has_the_digits_that_are_printed_and_no_other(
    names: list[str], digits: tuple[str, ...]
) -> None:
    for name in names:
        status = FAMILIES[name].commands["status"].quantity
        for place, printed in enumerate(digits):
            for digit in "0123456789":
                word = "0" * place + digit + "0" * (4 - place)
                if digit in printed:
                    assert status.decode(word) == tuple(map(int, word))
                else:
                    with pytest.raises(ValueError, match="no manual describes"):
                        status.decode(word)


@pytest.mark.parametrize("name", SOLDERING)
def test_the_errors(name: str) -> None:
    """Manual 000, 4.3 and 4.4; "Port Errors", "Station Errors" (manual 002), "Device errors"
    (manual 004).
    """
    words = {
        0: "ok",
        1: "short circuit",
        2: "restart",
        3: "open circuit",
        4: "no tool",
        5: "not accepted",
        6: "detecting",
        7: "maximum power",
        8: "stopped: overload",
        9: "warning: overload",
    }
    _agree(FAMILIES[name].port_errors.texts, words)
    words = {
        0: "ok",
        1: "stopped: transformer overload",
        2: "temperature sensor",
        3: "memory",
        4: "mains frequency",
        5: "model",
        6: "not connected",
        7: "warning: transformer overload",
    }
    _agree(FAMILIES[name].station_errors.texts, words)


def test_the_errors_of_hot_air() -> None:
    """Manual 001, 4.3 and 4.4: the same numbers say other things, and station error 7 is not
    printed.

    docs/reference/contradictions.md, B-30 and B-45.
    """
    words = {
        0: "ok",
        1: "air pump",
        2: "insufficient air flow",
        3: "heater malfunction",
        4: "thermocouple needed",
        5: "temperature not reached",
        6: "short circuit",
        7: "tool resistance",
        8: "wrong heater",
        9: "no tool",
        10: "checking",
    }
    _agree(FAMILIES["jtse"].port_errors.texts, words)
    assert FAMILIES["jtse"].port_errors.no_tool == 9
    words = {
        0: "ok",
        1: "overload",
        2: "temperature sensor",
        3: "memory",
        4: "mains frequency",
        5: "model",
        6: "not connected",
        7: "overload",
    }
    _agree(FAMILIES["jtse"].station_errors.texts, words)


def _agree(table: Mapping[int, str], words: dict[int, str]) -> None:
    assert set(table) == set(words)
    assert [number for number, word in words.items() if word not in table[number]] == []


@pytest.mark.parametrize("name", FAMILIES)
def test_reading_clears_nothing_but_the_alarm_flags(name: str) -> None:
    """ "Once you have read the flag this is deleted" (manual 000, 4.8.27)."""
    cleared = [
        command.name
        for command in FAMILIES[name].commands.values()
        if command.readable and command.sent_once
    ]
    assert cleared == (["alarm_flags"] if name in SOLDERING else [])


def test_what_is_never_sent_without_being_asked_for() -> None:
    """docs/reference/faults.md, S-5: RST, RSP, SAD, NVS, IFE, MAT, MIT, STR; hot air's own of that
    kind, and OMEGA's D and H.
    """
    dangerous = {
        command.letters
        for family in FAMILIES.values()
        for command in family.commands.values()
        if command.dangerous
    }
    assert dangerous == {
        "RST",
        "RSP",
        "SAD",
        "NVS",
        "IFE",
        "MAT",
        "MIT",
        "STR",
        "MAF",
        "MIF",
        "MAE",
        "MIE",
        "D",
        "H",
    }
