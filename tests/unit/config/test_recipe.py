"""Recipes: what they hold, and that everything wrong with one is told at once, with file, line, key
and what is allowed.
"""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

import pytest
from pydantic import ValidationError

from jbclog.config.load_recipe import load_recipe, parse_recipe, warnings
from jbclog.config.recipe import Recipe
from jbclog.core.errors import Problems
from jbclog.core.quantities import OFF
from jbclog.protocol.commands.family import FAMILIES
from support.campaigns.each_row import each_row

HEAD = '[recipe]\nname = "job"\nrevision = 1\nfamilies = ["dde", "ucr", "ale"]\n'


def problems(text: str) -> list[str]:
    with pytest.raises(Problems) as found:
        parse_recipe(text, Path("job.toml"))
    assert found.value.exit_code == 2
    return [str(problem) for problem in found.value.problems]


def only_problem(text: str) -> str:
    (problem,) = problems(text)
    return problem


# -- what a recipe holds ---------------------------------------------------------------------------


def test_only_the_head_is_required_and_nothing_is_asked_by_itself() -> None:
    recipe = parse_recipe(HEAD)
    assert (recipe.name, recipe.revision, recipe.families) == ("job", 1, ("dde", "ucr", "ale"))
    assert recipe.asked(1) == {}
    assert recipe.acceptance is None
    assert recipe.run.status is None
    assert (recipe.run.safe_state, recipe.run.require_tool, recipe.run.on_difference) == (
        "stand",
        True,
        "stop",
    )
    assert (recipe.sampling.alarms_every_s, recipe.sampling.counters_every_s) == (2, 60)
    assert [recipe.rate_hz(FAMILIES[name]) for name in ("dde", "jtse", "omega")] == [10, 10, 1]
    assert recipe.rate_hz(None) == 10


def test_a_rate_that_is_named_holds_for_every_family() -> None:
    recipe = parse_recipe(HEAD + "[sampling]\nrate_hz = 2.5\n")
    assert {recipe.rate_hz(family) for family in FAMILIES.values()} == {2.5}
    assert {recipe.asked_rate(family) for family in FAMILIES.values()} == {2.5}


def test_what_becomes_of_a_serial_that_was_read_before() -> None:
    assert parse_recipe(HEAD).units.repeat == "continue"
    assert parse_recipe(HEAD + '[units]\nrepeat = "refuse"\n').units.repeat == "refuse"
    with pytest.raises(Problems, match=r'units.repeat: "stop" is not allowed; continue or refuse'):
        parse_recipe(HEAD + '[units]\nrepeat = "stop"\n')


def test_a_rate_may_be_left_to_the_run_and_the_usual_one_is_its_upper_end() -> None:
    recipe = parse_recipe(HEAD + '[sampling]\nrate_hz = "auto"\n')
    assert {recipe.asked_rate(family) for family in FAMILIES.values()} == {"auto"}
    assert recipe.rate_hz(FAMILIES["dde"]) == 10
    assert parse_recipe(HEAD).asked_rate(FAMILIES["dde"]) == 10


@pytest.mark.parametrize(
    "rate", ['"fit"', '"max"', '"Auto"', "true", "nan", "inf", "0", "-1", "1000.1", "[]"]
)
def test_other_rates_are_refused_in_one_sentence(rate: str) -> None:
    with pytest.raises(Problems) as refused:
        parse_recipe(HEAD + f"[sampling]\nrate_hz = {rate}\n")
    (problem,) = refused.value.problems
    assert str(problem).endswith('is not allowed; Hz, from 0.001 to 1000, or "auto"')


def test_a_port_of_its_own_wins_key_by_key() -> None:
    recipe = parse_recipe(
        HEAD + "[temperature]\nselect_c = 350\nadjust_c = -5\n[port.2.temperature]\nselect_c ="
        " 330\n[port.2.alarm.high]\nlimit_c = 360\n"
    )
    assert {key: one.value for key, one in recipe.asked(1).items()} == {
        "temperature.select_c": 350,
        "temperature.adjust_c": -5,
    }
    assert {key: one.value for key, one in recipe.asked(2).items()} == {
        "temperature.select_c": 330,
        "temperature.adjust_c": -5,
        "alarm.high.limit_c": 360,
    }
    assert recipe.ports_named() == (2,)


def test_off_is_a_value_of_delays() -> None:
    recipe = parse_recipe(
        HEAD
        + '[sleep]\ndelay_min = "off"\n[alarm.low]\ndelay_s = "off"\n[hibernation]\ndelay_min = 0\n'
        + "[run]\nallow_no_cooldown = true\n"
    )
    assert {key: one.value for key, one in recipe.asked().items()} == {
        "sleep.delay_min": OFF,
        "alarm.low.delay_s": OFF,
        "hibernation.delay_min": 0,
    }


def test_text_path_and_hash_are_those_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "with windows line ends.toml"
    data = ("\ufeff" + HEAD).replace("\n", "\r\n").encode()
    path.write_bytes(data)
    recipe = load_recipe(path)
    assert recipe.text.encode() == data
    assert recipe.sha256 == hashlib.sha256(data).hexdigest()
    assert recipe.path == path


def test_a_recipe_cannot_be_changed() -> None:
    recipe = parse_recipe(HEAD)
    with pytest.raises(ValidationError):
        recipe.run.allow_no_cooldown = True  # type: ignore[misc]
    with pytest.raises(ValidationError):
        recipe.sampling = recipe.sampling  # type: ignore[misc]


def test_hot_air_cools_and_everything_else_stands_unless_the_recipe_says_so() -> None:
    recipe = parse_recipe(HEAD.replace('"ale"', '"jtse"'))
    assert [recipe.safe_state(family) for family in ("dde", "ucr", "jtse")] == [
        "stand",
        "stand",
        "cooling",
    ]
    said = parse_recipe(
        '[recipe]\nname = "j"\nrevision = 1\nfamilies = ["jtse"]\n[run]\nsafe_state = "off"\n'
    )
    assert said.safe_state("jtse") == "off"


# -- what is wrong with one, all at once -----------------------------------------------------------


def test_everything_that_is_wrong_is_told_at_once_with_line_and_key() -> None:
    text = """[recipe]
name = "bad name"
families = ["dde", "dd"]
colour = 1

[temperature]
select_c = 352
adjust_c = 51
slect_c = 350

[sleep]
temperature_c = 400
delay_min = 10

[hibernation]
delay_min = 12

[alarm.high]
limit_c = 340
delay_s = 100

[alarm.low]
limit_c = "off"

[port.2.temperature]
select_c = 350.0

[port.2.alarm.low]
limit_c = 355

[feeder]
mode = "fast"

[sampling]
rate_hz = 0

[run]
safe_state = "cooling"
on_difference = "ignore"

[metadata]
required = ["oprator"]

[acceptance]
coverage_percent = 101

[lighting]
on = true
"""
    assert problems(text) == [
        "job.toml:1: recipe.revision: missing; a whole number from 0 on",
        (
            'job.toml:2: recipe.name: "bad name" is not allowed; 1 to 64 of the characters A-Z a-z'
            " 0-9 . _ -, the first of them a letter, a digit or _"
        ),
        'job.toml:3: recipe.families[2]: "dd" is unknown; did you mean dde?',
        "job.toml:4: recipe.colour: unknown; allowed here: name, revision, families",
        (
            "job.toml:7: temperature.select_c: 352 °C is not allowed; steps of 5 °C, within what"
            " the station itself allows"
        ),
        "job.toml:8: temperature.adjust_c: 51 °C is not allowed; -50 to 50 °C, in steps of 1",
        "job.toml:9: temperature.slect_c: unknown; did you mean select_c?",
        "job.toml:12: sleep.temperature_c: 400 °C must not be above temperature.select_c (352 °C)",
        'job.toml:13: sleep.delay_min: 10 min is not allowed; 0 to 9 min, in steps of 1, or "off"',
        (
            "job.toml:16: hibernation.delay_min: 12 min is not allowed; 0 to 60 min, in steps of 5,"
            ' or "off"'
        ),
        "job.toml:19: alarm.high.limit_c: 340 °C must be above temperature.select_c (352 °C)",
        (
            "job.toml:20: alarm.high.delay_s: 100 s is not allowed; 0 to 99.99 s, in steps of 0.01,"
            ' or "off"'
        ),
        (
            'job.toml:23: alarm.low.limit_c: "off" is not allowed; no manual prints how to clear a'
            ' limit: use delay_s = "off"'
        ),
        "job.toml:26: port.2.temperature.select_c: 350.0 is not allowed; whole °C",
        "job.toml:29: port.2.alarm.low.limit_c: 355 °C must be below temperature.select_c (352 °C)",
        "job.toml:29: port.2.alarm.low.limit_c: 355 °C must be below alarm.high.limit_c (340 °C)",
        "job.toml:31: feeder: fits none of the families listed (dde); it is for ale",
        (
            'job.toml:32: feeder.mode: "fast" is not allowed; one of continuous, discontinuous,'
            " program, reload"
        ),
        'job.toml:35: sampling.rate_hz: 0 is not allowed; Hz, from 0.001 to 1000, or "auto"',
        (
            'job.toml:38: run.safe_state: "cooling" is not allowed on dde, which the recipe lists;'
            " it allows stand, extractor"
        ),
        'job.toml:39: run.on_difference: "ignore" is not allowed; stop or continue',
        'job.toml:42: metadata.required[1]: "oprator" is unknown; did you mean operator?',
        "job.toml:45: acceptance.coverage_percent: 101 is not allowed; 0 to 100",
        (
            "job.toml:47: lighting: unknown; allowed here: temperature, sleep, hibernation, alarm,"
            " recipe, port, feeder, air, omega, sampling, run, episodes, metadata, units, joints,"
            " acceptance"
        ),
    ]


@each_row(
    (f"{row}", row)
    for row in [
        ("temperature", "select_c", "352"),
        ("temperature", "select_c", "true"),
        ("temperature", "select_c", "350.0"),
        ("temperature", "select_c", '"350"'),
        ("temperature", "select_c", "100000"),
        ("temperature", "adjust_c", "-51"),
        ("temperature", "adjust_c", "51"),
        ("temperature", "adjust_c", "1.5"),
        ("sleep", "temperature_c", "100000"),
        ("sleep", "temperature_c", "151"),
        ("sleep", "delay_min", "10"),
        ("sleep", "delay_min", "-1"),
        ("sleep", "delay_min", "1.5"),
        ("sleep", "delay_min", "99999"),
        ("sleep", "delay_min", '"never"'),
        ("sleep", "delay_min", "true"),
        ("hibernation", "delay_min", "7"),
        ("hibernation", "delay_min", "65"),
        ("alarm.high", "limit_c", "381"),
        ("alarm.high", "limit_c", "0"),
        ("alarm.high", "limit_c", "605"),
        ("alarm.high", "limit_c", "3800"),
        ("alarm.low", "limit_c", "-5"),
        ("port.2.alarm.low", "limit_c", "99995"),
        ("alarm.high", "delay_s", "1.605"),
        ("alarm.high", "delay_s", "100"),
        ("alarm.low", "delay_s", "-0.01"),
        ("alarm.low", "delay_s", "false"),
        ("alarm.low", "delay_s", "nan"),
        ("alarm.low", "delay_s", "inf"),
        ("port.1.temperature", "select_c", "352"),
        ("port.1.alarm.low", "limit_c", "301"),
        ("feeder", "length_mm", "5.05"),
        ("feeder", "length_mm", "10000"),
        ("feeder", "length_mm", "1e300"),
        ("feeder", "speed_mm_s", "0"),
        ("feeder", "speed_mm_s", "0.05"),
        ("feeder", "diameter_mm", "0.005"),
        ("feeder", "backward_mm", "-1"),
        ("feeder", "clog_detection", "1"),
        ("feeder", "mode", "0"),
        ("sampling", "rate_hz", "1001"),
        ("sampling", "alarms_every_s", "0"),
        ("sampling", "counters_every_s", "0.5"),
        ("run", "status", '"sleep"'),
        ("run", "require_tool", "1"),
        ("acceptance", "alarms_max", "-1"),
        ("acceptance", "alarms_max", "1.0"),
        ("acceptance", "idle_sd_c", "nan"),
        ("acceptance", "longest_gap_s", "-inf"),
        ("acceptance", "recovery_p95_s", "0"),
        ("acceptance", "recovery_p95_s", "10.1"),
        ("acceptance", "joints_against_counter_percent", "-1"),
        ("acceptance", "joints_against_counter_percent", "101"),
        ("metadata", "required", '["tag."]'),
        ("metadata", "required", '["order", "order"]'),
        ("metadata", "required", '"order"'),
        ("recipe", "x", "1"),
    ]
)
def test_a_value_that_is_not_allowed_is_told_where_it_stands(
    section: str, key: str, value: str
) -> None:
    told = problems(
        f"{HEAD}\n[{section}]\n{key} = {value}\n"
        if section != "recipe"
        else f"{HEAD}\n{key} = {value}\n"
    )
    line = 7 if section != "recipe" else 6
    assert told
    assert all(one.startswith(f"job.toml:{line}: {section}.{key}") for one in told)


def test_an_alarm_limit_that_would_be_read_as_not_set_is_told_with_what_is_allowed() -> None:
    assert (
        only_problem(HEAD + "[alarm.high]\nlimit_c = 3800\n")
        == "job.toml:6: alarm.high.limit_c: 3800 °C would be read back as not set; 1 to 600 °C;"
        " steps of 5 °C"
    )


@pytest.mark.parametrize(
    ("section", "key", "value"),
    [
        ("temperature", "adjust_c", "-50"),
        ("temperature", "adjust_c", "50"),
        ("sleep", "delay_min", "0"),
        ("sleep", "delay_min", "9"),
        ("hibernation", "delay_min", "60"),
        ("alarm.high", "limit_c", "5"),
        ("alarm.high", "limit_c", "600"),
        ("alarm.high", "delay_s", "0"),
        ("alarm.high", "delay_s", "99.99"),
        ("alarm.low", "delay_s", "1.6"),
        ("feeder", "length_mm", "9999.9"),
        ("feeder", "length_mm", "5"),
        ("feeder", "diameter_mm", "0.01"),
        ("run", "status", '"stand"'),
        ("metadata", "required", '["tag.shift", "unit"]'),
    ],
)
def test_a_value_at_the_edge_of_its_range_is_taken(section: str, key: str, value: str) -> None:
    assert isinstance(parse_recipe(f"{HEAD}\n[{section}]\n{key} = {value}\n"), Recipe)


@each_row(
    (repr(row[0]), row)
    for row in [
        ("a = ", "job.toml:1: this is not TOML: Invalid value"),
        ("[recipe]\nname = 'x\n", 'job.toml:2: this is not TOML: Expected "\'"'),
        ("[recipe]\nname = 1\nname = 2\n", "job.toml:3: recipe.name: given twice, first in line 2"),
        ("[sleep]\n[run]\n[sleep]\n", "job.toml:3: sleep: given twice, first in line 1"),
        (
            "a = 1979-13-01",
            "job.toml:1: this is not TOML: Expected newline or end of document after a statement",
        ),
        (
            HEAD + "sleep = 5\n",
            "job.toml:5: recipe.sleep: unknown; allowed here: name, revision, families",
        ),
        ("sleep = 5\n" + HEAD, "job.toml:1: sleep: must be a table (got 5)"),
        (
            HEAD + "[port.5.sleep]\ndelay_min = 1\n",
            'job.toml:5: port.5: "5" is not allowed; a port is 1, 2, 3 or 4',
        ),
        (
            HEAD + "[port.3.sleep]\ndelay_min = 1\n",
            "job.toml:5: port.3: none of the families listed (dde, ucr, ale) has a port 3",
        ),
        (
            HEAD + "[acceptance]\n",
            "job.toml:5: acceptance: names no limit; without the table the run is not judged",
        ),
        (
            HEAD.replace('"ale"', '"nae"') + "[acceptance]\njoints_against_counter_percent = 2\n",
            (
                "job.toml:6: acceptance.joints_against_counter_percent: fits none of the families"
                " listed (dde, ucr, nae); it is for ale"
            ),
        ),
        ('[recipe]\nname = "x"\nrevision = 1\nfamilies = []\n', None),
        (HEAD.replace('"ucr"', '"dde"'), 'job.toml:4: recipe.families: "dde" is listed twice'),
        (HEAD.replace('"job"', '"j\\u202eob"'), None),
        (
            # a manifest cannot hold it: the run would be recorded, and unreadable
            HEAD + "[acceptance]\nalarms_max = 99999999999999999999\n",
            (
                "job.toml:6: acceptance.alarms_max: 99999999999999999999 is not allowed; numbers"
                " are at most 4.61169e+18"
            ),
        ),
        (
            HEAD + "[acceptance]\nlongest_gap_s = 1e308\n",
            (
                "job.toml:6: acceptance.longest_gap_s: 1e+308 is not allowed; numbers are at most"
                " 4.61169e+18"
            ),
        ),
        (
            HEAD.replace("revision = 1", "revision = 99999999999999999999"),
            (
                "job.toml:3: recipe.revision: 99999999999999999999 is not allowed; a whole number"
                " from 0 on"
            ),
        ),
        (
            HEAD + "# \u202e hidden\n",
            "job.toml:5: contains a hidden character: right-to-left override (U+202E); remove it",
        ),
    ]
)
def test_what_is_wrong_with_a_file_as_a_whole(text: str, problem: str | None) -> None:
    if problem is None:
        assert all(
            one.startswith(("job.toml:2: recipe.name: ", "job.toml:4: recipe.families: "))
            for one in problems(text)
        )
    else:
        assert only_problem(text) == problem


# -- what belongs together -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sections", "problem"),
    [
        (
            "[alarm.high]\nlimit_c = 350\n",
            "8: alarm.high.limit_c: 350 °C must be above temperature.select_c (350 °C)",
        ),
        (
            "[alarm.low]\nlimit_c = 350\n",
            "8: alarm.low.limit_c: 350 °C must be below temperature.select_c (350 °C)",
        ),
        (
            "[sleep]\ntemperature_c = 355\n",
            "8: sleep.temperature_c: 355 °C must not be above temperature.select_c (350 °C)",
        ),
        (
            "[alarm.high]\nlimit_c = 380\n[port.2.temperature]\nselect_c = 400\n",
            "10: port.2.temperature.select_c: 400 °C must be below alarm.high.limit_c (380 °C)",
        ),
        (
            "[port.2.alarm.low]\nlimit_c = 360\n",
            "8: port.2.alarm.low.limit_c: 360 °C must be below temperature.select_c (350 °C)",
        ),
        (
            "[feeder]\nlength_mm = 1\nbackward_mm = 2\n",
            "9: feeder.backward_mm: pulls back more than feeder.length_mm (1 mm) feeds",
        ),
        (
            "[air]\ntemperature_c = 300\n",
            "7: air: fits none of the families listed (dde, ucr, ale); it is for jtse",
        ),
    ],
)
def test_keys_that_contradict_each_other(sections: str, problem: str) -> None:
    assert only_problem(f"{HEAD}[temperature]\nselect_c = 350\n{sections}") == f"job.toml:{problem}"


def test_what_is_equal_or_off_contradicts_nothing() -> None:
    parse_recipe(HEAD + "[temperature]\nselect_c = 350\n[sleep]\ntemperature_c = 350\n")
    parse_recipe(
        HEAD + '[temperature]\nselect_c = 350\n[alarm.high]\nlimit_c = 300\ndelay_s = "off"\n'
    )


@pytest.mark.parametrize("key", ["sleep", "hibernation"])
def test_a_delay_that_is_off_is_refused_where_stand_must_cool(key: str) -> None:
    text = HEAD + f'[{key}]\ndelay_min = "off"\n'
    sentence = (
        f'job.toml:6: {key}.delay_min: is "off", so a tool in stand never cools; give minutes, or'
        " run.allow_no_cooldown = true"
    )
    assert only_problem(text) == sentence
    assert only_problem(HEAD + f'[port.2.{key}]\ndelay_min = "off"\n').startswith(
        f"job.toml:6: port.2.{key}.delay_min: "
    )
    allowed = parse_recipe(text + "[run]\nallow_no_cooldown = true\n", Path("job.toml"))
    assert [str(one) for one in warnings(allowed)] == [sentence]
    assert warnings(parse_recipe(HEAD + "[run]\nallow_no_cooldown = true\n")) == []


def test_a_delay_that_is_off_is_refused_where_stand_follows_on_the_safe_state() -> None:
    told = only_problem(HEAD + '[sleep]\ndelay_min = "off"\n[run]\nsafe_state = "extractor"\n')
    assert told.startswith('job.toml:6: sleep.delay_min: is "off", so a tool in stand never cools')


@pytest.mark.parametrize("key", ["safe_state", "status"])
@pytest.mark.parametrize("family", ["dde", "nae", "dme", "hde", "ucr", "ale"])
def test_extractor_is_for_every_family_of_002(family: str, key: str) -> None:
    head = f'[recipe]\nname = "x"\nrevision = 0\nfamilies = ["{family}"]\n'
    assert getattr(parse_recipe(f'{head}[run]\n{key} = "extractor"\n').run, key) == "extractor"


@pytest.mark.parametrize("key", ["safe_state", "status"])
@pytest.mark.parametrize(("family", "allowed"), [("soldering", "stand"), ("jtse", "cooling, off")])
def test_extractor_is_for_no_other(family: str, allowed: str, key: str) -> None:
    head = f'[recipe]\nname = "x"\nrevision = 0\nfamilies = ["{family}"]\n'
    told = only_problem(f'{head}[run]\n{key} = "extractor"\n')
    assert f'"extractor" is not allowed on {family}' in told
    assert key != "safe_state" or told.endswith(f"it allows {allowed}")


def test_hot_air_and_omega_have_sections_of_their_own() -> None:
    condition = "".join(f"{field} = 1.5\n" for field in OMEGA_FIELDS)
    head = '[recipe]\nname = "x"\nrevision = 0\nfamilies = ["jtse", "omega"]\n'
    recipe = parse_recipe(
        head
        + '[air]\nflow_permille = 500\nmode = "manual"\n[omega]\ncondition = 101\nmode = 0\n'
        + condition
    )
    assert recipe.air.flow_permille == 500
    assert recipe.omega is not None
    assert recipe.omega.reverse3_mm_s == 1.5
    told = problems(
        head
        + "[air]\nflow_permille = 1001\n[omega]\ncondition = 200\nmode = 0\n"
        + condition.replace("1.5", "1.55", 1)
    )
    assert [one.partition(" is not allowed")[0] for one in told] == [
        "job.toml:6: air.flow_permille: 1001",
        "job.toml:8: omega.condition: 200",
        "job.toml:10: omega.rise_s: 1.55",
    ]


_FEED = ("feed{}_mm", "feed{}_mm_s", "reverse{}_mm", "reverse{}_mm_s")
OMEGA_FIELDS = (
    "rise_s",
    *(name.format(1) for name in _FEED),
    "preheat_s",
    *(name.format(2) for name in _FEED),
    "heating_s",
    *(name.format(3) for name in _FEED),
)


EPISODES = """
[recipe]
name = "a"
revision = 1
families = ["dde", "omega"]

[episodes]
"""


def test_how_samples_are_evaluated_is_asked_by_the_recipe() -> None:
    usual = parse_recipe(EPISODES).episodes
    assert usual.rules() == {"dead_band_c": 2.0, "stale_s": 60.0}
    asked = parse_recipe(EPISODES + "dead_band_c = 5\noff_delay_s = 0.5\nstale_s = 30\n").episodes
    assert asked.rules() == {"dead_band_c": 5.0, "off_delay_s": 0.5, "stale_s": 30.0}


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("dead_band_c = -1", "-1 is not allowed; °C from 0 to 100"),
        ("off_delay_s = 3601", "3601 is not allowed; seconds from 0 to 3600"),
        ("stale_s = 0", "0 is not allowed; seconds, more than 0 and up to 86400"),
        ("delay = 1", "unknown; did you mean off_delay_s?"),
    ],
)
def test_how_samples_may_not_be_evaluated(line: str, said: str) -> None:
    with pytest.raises(Problems, match=re.escape(said)):
        parse_recipe(EPISODES + line + "\n")


def test_suction_is_for_hot_air() -> None:
    head = '[recipe]\nname = "x"\nrevision = 0\nfamilies = ["{}"]\n'
    recipe = parse_recipe(
        head.format("jtse") + '[air]\nsuction = "on"\n[run]\nsafe_suction = "off"\n'
    )
    assert (recipe.suction, recipe.run.safe_suction) == ("on", "off")
    assert (
        parse_recipe(head.format("jtse")).suction,
        parse_recipe(head.format("jtse")).run.safe_suction,
    ) == ("keep", "keep")
    told = only_problem(head.format("dde") + '[run]\nsafe_suction = "off"\n')
    assert (
        told
        == "job.toml:6: run.safe_suction: fits none of the families listed (dde); it is for jtse"
    )
    assert '"lift" is not allowed; keep, on or off' in only_problem(
        head.format("jtse") + '[air]\nsuction = "lift"\n'
    )
    assert '"Off" is not allowed; did you mean off?' in only_problem(
        head.format("jtse") + '[run]\nsafe_suction = "Off"\n'
    )
    assert '"on" is not allowed; keep or off' in only_problem(
        head.format("jtse") + '[run]\nsafe_suction = "on"\n'
    )
