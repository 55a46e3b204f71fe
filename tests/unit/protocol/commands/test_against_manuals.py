"""The tables beside the manuals, line by line: typed here from the manuals a second time, apart
from the product's tables.

A row is ``code  access  unit  limits``; x stands for the port, y for the tool, ``-`` for none.
"""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from jbclog.protocol.commands.command import Command, Scope
from jbclog.protocol.commands.family import FAMILIES

COMMON_002 = """
STx r/w °C   step=5                     002 W-STx "must be done in steps of 5 degrees"
TTx r   °C   -
PPx r   ‰    0..1000                    002 R-PPx "expressed in ‰"
PEx r   -    -
PSx r/w -    -
CTx r   -    -
EDx r   s    -                          002 R-EDx "expressed in seconds"
Axy r/w °C   -50..50,step=1             002 W-Axy "+/- 50°C", "steps of 1 degree"
Sxy r/w °C   step=5                     002 W-Sxy "steps of 5 degrees"
Dxy r/w min  0..9,step=1,off            002 W-Dxy "steps of 1 minute with a range from 0 to 9", "99999"
Hxy r/w min  0..60,step=5,off           002 W-Hxy "steps of 5 minutes with a range from 0 to 60", "99999"
QTx r   °C   -
HAx r/w °C   step=5                     002 W-HAx "steps of 5 degrees"; 0 would be read as "not set"
LAx r/w °C   step=5                     002 W-LAx "steps of 5 degrees"; 0 would be read as "not set"
HDx r/w s    0..99.99,step=0.01,off     002 W-HDx 'Format "ss.cc"', R-HDx "99999"
LDx r/w s    0..99.99,step=0.01,off     002 W-LDx 'Format "ss.cc"', R-LDx "99999"
TAx r   -    -
SMN r   -    -
MAT r/w °C   unprinted
MIT r/w °C   unprinted
SER r   -    -
TT  r   °C   -
RSP w   -    0..0
RST w   -    0..0
CPx r   h    -
CNx r   h    -
CSx r   h    -
CHx r   h    -
CWx r   h    -
CCx r   count -
CDx r   count -
"""  # noqa: E501
"""The commands of manual 000, 4.7 "List of commands", as manuals 002 and 004 print them."""

LESS_IN_000 = {
    "STx": "unprinted",  # 4.8.2
    "Axy": "-50..",  # 3.1 "the lowest number that can be transmitted is -0050"
    "Sxy": "unprinted",
    "Dxy": "unprinted,off",  # 4.8.15 "To disable the sleep mode, send 99999"
    "Hxy": "unprinted,off",
    "HAx": "unprinted",
    "LAx": "unprinted",
}
"""Where manual 000 prints no range and no step, and 002 does."""
COMMON_000 = "\n".join(
    " ".join([*line.split()[:3], LESS_IN_000.get(line.split()[0], line.split()[3])])
    for line in COMMON_002.splitlines()
    if line
)

STORE = 'NVS w   -    0..0                       002 W-NVS "must contains 00000"\n'
VERSION = "SVR r   -    -\n"
UCR_ONLY = """
SAD w   -    0..99,step=1               002 W-SAD "between 00000 and 00099"
FST r   -    -
"""
FUSE = "IFE w - 0..0\n"  # 002 W-IFE has no "Only available for UCR"
DISPENSED = """
DCx r   count -
DLx r   mm   -                          002 R-DLx "hexadecimal. Units [dmm]"
"""
FEEDER = """
MOD r/w -    -
LEN r/w mm   unprinted                  002 R-LEN "Units [dmm]"
SPD r/w mm/s unprinted                  002 R-SPD "Units [dmm/s]"
DIA r/w mm   unprinted                  002 R-DIA "Units [cmm]"
BCK r/w mm   unprinted                  002 R-BCK "Units [dmm]"
WCD r/w -    -
FEE r   -    -
STR w   -    0..0
STP w   -    0..0
"""

HOT_AIR = """
STx r/w °C   unprinted                  001 4 "Temperatures are always shown in ºC"
SFx r/w raw  unprinted                  001 4.9.4: no unit is printed
SEx r/w °C   unprinted
ATx r   °C   -
ETx r   °C   -
WMx r/w -    -                          001 4.7
PPx r   ‰    0..1000                    001 4 "thousands of the theoretical maximum power [‰]"
PEx r   -    -
PSx r/w -    -                          001 4.6
CTx r   -    -
Axy r/w °C   -50..                      001 3.1 "the lowest number that can be transmitted is -0050"
SMN r   -    -
MAT r/w °C   unprinted
MIT r/w °C   unprinted
MAF r/w raw  unprinted
MIF r/w raw  unprinted
MAE r/w °C   unprinted
MIE r/w °C   unprinted
SER r   -    -
RST w   -    0..0
RSP w   -    0..0
OHx r   h    -
WHx r   h    -
TCx r   count -
SCx r   count -
"""
"""Manual 001, 4.8 "List of commands", whole."""

OMEGA = """
A   r   -    -                          003 11.3.1 "Soldering controller information request"
B   r   -    -                          these and all below: from pages that are not here
Cn  r   -    -
D   w   -    -
F   r   -    -
G   r   -    -
H   w   -    101..399,step=1
"""
"""n stands for the number of a solder condition."""

BENCH = COMMON_002 + STORE + VERSION + FUSE
EXPECTED = {
    "soldering": COMMON_000,  # manual 000 knows neither W-NVS nor R-SVR
    "dde": BENCH,
    "nae": BENCH,
    "dme": BENCH,
    "hde": BENCH,
    "ucr": BENCH + UCR_ONLY + DISPENSED,
    "ale": BENCH + FEEDER + DISPENSED,
    "jtse": HOT_AIR,
    "omega": OMEGA,
}


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
    expected = {tuple(line.split()[:4]) for line in EXPECTED[name].splitlines() if line}
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
    9: "TRA245/TRA470",
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
