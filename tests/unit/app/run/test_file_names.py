"""Names that become names of files: every file system takes them, and none hides another."""

from __future__ import annotations

from pathlib import Path

import pytest

from jbclog.app.batch.journal import home_of
from jbclog.app.run.options import RunOptions
from jbclog.app.run.plan import make_plan
from jbclog.config.line import load_line
from jbclog.core.errors import Problems
from jbclog.core.text import file_name
from support.readers.other_desk import forbidden_name
from support.virtual.virtual_run import RECIPE

RECIPES = ("a:b.toml", "a_b.toml", "A_B.toml", "aux.toml", "COM1.x.toml", "plain.toml")


@pytest.mark.parametrize(
    ("name", "written"),
    [
        ("sn100c-tht.toml", "sn100c-tht.toml"),
        ("a:b?.toml", "a_b_.toml"),
        ("con", "con_"),
        ("Aux.tar.gz", "Aux_.tar.gz"),
        ("lpt9", "lpt9_"),
        ("console", "console"),
        ("end.", "end._"),
        ("end ", "end _"),
        ("tab\t", "tab_"),
        ("°C.toml", "°C.toml"),
    ],
)
def test_a_name_of_a_file_is_one_everywhere(name: str, written: str) -> None:
    assert file_name(name) == written
    assert forbidden_name(Path(written)) is None


def station(name: str, place: int, recipe: str | None = None) -> str:
    given = "" if recipe is None else f'recipe = "{recipe}"\n'
    url = f'url = "socket://127.0.0.1:{7000 + place}"\n'
    return f'[[station]]\nname = "{name}"\n{url}family = "dde"\nports = [1]\n{given}'


def line_of(folder: Path, *stations: str, name: str = "bench") -> Path:
    path = folder / "line.toml"
    path.write_text("\n".join([f'[line]\nname = "{name}"', *stations]), encoding="utf-8")
    return path


def test_copies_of_recipes_have_names_of_their_own_on_every_file_system(tmp_path: Path) -> None:
    for name in RECIPES:
        (tmp_path / name).write_text(RECIPE, encoding="utf-8")
    stations = [station(f"dde-{at}", at, name) for at, name in enumerate(RECIPES)]
    plan = make_plan(RunOptions(line_of(tmp_path, *stations), None))
    names = [one.recipe_file for one in plan.stations]
    assert names == [
        *("a_b.toml", "a_b-2.toml", "A_B-3.toml", "aux_.toml", "COM1_.x.toml", "plain.toml"),
    ]
    assert len({name.casefold() for name in names}) == len(RECIPES)
    assert [forbidden_name(Path(name)) for name in names] == [None] * len(RECIPES)


@pytest.mark.parametrize("name", ["con", "AUX", "com1", "nul.old", "lpt1.b.c"])
def test_a_name_of_a_device_is_refused(name: str, tmp_path: Path) -> None:
    reason = f'"{name}" is not allowed; Windows takes it for a device'
    for path in (
        line_of(tmp_path, station("dde-1", 1), name=name),
        line_of(tmp_path, station(name, 1)),
    ):
        with pytest.raises(Problems) as refused:
            load_line(path)
        assert [reason in str(problem) for problem in refused.value.problems] == [True]


def test_a_dot_at_the_end_is_refused(tmp_path: Path) -> None:
    with pytest.raises(Problems, match="Windows drops a dot at the end of a name"):
        load_line(line_of(tmp_path, station("dde.", 1)))


@pytest.mark.parametrize("name", ["com10", "console", "dde.1", "_nul", "auxiliary-1"])
def test_other_names_are_taken(name: str, tmp_path: Path) -> None:
    assert load_line(line_of(tmp_path, station(name, 1))).stations[0].name == name


def test_stations_whose_names_differ_in_case_only_would_share_a_file(tmp_path: Path) -> None:
    with pytest.raises(Problems, match='"DDE-1" is the name of two stations, first in line 4'):
        load_line(line_of(tmp_path, station("dde-1", 1), station("DDE-1", 2)))


def test_a_batch_has_a_folder_that_every_file_system_takes(tmp_path: Path) -> None:
    homes = [home_of(tmp_path, Path(name)) for name in ("night:1.toml", "con.toml", "night.toml")]
    assert [forbidden_name(home.relative_to(tmp_path)) for home in homes] == [None] * 3
    assert homes[2].name.startswith("night")
