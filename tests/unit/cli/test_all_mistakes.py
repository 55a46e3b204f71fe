"""Mistakes of a command line and of both its files are reported at once."""

from __future__ import annotations

from pathlib import Path

from support.invoked import invoked

LINE = '[line]\nname = "x y"\n[[station]]\nname = "a"\nurl = "foo:"\nfamily = "ddee"\n'
RECIPE = '[recipe]\nname = "r"\nrevision = 1\nfamilies = ["dde"]\n[temperature]\nselect_c = 9999\n'


def test_mistakes_of_options_and_files_come_together(tmp_path: Path) -> None:
    line, recipe = tmp_path / "line.toml", tmp_path / "recipe.toml"
    line.write_text(LINE)
    recipe.write_text(RECIPE)
    wrong = ["--duration", "30", "--rate", "foo", "--tag", "x", "--operator", "a\tb"]
    ended = invoked("run", recipe, "--line", line, "--units", tmp_path / "nowhere", *wrong)
    assert ended.exit_code == 2
    assert ended.stderr.count("error: ") == 8
    for start in (
        "--operator: hidden or control character U+0009",
        "--tag x: must be NAME=VALUE",
        f"--units {tmp_path / 'nowhere'}: No such file",
        "--duration 30: give the unit: 30s, 30m or 30h",
        "--rate foo: must be auto, fit, max or a number of Hz",
        f"{line}:2: line.name: ",
        f"{line}:6: station[1].family: ",
        f"{recipe}:6: temperature.select_c: ",
    ):
        assert f"error: {start}" in ended.stderr
    assert ended.stderr.endswith("8 problems; nothing sent\n")


def test_a_mistake_of_an_option_comes_with_an_unknown_station(tmp_path: Path) -> None:
    line = tmp_path / "line.toml"
    line.write_text('[line]\nname = "l"\n[[station]]\nname = "a"\nurl = "x"\nfamily = "dde"\n')
    recipe = tmp_path / "recipe.toml"
    recipe.write_text('[recipe]\nname = "r"\nrevision = 1\nfamilies = ["dde"]\n')
    ended = invoked("plan", recipe, "--line", line, "--station", "b", "--rate", "foo")
    assert ended.exit_code == 2
    assert "error: --rate foo: " in ended.stderr
    assert "no station named b; the line has a" in ended.stderr
