"""What a virtual hot air station tells and takes, held to frames that are written out by hand."""

from __future__ import annotations

import pytest

from jbclog.config.line import StationSpec
from jbclog.config.sim_spec import SimSpec
from jbclog.sim.hotair import AirPlant, AirStation
from jbclog.sim.virtual import VirtualStation
from support.virtual.by_frame import T0, told


def station(**sim: object) -> VirtualStation:
    """A station that answers at once, so that its physics stands still between two questions at
    `T0`.
    """
    table = SimSpec.model_validate(
        {"wire": False, "turnaround_ms": 0, "joints_per_minute": 0, "tool": 1} | sim
    )
    return VirtualStation(StationSpec(name="s", url="s", family="jtse", sim=table), now=T0)


def physics(asked: VirtualStation) -> AirStation:
    face = asked.device.face
    assert isinstance(face, AirPlant)
    return face.station


def test_its_name_is_filled_with_a_blank() -> None:
    """Manual 001, 4.9.18: `" JTSE"`."""
    assert told(station(), "RSMN") == "ASMN JTSE"


@pytest.mark.parametrize(
    ("question", "answer"),
    [
        ("RST1", "AST100300"),
        ("RSF1", "ASF100500"),
        ("RSE1", "ASE100200"),
        ("RAT1", "AAT100023"),
        ("RET1", "AET100023"),
        ("RWM1", "AWM100000"),
        ("RPP1", "APP100000"),
        ("RPE1", "APE100000"),
        ("RPS1", "APS100000"),
        ("RCT1", "ACT100001"),
        ("RA11", "AA1100000"),
        ("RA12", "AA1200000"),
        ("RMAT", "AMAT00450"),
        ("RMIT", "AMIT00150"),
        ("RMAF", "AMAF01000"),
        ("RMIF", "AMIF00100"),
        ("RMAE", "AMAE00500"),
        ("RMIE", "AMIE00025"),
        ("RSER", "ASER00000"),
        ("ROH1", "AOH100000"),
        ("RWH1", "AWH100000"),
        ("RTC1", "ATC100000"),
        ("RSC1", "ASC100000"),
    ],
)
def test_every_read_of_the_list_is_answered(question: str, answer: str) -> None:
    """Manual 001, 4.8."""
    assert told(station(), question) == answer


@pytest.mark.parametrize(
    "text",
    [
        "RTT1",
        "RED1",
        "RTA1",
        "RTT",
        "RQT1",
        "RHA1",
        "RD11",
        "RSVR",
        "WNVS00000",
        "WSAD00002",
        "RAT2",
        "RA13",
    ],
)
def test_what_hot_air_does_not_have_is_not_accepted(text: str) -> None:
    assert told(station(), text) == f"N{text[1:4]}00004"


@pytest.mark.parametrize(
    ("write", "answer", "read"),
    [
        ("WST100400", "AST1", "AST100400"),
        ("WST100451", "NST100003", "AST100300"),
        ("WST100149", "NST100003", "AST100300"),
        ("WSF101000", "ASF1", "ASF101000"),
        ("WSF101001", "NSF100003", "ASF100500"),
        ("WSF100099", "NSF100003", "ASF100500"),
        ("WSE100500", "ASE1", "ASE100500"),
        ("WSE100024", "NSE100003", "ASE100200"),
        ("WWM100001", "AWM1", "AWM100001"),
        ("WWM100002", "NWM100003", "AWM100000"),
        ("WA11-0050", "AA11", "AA11-0050"),
        ("WA11-0051", "NA1100003", "AA1100000"),
        ("WMAT00400", "AMAT", "AMAT00400"),
        ("WMAT00149", "NMAT00003", "AMAT00450"),
        ("WMIF00200", "AMIF", "AMIF00200"),
        ("WMIF01001", "NMIF00003", "AMIF00100"),
        ("WPS100001", "APS1", "APS100001"),
        ("WPS100010", "APS1", "APS100010"),
        ("WPS100101", "APS1", "APS100101"),
        ("WPS100011", "NPS100003", "APS100000"),
        ("WPS100002", "NPS100003", "APS100000"),
        ("WST1350", "NST100002", "AST100300"),
    ],
)
def test_a_write_is_taken_within_what_the_station_allows(
    write: str, answer: str, read: str
) -> None:
    asked = station(ambient_c=60)  # warm enough to go on cooling
    assert told(asked, write) == answer
    assert told(asked, f"R{read[1:4]}") == read


def test_a_restart_resets_the_settings_and_a_factory_reset_the_limits() -> None:
    """The list calls W-RST "reset station settings" (docs/reference/contradictions.md, B-40)."""
    asked = station()
    for text in ("WST100400", "WMAT00420", "WPS100001"):
        assert told(asked, text)
    told(asked, "WRST00000")
    assert told(asked, "RST1", T0 + 10) == "AST100300"
    assert told(asked, "RPS1", T0 + 10) == "APS100000"
    assert told(asked, "RMAT", T0 + 10) == "AMAT00420"
    assert told(asked, "WRSP00000", T0 + 11) == "ARSP"
    assert told(asked, "RMAT", T0 + 11) == "AMAT00450"


def test_it_heats_when_it_is_switched_on_and_cools_when_it_is_told() -> None:
    asked = station()
    told(asked, "WPS100001")
    assert told(asked, "RAT1", T0 + 30) == "AAT100300"
    assert told(asked, "RPP1", T0 + 30) != "APP100000"
    told(asked, "WPS100010", T0 + 31)
    assert told(asked, "RPP1", T0 + 32) == "APP100000"
    assert told(asked, "RPS1", T0 + 120) == "APS100000"


def test_what_the_line_file_says_of_it() -> None:
    asked = station(
        thermocouple=False,
        suction_each_joint=True,
        counters={"suction_cycles": 42},
        settings={"selected_air_temperature": 310, "status": "on", "maximum_air_flow": 800},
    )
    assert told(asked, "RPE1") == "APE100004"
    assert told(asked, "RSC1") == "ASC100042"
    assert told(asked, "RPS1") == "APS100001"
    assert told(asked, "RMAF") == "AMAF00800"
    assert physics(asked).settings.selected_air_temperature == 310
