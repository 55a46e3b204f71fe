"""A model name that no table has, accepted by the key `model` of the line file: the station is
driven as its family, once its answers prove the family.
"""

from __future__ import annotations

import pytest

from support.product import Problems, lease_of
from support.virtual.virtual_run import RECIPE, VirtualRun, prepare

LINE = """[line]
name = "bench"

[[station]]
name = "s-1"
url = "s-1"
family = "{family}"
{keys}
[station.sim]
turnaround_ms = 1.0
{sim}
"""
AIR = """[recipe]
name = "air"
revision = 1
families = ["jtse"]

[air]
temperature_c = 320

[run]
status = "on"
"""
HOT_AIR_CALLED_DIE = 'family = "jtse"\nmodel = "DIE"\ntool = 1'
AWAY = "\n[[station.sim.fault]]\nkind = 'dropout'\nat_s = 4\nfor_s = 3\n"


def run_of(
    family: str, keys: str = "", sim: str = "", recipe: str = RECIPE, duration_s: float = 3.0
) -> VirtualRun:
    return prepare(LINE.format(family=family, keys=keys, sim=sim), recipe, duration_s=duration_s)


def assert_refused_untouched(run: VirtualRun, *told: str) -> None:
    """The run is refused with these words (exit code 3), and the station's own log has no write."""
    assert run.facts.outcome == "refused"
    for text in told:
        assert text in run.facts.reason
    assert run.station.log.writes == []
    assert [one.text for one in run.heard if one.text[0] != "R"] == []


# -- driven ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("family", "model", "recipe"),
    [
        ("dde", "DIE", RECIPE),
        ("hde", "DME", RECIPE),
        ("soldering", "NASE", RECIPE),
        ("jtse", "JTQE", AIR),
    ],
)
def test_it_is_driven_as_the_family_says_and_the_record_says_so(
    family: str, model: str, recipe: str
) -> None:
    sim = f'model = "{model}"' + ("\ntool = 1" if family == "jtse" else "")
    run = run_of(family, f'ports = [1]\nmodel = "{model}"', sim, recipe).go()
    assert (run.facts.outcome, run.facts.family, run.facts.model, run.facts.model_accepted) == (
        "completed",
        family,
        model,
        True,
    )
    (event,) = run.memory.of_kind("station.model_accepted")
    assert (
        event.text
        == f"The station says model {model} and is driven as {family}, as the line file's key"
        " `model` accepts."
    )
    assert event.raw == model
    assert lease_of(run.facts).model_accepted
    first = next(place for place, one in enumerate(run.heard) if one.text.startswith("W"))
    proof = ["RAT1", "RMAF"] if family == "jtse" else ["RTT1", "RQT1"]
    asked = [one.text for one in run.heard[:first]]
    assert all(asked.count(question) >= 2 for question in proof), "borne out before the first write"


def test_without_the_key_nothing_is_asked_that_was_not_before() -> None:
    run = run_of("dde", "ports = [1]").go()
    assert run.memory.of_kind("station.model_accepted") == []
    assert not run.facts.model_accepted
    assert not lease_of(run.facts).model_accepted
    assert {one.text for one in run.heard} & {"RAT1", "RMAF"} == set()


def test_after_an_outage_it_is_known_by_its_accepted_name_and_kind() -> None:
    run = run_of("dde", 'ports = [1]\nmodel = "DIE"', f'model = "DIE"{AWAY}', duration_s=12).go()
    assert len(run.memory.of_kind("link.back")) == 1
    assert run.facts.outcome == "completed"
    assert run.facts.safe_state == {1: "verified"}


@pytest.mark.parametrize("name", ["DDE", "ZZQ"])
def test_after_an_outage_another_name_is_another_station(name: str) -> None:
    run = run_of("dde", 'ports = [1]\nmodel = "DIE"', f'model = "DIE"{AWAY}', duration_s=12)

    def exchange() -> None:
        run.station.device.identity.model = name

    run.at(5, exchange)
    run.go()
    (event,) = run.memory.of_kind("identity.changed")
    assert f"a {name}, not the DIE" in event.text
    assert [one.text for one in run.writes if one.at > run.t0 + 5] == []


def test_after_an_outage_hot_air_under_the_accepted_name_is_never_told_a_status() -> None:
    """00001 is "stand" for a soldering tool and "on" for hot air. A model name that no table has
    proves neither kind.
    """
    run = run_of("dde", 'ports = [1]\nmodel = "DIE"', f'model = "DIE"{AWAY}', duration_s=12)
    hears = run.station.device.answer

    def of_hot_air(header: str, text: str, now: float) -> object:
        if now < run.t0 + 5 or text in ("SMN", "SVR"):
            return hears(header, text, now)
        return ("A", "AT100300") if header + text == "RAT1" else ("N", "00004")

    run.station.device.answer = of_hot_air  # type: ignore[assignment,method-assign]
    run.go()
    (event,) = run.memory.of_kind("identity.changed")
    assert "a DIE of another kind (it " in event.text
    assert [one.text for one in run.writes if one.at > run.t0 + 5] == []


# -- refused ---------------------------------------------------------------------------------------


def test_hot_air_that_calls_itself_die_is_never_told_a_status() -> None:
    """00001 is "stand" for a soldering tool and "on" for hot air."""
    run = run_of("dde", 'ports = [1]\nmodel = "DIE"', HOT_AIR_CALLED_DIE).go()
    assert_refused_untouched(
        run,
        "model DIE is driven as dde by the line file, but it does not answer R-TT1",
        "Nothing was written",
    )


def test_hot_air_under_a_soldering_family_with_its_own_name_is_no_line_file() -> None:
    with pytest.raises(Problems, match="JTQE"):
        run_of("dde", 'model = "JTQE"', HOT_AIR_CALLED_DIE.replace("DIE", "JTQE"))


def test_a_soldering_station_that_calls_itself_jtqe_is_never_told_a_status() -> None:
    run = run_of("jtse", 'model = "JTQE"', 'family = "dde"\nmodel = "JTQE"', AIR).go()
    assert_refused_untouched(
        run, "model JTQE is driven as jtse by the line file, but it does not answer R-AT1"
    )


def test_one_that_answers_the_reads_of_both_kinds_is_of_neither() -> None:
    run = run_of("dde", 'ports = [1]\nmodel = "DIE"', 'model = "DIE"')
    hears = run.station.device.answer

    def both(header: str, text: str, now: float) -> object:
        return ("A", "AT100300") if header + text == "RAT1" else hears(header, text, now)

    run.station.device.answer = both  # type: ignore[assignment,method-assign]  # a station that nobody has met
    assert_refused_untouched(
        run.go(), "but it answers R-AT1, which only another kind of station does"
    )


def test_another_name_than_the_accepted_one_is_refused_though_it_proves_the_family() -> None:
    run = run_of("dde", 'ports = [1]\nmodel = "DIE"', 'model = "DDE"').go()
    assert_refused_untouched(
        run,
        "the line file accepts model DIE, the station says model DDE; nothing was written to it",
    )


@pytest.mark.parametrize(
    ("family", "sim", "told"),
    [
        (
            "auto",
            'family = "dde"\nmodel = "DIE"',
            'name its family in the line file in place of "auto", and add model = "DIE"',
        ),
        (
            "dde",
            'model = "DIE"',
            "correct the cable; if it is the right one, correct `family`, or, if its label says"
            ' DDE, add model = "DIE"',
        ),
        (
            "hde",
            'model = "DME"',
            'correct the cable; if it is the right one, correct `family` to "dme", or, if its'
            ' label says HDE, add model = "DME"',
        ),
    ],
)
def test_without_the_key_the_refusal_says_what_to_write(family: str, sim: str, told: str) -> None:
    assert_refused_untouched(run_of(family, "ports = [1]", sim).go(), told)


def test_no_key_is_proposed_across_kinds() -> None:
    run = run_of("dde", "ports = [1]", HOT_AIR_CALLED_DIE.replace("DIE", "JTSE")).go()
    assert_refused_untouched(run, 'if it is the right one, correct `family` to "jtse"')
    assert "add model" not in run.facts.reason
