"""The commands of every family, typed from the manuals' lists of commands, apart from the product's
tables. Manual 000: 4.7; 001: 4.8; 002 and 004: "Commands".

A row is ``code  access  unit  limits``; x stands for the port, y for the tool, ``-`` for none.
"""

from __future__ import annotations

PORTS = "1234"
TOOLS = "123456789"

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
ROWS = {
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
"""The rows of each family."""

FAMILIES = [name for name in ROWS if name != "omega"]
"""Families of JBC: their codes have a port and a tool."""


def codes_of(family: str) -> dict[str, str]:
    """Every code of a family on every port and tool, with what may be done to it.

    ``R`` and ``W`` say whether it is read, written or both; ``W0`` is an order for whose data
    nothing is printed, or only zeros, so that it may also be sent bare
    (docs/reference/contradictions.md, B-37).
    """
    found: dict[str, str] = {}
    for row in filter(None, ROWS[family].splitlines()):
        code, access, _, limits = row.split()[:4]
        letters = code.rstrip("xy")
        places = {
            "": [""],
            "x": PORTS,
            "xy": [port + tool for port in PORTS for tool in TOOLS],
        }[code[len(letters) :]]
        done = "W0" if (access, limits) == ("w", "0..0") else access.replace("/", "").upper()
        found |= {letters + place: done for place in places}
    return found
