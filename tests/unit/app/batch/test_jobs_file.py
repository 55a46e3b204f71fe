"""Jobs files: everything that is wrong is told at once, with file, line and key; those that come
with the project can be run.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from jbclog.app.batch.child import SPEC
from jbclog.app.batch.job_dir import JobProgress
from jbclog.app.batch.job_spec import BatchPlan, plan_batch
from jbclog.app.run.plan import make_plan
from jbclog.cli.batch_progress import so_far
from jbclog.config.job_order import OnFailure
from jbclog.config.jobs_file import END_ALLOWED, JobsFile, load_jobs, parse_jobs
from jbclog.core.errors import Problems
from support.command import BENCH, PROFILES
from support.virtual.recorded_run import RecordedRun

BATCHES = sorted((PROFILES / "batches").glob("*.toml"))
RECIPES = PROFILES / "recipes"
HEAD = f'[batch]\nline = "{BENCH}"\n'
JOB = (
    f'[[job]]\nname = "a"\nrecipe = "{RECIPES / "sac305-smd.toml"}"\nstations = ["dde-1"]\nduration'
    ' = "15m"\nrate = "fit"\n'
)


def wrong(text: str) -> list[str]:
    with pytest.raises(Problems) as raised:
        parse_jobs(text, Path("night.toml"))
    return [str(problem) for problem in raised.value.problems]


def job(*lines: str, name: str = "a", end: str = 'duration = "15m"') -> str:
    return "\n".join(["[[job]]", f'name = "{name}"', end, *lines, ""])


def ordered(text: str, folder: Path = Path("/nowhere")) -> BatchPlan:
    return plan_batch(parse_jobs(text, folder / "night.toml"), folder / "runs")


def test_everything_that_is_wrong_is_told_at_once() -> None:
    text = (
        HEAD
        + "on_fail = 1\n"
        + job('at = "25:00"', 'families = ["dd"]', 'after = ["b", "zz"]')
        + job("units = 3", "rate = 0", name="b")
        + job(name="b", end="")
    )
    assert wrong(text) == [
        "night.toml:3: batch.on_fail: unknown; did you mean on_failure?",
        (
            'night.toml:7: job[1].at: "25:00" is not allowed; a time of day such as "22:00", or a'
            ' date with it such as "2026-11-22 02:30"'
        ),
        'night.toml:8: job[1].families[1]: "dd" is unknown; did you mean dde?',
        'night.toml:9: job[1].after[2]: "zz" is unknown; allowed here: a, b',
        (
            "night.toml:10: job[2].units_from: missing; units are counted by their serials: name"
            " the reader's device or a pipe"
        ),
        'night.toml:14: job[2].rate: 0 is not allowed; Hz up to 1000, "auto", "fit" or "max"',
        f"night.toml:15: job[3].duration: missing; {END_ALLOWED}",
        'night.toml:16: job[3].name: "b" is the name of two jobs, first in line 11',
    ]


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        (['units_frm = "x"'], "night.toml:6: job[1].units_frm: unknown; did you mean units_from?"),
        (
            ['stations = ["dde-1"]', 'families = ["dde"]'],
            "night.toml:7: job[1].families: cannot be combined with stations; give one of",
        ),
        (
            ['on_failure = "retry"'],
            'night.toml:6: job[1].on_failure: "retry" is not allowed; one of stop, skip, continue',
        ),
        (['after = ["a"]'], "night.toml:6: job[1].after: a waits for a: none of them could begin"),
        (['tags = { x = "" }'], 'night.toml:6: job[1].tags.x: "" is not allowed; names and texts'),
        (
            ['operator = "A\\u202eB"'],
            "night.toml:6: job[1].operator: contains a hidden character: right-to-left override"
            " (U+202E); remove it",
        ),
        (
            ["units = 3", 'units_from = "/dev/null"', "joints = 3"],
            "night.toml:8: job[1].joints: cannot be combined with units; give one end",
        ),
        (
            ["stations = []"],
            (
                "night.toml:6: job[1].stations: [] is not allowed; a list of stations of the line,"
                " by name"
            ),
        ),
    ],
)
def test_what_a_job_must_not_say(lines: list[str], told: str) -> None:
    (sentence,) = wrong(HEAD + job(*lines))
    assert sentence.startswith(told)


def test_jobs_in_a_circle_are_told_with_their_way() -> None:
    text = (
        HEAD
        + job('after = ["c"]')
        + job('after = ["a"]', name="b")
        + job('after = ["b"]', name="c")
    )
    (sentence,) = wrong(text)
    assert (
        sentence
        == "night.toml:6: job[1].after: a waits for c waits for b waits for a: none of them could"
        " begin"
    )


def test_another_file_is_told_to_be_none() -> None:
    assert wrong('[recipe]\nname = "x"') == [
        "night.toml: this is not a jobs file; one has [batch] with the line, and a [[job]] for"
        " each job"
    ]


# -- what only line and recipes tell ---------------------------------------------------------------


def test_every_job_is_planned_before_the_first_begins() -> None:
    text = (
        HEAD
        + JOB
        + JOB.replace('"a"', '"b"').replace("dde-1", "dde-7")
        + JOB.replace('"a"', '"c"').replace('stations = ["dde-1"]', 'families = ["nae"]')
    )
    with pytest.raises(Problems) as raised:
        ordered(text)
    assert [str(problem) for problem in raised.value.problems] == [
        (
            '/nowhere/night.toml:12: job[2].stations[1]: "dde-7" is not on the line bench; it has'
            " dde-1, dde-2, ucr-1, ale-1"
        ),
        "/nowhere/night.toml:18: job[3].families: the line bench has no station of these families",
    ]


def test_what_line_and_recipes_tell_is_told_at_once() -> None:
    text = (
        HEAD
        + JOB.replace("dde-1", "dde-7")
        + JOB.replace('"a"', '"b"').replace("sac305-smd", "none-such")
    )
    with pytest.raises(Problems) as raised:
        ordered(text)
    first, second = map(str, raised.value.problems)
    assert "job[1].stations[1]" in first
    assert "none-such.toml: No such file" in second


def test_a_recipe_that_does_not_fit_is_told_with_the_job_that_wants_it() -> None:
    text = (
        HEAD
        + JOB.replace("dde-1", "ucr-1")
        + JOB.replace('"a"', '"b"').replace("sac305-smd", "none-such")
    )
    with pytest.raises(Problems) as raised:
        ordered(text)
    first, second = map(str, raised.value.problems)
    assert first.startswith("/nowhere/night.toml:3: job[1]: ")
    assert "sac305-smd.toml:" in first
    assert "recipe.families: nae, dde: not for ucr-1, whose family is ucr" in first
    assert second.startswith("/nowhere/night.toml:9: job[2]: ")
    assert "none-such.toml: No such file or directory" in second


def test_a_recipe_that_is_wrong_is_told_once_however_many_jobs_have_it(tmp_path: Path) -> None:
    bad = tmp_path / "bad.toml"
    bad.write_text('[recipe]\nname = "x"\nrevision = 1\nfamilies = ["dde"]\n[sleep]\ndelay = 1\n')
    text = HEAD + "".join(
        JOB.replace(str(RECIPES / "sac305-smd.toml"), str(bad)).replace('"a"', f'"{name}"')
        for name in "abc"
    )
    with pytest.raises(Problems) as raised:
        ordered(text)
    assert len(raised.value.problems) == 1


def test_what_a_recipe_requires_is_asked_for_in_the_keys_of_the_file(tmp_path: Path) -> None:
    recipe = tmp_path / "strict.toml"
    required = 'required = ["operator", "order", "wire_lot", "unit", "tag.blade"]'
    recipe.write_text(
        f'[recipe]\nname = "x"\nrevision = 1\nfamilies = ["dde"]\n[metadata]\n{required}\n'
    )
    with pytest.raises(Problems) as raised:
        ordered(HEAD + JOB.replace(str(RECIPES / "sac305-smd.toml"), str(recipe)))
    (problem,) = raised.value.problems
    keys = 'operator = "…" order = "…" wire_lots = ["…"] serials = ["…"] tags = { blade = "…" }'
    assert (
        str(problem) == f"/nowhere/night.toml:3: job[1]: {recipe}:6: metadata.required: give {keys}"
    )


def test_what_a_job_says_is_what_its_run_is_told() -> None:
    lines = [
        'operator = "A. Rossi"',
        'order = "7"',
        'wire_lots = ["L1"]',
        'tips = ["dde-1:2=T1"]',
        'serials = ["S1"]',
    ]
    orders = ordered(HEAD + JOB + "\n".join([*lines, 'tags = { shift = "night" }', "wire = true"]))
    wanted = orders.specs["a"].job.wanted
    assert wanted.duration_s == 900
    assert wanted.stations == ("dde-1",)
    assert (wanted.rate, wanted.wire, wanted.guard) == ("fit", True, True)
    said = wanted.metadata
    assert said is not None
    assert (said.operator, said.order, said.wire_lots, said.tips, said.units) == (
        "A. Rossi",
        "7",
        ("L1",),
        ("dde-1:2=T1",),
        ("S1",),
    )
    assert said.tags == {"batch": "night", "job": "a", "shift": "night"}
    assert orders.turns[0].on_failure is OnFailure.STOP


@pytest.mark.parametrize("rate", ['"auto"', '"fit"', '"max"', "2", "2.5"])
def test_what_a_job_is_told_comes_to_its_process_as_it_is(rate: str) -> None:
    lines = [
        'operator = "Ä. Rossi"',
        'tips = ["T1"]',
        'tags = { shift = "night" }',
        "allow_omega_write = true",
    ]
    order = ordered(HEAD + JOB.replace('"fit"', rate) + "\n".join(lines)).specs["a"]
    assert SPEC.validate_json(SPEC.dump_json(order)) == order


def test_the_other_ends_of_a_run_and_the_reader_that_two_jobs_share() -> None:
    one = JOB.replace('duration = "15m"', 'units = 40\nunits_from = "/dev/null"')
    two = (
        JOB.replace('duration = "15m"', 'joints = 200\nunits_from = "/dev/null"')
        .replace('"a"', '"b"')
        .replace("dde-1", "dde-2")
    )
    orders = ordered(HEAD + one + two)
    assert orders.specs["a"].job.wanted.until_units == 40
    assert orders.specs["b"].job.wanted.until_joints == 200
    assert orders.turns[0].places & orders.turns[1].places == {"the reader /dev/null"}


def test_a_duration_beside_units_or_joints_is_their_bound() -> None:
    (order,) = ordered(HEAD + JOB + 'units = 40\nunits_from = "/dev/null"').specs.values()
    assert (order.job.wanted.until_units, order.job.wanted.duration_s) == (40, 900)
    assert ordered(HEAD + JOB + "joints = 200").specs["a"].job.wanted.duration_s == 900


@pytest.mark.parametrize(
    ("end", "shown"),
    [
        ('duration = "15m"', "40 s of 15:00, 14:20 left"),
        (
            'duration = "15m"\nunits = 9\nunits_from = "/dev/null"',
            "3 of 9 units, 40 s of 15:00, 14:20 left",
        ),
        ("joints = 200", "40 s, to 200 joints"),
    ],
)
def test_how_far_a_job_has_come_is_shown_with_its_ends(end: str, shown: str) -> None:
    (asked,) = parse_jobs(HEAD + job(end=end), Path("night.toml")).jobs
    assert so_far(asked, JobProgress(40.0, units=3)) == shown


def test_joints_so_far_are_shown_once_they_are_counted() -> None:
    (asked,) = parse_jobs(HEAD + job(end="joints = 200"), Path("night.toml")).jobs
    assert so_far(asked, JobProgress(40.0, joints=17)) == "40 s, 17 of 200 joints so far"


def test_a_reader_that_is_not_plugged_in_is_noted_before_the_first_job_begins() -> None:
    text = HEAD + JOB.replace('duration = "15m"', 'units = 40\nunits_from = "{}"')
    assert (
        "a: its reader /nowhere/reader is not connected yet" in ordered(text.format("reader")).notes
    )
    assert not [text for text in ordered(text.format("/dev/null")).notes if "reader" in text]


# -- those that come with the project --------------------------------------------------------------


def of_profile(path: Path, tmp_path: Path) -> tuple[JobsFile, BatchPlan]:
    file = load_jobs(path, BENCH)
    return file, plan_batch(file, tmp_path / "runs")


@pytest.mark.parametrize("path", BATCHES, ids=lambda path: path.stem)
def test_each_batch_of_the_profiles_runs_as_it_stands_where_it_says(
    path: Path, tmp_path: Path
) -> None:
    """Its line is the one that `jbclog sim` makes of the bench, below the folder that the profiles
    are in.
    """
    shutil.copytree(PROFILES, tmp_path / "profiles")
    (tmp_path / "virtual").mkdir()
    shutil.copy(BENCH, tmp_path / "virtual" / "line.toml")
    orders = plan_batch(load_jobs(tmp_path / "profiles" / "batches" / path.name), tmp_path / "runs")
    assert len(orders.turns) > 1


@pytest.mark.parametrize("path", BATCHES, ids=lambda path: path.stem)
def test_each_job_of_the_profiles_comes_to_an_accepted_record(path: Path, tmp_path: Path) -> None:
    _, orders = of_profile(path, tmp_path)
    for name, order in orders.specs.items():
        result = RecordedRun(make_plan(order.job.wanted), tmp_path / name).result
        assert result.exit_code == 0, [finding.text for finding in result.findings]
