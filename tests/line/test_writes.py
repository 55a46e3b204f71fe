"""A run writes what its recipe requires and what makes tools safe, and nothing else, by the
station's side of the serial line.
"""

from __future__ import annotations

import tomllib
from contextlib import nullcontext
from pathlib import Path

import pytest

from support.oracles.listed_writes import strange_writes
from support.product import (
    FAMILIES,
    RUN_WRITES,
    WriteForbidden,
    condition_of,
    write_before_sampling,
)
from support.virtual.virtual_run import RECIPE, Heard, VirtualRun, line_text, prepare

PROFILES = Path(__file__).parents[2] / "profiles"
LINES = {
    path.stem: path for path in sorted((PROFILES / "lines").glob("*.toml")) if path.stem != "bench"
}
FAULTS = """
[[station.sim.fault]]
kind = "flip"
at_s = 0.2
every = 17

[[station.sim.fault]]
kind = "silence"
at_s = 1.0
every = 41

[[station.sim.fault]]
kind = "dropout"
at_s = 4.0
for_s = 1.5
"""


def run_of(name: str, trouble: str = "") -> tuple[VirtualRun, str]:
    line = LINES[name].read_text()
    recipe = (LINES[name].parent / tomllib.loads(line)["station"][0]["recipe"]).read_text()
    return (
        prepare(line + trouble, recipe, duration_s=12.0, rate="fit", allow_omega_write=True).go(),
        recipe,
    )


@pytest.mark.parametrize("trouble", ["", FAULTS], ids=["undisturbed", "disturbed"])
@pytest.mark.parametrize("name", LINES)
def test_every_write_of_every_family_is_the_recipe_s_or_makes_safe(name: str, trouble: str) -> None:
    run, recipe = run_of(name, trouble)
    family = tomllib.loads(LINES[name].read_text())["station"][0]["family"]
    assert strange_writes(run.heard, family, recipe, run.facts.ports, omega_may_write=True) == []
    if not trouble:
        assert run.facts.outcome == "completed"
        assert len(run.writes) >= 2 or family == "omega"


def test_a_condition_of_omega_is_written_as_in_the_recipe_and_only_where_allowed() -> None:
    line = LINES["omega"].read_text()
    recipe = (
        (PROFILES / "recipes" / "omega-point.toml")
        .read_text()
        .replace("preheat_s = 0.8", "preheat_s = 0.9")
    )
    for allowed in (True, False):
        run = prepare(line, recipe, duration_s=5.0, allow_omega_write=allowed).go()
        assert [one.text for one in run.heard if one.text[0] == "D"] == (
            ["D0065000301406400506400901E050005064" + "00A0000000" + "0A0C8"] if allowed else []
        )
        assert strange_writes(run.heard, "omega", recipe, omega_may_write=allowed) == []


@pytest.mark.parametrize("allowed", [True, False])
def test_omega_s_condition_is_on_the_list_only_where_that_is_allowed(allowed: bool) -> None:
    recipe = (PROFILES / "recipes" / "omega-point.toml").read_text()
    run = prepare(
        LINES["omega"].read_text(), recipe, duration_s=5.0, allow_omega_write=allowed
    ).go()
    (context,) = run.contexts.values()
    condition = condition_of(context.recipe, context.family)
    assert condition is not None
    with (
        nullcontext() if allowed else pytest.raises(WriteForbidden, match="the run does not allow")
    ):
        context.listed_writes()(context.command("store_condition"), condition, None, None)


@pytest.mark.parametrize(
    "text",
    [
        *(
            "WST100355",
            "WST300350",
            "WA1200001",
            "WPS100010",
            "WPS100002",
            "WSTP00000",
            "WRST00000",
            "WRSP",
            "WNVS00000",
        ),
        *(
            "WMAT00400",
            "WSAD00002",
            "WIFE00001",
            "WSTR00000",
            "WD1200006",
            "WHD100.60",
            "WHA199999",
            "WXX1",
        ),
    ],
)
def test_the_list_is_no_sieve(text: str) -> None:
    assert strange_writes([Heard(0.0, text, None, None)], "dde", RECIPE, (1, 2)) == [text]


# -- what the run's own client refuses -------------------------------------------------------------


def test_the_table_names_commands_that_there_are_and_none_that_is_dangerous() -> None:
    known = {
        name: command for family in FAMILIES.values() for name, command in family.commands.items()
    }
    assert set(RUN_WRITES) <= set(known)
    # which wants --allow-omega-write
    assert [name for name in RUN_WRITES if known[name].dangerous] == ["store_condition"]
    assert all(known[name].writable for name in RUN_WRITES)


def slips_in(
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    value: object,
    port: int | None,
    tool: int | None = None,
) -> None:
    """Simulate a bug: in the middle of a run, the program writes something unrequested."""
    write_before_sampling(monkeypatch, name, value, port, tool)


@pytest.mark.parametrize(
    ("name", "value", "port", "tool", "why"),
    [
        (
            "restart",
            0,
            None,
            None,
            "dde-1: restart is nothing that a run may write; it was not sent",
        ),
        (
            "maximum_temperature",
            400,
            None,
            None,
            "dde-1: maximum temperature is nothing that a run may write; it was not sent",
        ),
        (
            "selected_temperature",
            355,
            1,
            None,
            "dde-1: selected temperature of port 1: the run does not allow 355; it was not sent",
        ),
        (
            "selected_temperature",
            350,
            4,
            None,
            "dde-1: selected temperature of port 4: the run does not allow 350; it was not sent",
        ),
        (
            "sleep_delay",
            350,
            1,
            None,
            "dde-1: sleep delay of port 1: the run does not allow 350; it was not sent",
        ),  # 350 °C are another's
        (
            "sleep_delay",
            5,
            1,
            9,
            "dde-1: sleep delay of port 1: the run does not allow 5; it was not sent",
        ),
        ("adjust", 1, 1, 2, "dde-1: adjust of port 1: the run does not allow 1; it was not sent"),
        (
            "status",
            (0, 0, 0, 1, 0),
            1,
            None,
            "dde-1: status of port 1: the run does not allow 00010; it was not sent",
        ),
    ],
)
def test_what_is_not_on_the_list_is_refused_and_the_tools_are_made_safe(
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    value: object,
    port: int | None,
    tool: int | None,
    why: str,
) -> None:
    assert name in FAMILIES["dde"].commands
    slips_in(monkeypatch, name, value, port, tool)
    run = prepare(line_text(), duration_s=5.0).go()
    assert (run.facts.outcome, run.facts.reason) == ("failed", why)
    assert strange_writes(run.heard, "dde", RECIPE) == []
    assert run.facts.safe_state == dict.fromkeys(run.facts.touched, "verified")
    assert [one.text for one in run.writes][-1].startswith("WPS")


def test_a_person_s_client_is_not_bound_by_it() -> None:
    from support.product import LineFormat, Station, pull

    station = Station(LineFormat(19200, "8N1"))
    asked = pull(station.write(FAMILIES["dde"].commands["maximum_temperature"], 400))
    assert b"WMAT00400" in asked.data  # type: ignore[union-attr]
