"""The letters of every command of every family, typed from the manuals' lists; x and y are left
out.

``R`` and ``W`` say whether it is read, written or both; ``W0`` is an order for whose data nothing
is printed, or only zeros, so that it may also be sent bare (docs/reference/contradictions.md,
B-37). Manual 000: 4.7; 001: 4.8; 002 and 004: "Commands".
"""

PORTS = "1234"
TOOLS = "123456789"

COMMON = {
    "port": (
        "ST:RW TT:R PP:R PE:R PS:RW CT:R ED:R QT:R HA:RW LA:RW HD:RW LD:RW TA:R CP:R CN:R CS:R CH:R"
        " CW:R CC:R CD:R"
    ),
    "tool": "A:RW S:RW D:RW H:RW",
    "station": "SMN:R MAT:RW MIT:RW SER:R TT:R RSP:W0 RST:W0",
}
"""Manual 000, and the same in 002 and 004."""
BENCH = {"station": "NVS:W0 SVR:R IFE:W0"}
UCR = {"station": "SAD:W FST:R"}
DISPENSED = {"port": "DC:R DL:R"}
FEEDER = {"station": "MOD:RW LEN:RW SPD:RW DIA:RW BCK:RW WCD:RW FEE:R STR:W0 STP:W0"}
HOT_AIR = {
    "port": "ST:RW SF:RW SE:RW AT:R ET:R WM:RW PP:R PE:R PS:RW CT:R OH:R WH:R TC:R SC:R",
    "tool": "A:RW",
    "station": "SMN:R MAT:RW MIT:RW MAF:RW MIF:RW MAE:RW MIE:RW SER:R RST:W0 RSP:W0",
}

FAMILIES = {
    "soldering": [COMMON],
    "dde": [COMMON, BENCH],
    "nae": [COMMON, BENCH],
    "dme": [COMMON, BENCH],
    "hde": [COMMON, BENCH],
    "ucr": [COMMON, BENCH, UCR, DISPENSED],
    "ale": [COMMON, BENCH, FEEDER, DISPENSED],
    "jtse": [HOT_AIR],
}


def codes_of(family: str) -> dict[str, str]:
    """Every code of a family on every port and tool, with what may be done to it."""
    found: dict[str, str] = {}
    for table in FAMILIES[family]:
        for scope, row in table.items():
            for letters, access in (one.split(":") for one in row.split()):
                places = {
                    "station": [""],
                    "port": PORTS,
                    "tool": [port + tool for port in PORTS for tool in TOOLS],
                }[scope]
                found |= {letters + place: access for place in places}
    return found
