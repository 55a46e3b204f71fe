"""The line file's key `model` in `write`, `safe`, `read`, `audit`: one name, one proof."""

from __future__ import annotations

import pytest

from jbclog.app import safe_state
from jbclog.sim.port import WORKING
from support.virtual.manual import Bench, Make

DIE = """[[station]]
name = "s-1"
url = "s-1"
family = "{family}"
{keys}
[station.sim]
{sim}
settings = {{ {settings} }}
"""
DELAYS = "sleep_delay = 5, hibernation_delay = 30"
STAND = ("write", "s-1", "status", "stand", "--port", "1")


@pytest.fixture(autouse=True)
def _no_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(safe_state, "runs_that_hold", lambda urls: [])


def die(
    family: str = "dde",
    keys: str = 'ports = [1]\nmodel = "DIE"',
    sim: str = 'model = "DIE"',
    settings: str = DELAYS,
) -> str:
    return DIE.format(family=family, keys=keys, sim=sim, settings=settings)


def hot_air_called_die() -> str:
    return die(sim='family = "jtse"\nmodel = "DIE"\ntool = 1', settings="")


def writes(bench: Bench) -> list[str]:
    return bench.wires["s-1"].writes


def test_it_is_written_to_as_the_family_says(make: Make) -> None:
    bench = make(die())
    assert bench.do(*STAND).code == 0
    assert bench.do("write", "s-1", "selected_temperature", "300", "--port", "1").code == 0
    assert writes(bench) == ["WPS100001", "WST100300"]


def test_its_tools_are_made_safe_as_the_family_says(make: Make) -> None:
    bench = make(die())
    bench.wires["s-1"].station.plant.ports[1].order(WORKING, False)  # type: ignore[union-attr]
    bench.wait(20)
    assert bench.do("safe").code == 0
    assert "WPS100001" in writes(bench)


@pytest.mark.parametrize(
    "words", [STAND, ("write", "s-1", "selected_temperature", "300", "--port", "1")]
)
def test_hot_air_that_calls_itself_die_is_never_written_to(
    make: Make, words: tuple[str, ...]
) -> None:
    bench = make(hot_air_called_die())
    ended = bench.do(*words)
    assert ended.code == 3
    assert "model DIE is driven as dde by the line file, but it does not answer R-TT1" in ended.err
    assert bench.wires["s-1"].station.log.writes == []
    assert writes(bench) == []


def test_hot_air_that_calls_itself_die_is_told_no_status_by_safe(make: Make) -> None:
    bench = make(hot_air_called_die())
    ended = bench.do("safe")
    assert ended.code == 5
    assert "it does not answer R-TT1" in ended.err + ended.out
    assert "switch the station off" in ended.err + ended.out
    assert bench.wires["s-1"].station.log.writes == []
    assert writes(bench) == []


def test_hot_air_under_a_soldering_family_is_wrong_usage(make: Make) -> None:
    bench = make(die())
    bench.line.write_text(bench.line.read_text().replace('model = "DIE"', 'model = "JTQE"', 1))
    for words in (STAND, ("safe",), ("read", "s-1")):
        ended = bench.do(*words)
        assert (ended.code, '"JTQE" begins with JT' in ended.err) == (2, True)
    assert bench.wires["s-1"].opened == 0


def test_without_the_key_the_refusal_says_what_to_write(make: Make) -> None:
    bench = make(die(keys="ports = [1]"))
    ended = bench.do(*STAND)
    assert (ended.code, 'if its label says DDE, add model = "DIE"' in ended.err) == (3, True)
    bench.line.write_text(bench.line.read_text().replace('family = "dde"', 'family = "auto"', 1))
    ended = bench.do(*STAND)
    assert (ended.code, 'in place of "auto", and add model = "DIE"' in ended.err) == (3, True)
    assert writes(bench) == []


def test_another_name_than_the_accepted_one_is_not_written_to(make: Make) -> None:
    bench = make(die(sim='model = "ZZQ"'))
    ended = bench.do(*STAND)
    assert (
        ended.code,
        "the line file accepts model DIE, the station says model ZZQ" in ended.err,
    ) == (3, True)
    assert bench.do("safe").code == 5
    assert writes(bench) == []


def test_it_is_read_without_a_note(make: Make) -> None:
    ended = make(die()).do("read", "s-1", "model")
    assert (ended.code, ended.out.strip(), ended.err) == (0, "DIE", "")


def test_its_counters_are_audited(make: Make) -> None:
    bench = make(die())
    ended = bench.do("audit", "--ledger", "ledger.jsonl", "--json")
    assert '"model": "DIE"' in ended.out
    assert '"why": ""' in ended.out or '"seen": true' in ended.out
    assert writes(bench) == []
