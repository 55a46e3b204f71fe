"""Every section that a command cites is the manual's own for that command: the manuals' contents,
typed here a second time.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from support.campaigns.each_row import each_row
from support.product import FAMILIES, Command, Scope

MANUAL_000 = """
4.8.1 RSTx 4.8.2 WSTx 4.8.3 RTTx 4.8.4 RPPx 4.8.5 RPEx 4.8.6 RPSx 4.8.7 WPSx 4.8.8 RCTx 4.8.9 REDx 4.8.10 RAxy 4.8.11 WAxy
4.8.12 RSxy 4.8.13 WSxy 4.8.14 RDxy 4.8.15 WDxy 4.8.16 RHxy 4.8.17 WHxy 4.8.18 RQTx 4.8.19 RHAx 4.8.20 WHAx 4.8.21 RLAx
4.8.22 WLAx 4.8.23 RHDx 4.8.24 WHDx 4.8.25 RLDx 4.8.26 WLDx 4.8.27 RTAx 4.8.28 RSMN 4.8.29 RMAT 4.8.30 WMAT 4.8.31 RMIT
4.8.32 WMIT 4.8.33 RSER 4.8.34 RTT 4.9.35 WRSP 4.8.36 RCPx 4.8.37 RCNx 4.8.38 RCSx 4.8.39 RCHx 4.8.40 RCWx 4.8.41 RCCx
4.8.42 RCDx
"""  # noqa: E501
"""Manual 000, index and 4.8. Its index prints 4.8.25 and 4.8.26 as RHDx and 4.8.30 as VMAT; the  # noqa: E501
text says which are meant.
"""  # noqa: E501

MANUAL_001 = """
4.9.1 RSTx 4.9.2 WSTx 4.9.3 RSFx 4.9.4 WSFx 4.9.5 RSEx 4.9.6 WSEx 4.9.7 RATx 4.9.8 RETx 4.9.9 RWMx 4.9.10 WWMx 4.9.11 RPPx
4.9.12 RPEx 4.9.13 RPSx 4.9.14 WPSx 4.9.15 RCTx 4.9.16 RAxy 4.9.17 WAxy 4.9.18 RSMN 4.9.19 RMAT 4.9.20 WMAT 4.9.21 RMIT
4.9.22 WMIT 4.9.23 RMAF 4.9.24 WMAF 4.9.25 RMIF 4.9.26 WMIF 4.9.27 RMAE 4.9.28 WMAE 4.9.29 RMIE 4.9.30 WMIE 4.9.31 RSER
4.9.32 WRSP 4.9.33 ROHx 4.9.34 RWHx 4.9.35 RTCx 4.9.36 RSCx
"""  # noqa: E501
"""Manual 001, 4.9."""


def _contents(text: str) -> dict[str, str]:
    words = text.split()
    return dict(zip(words[::2], words[1::2], strict=True))


FRAMES = {"000": _contents(MANUAL_000), "001": _contents(MANUAL_001)}
TABLES = {
    # 4.7 is the list of commands; W-RST stands nowhere else
    "000": {"3.1", "4.1", "4.3", "4.4", "4.6", "4.7"},
    "001": {"3.1", "4", "4.1", "4.3", "4.4", "4.6", "4.7", "4.8"},
    "002": {"Tools", "Port Errors", "Station Errors", "Tool Operating Status"},
    "004": {"Tools", "Port Errors", "Device errors", "Tool Operating Status"},
}
"""Sections that are about no single command."""

PLACE = {Scope.STATION: "", Scope.PORT: "x", Scope.TOOL: "xy"}
every_cited = each_row(
    (f"{family.name}-{command.name}", (command,))
    for family in FAMILIES.values()
    for command in family.commands.values()
    if command.manual.startswith(tuple(TABLES))
)


def _printed(command: Command) -> Iterator[tuple[str, str]]:
    """Manual and section, one by one."""
    for part in command.manual.split("; "):
        manual, _, sections = part.partition(" ")
        yield from ((manual, section) for section in sections.split(", "))


@every_cited
def test_a_section_that_is_cited_is_about_the_command(command: Command) -> None:
    own = {f"{header}{command.letters}{PLACE[command.scope]}" for header in command.access.upper()}
    for manual, section in _printed(command):
        code = FRAMES.get(manual, {}).get(section, re.sub(r"^([RW])-?(?=[A-Z])", r"\1", section))
        assert code in own or section in TABLES[manual], f"{manual} {section}"


@every_cited
def test_every_command_cites_a_section_of_its_own_or_the_list(command: Command) -> None:
    cited = list(_printed(command))
    tables = [(manual, section) for manual, section in cited if section in TABLES.get(manual, ())]
    # W-RST of hot air is listed and never described
    assert len(tables) < len(cited) or cited == [("001", "4.8")]
