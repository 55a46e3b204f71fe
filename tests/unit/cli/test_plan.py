"""`jbclog plan` fits on one screen; --verbose shows every setting and the arithmetic."""

from __future__ import annotations

from pathlib import Path

from support.invoked import invoked

PROFILES = Path(__file__).parents[3] / "profiles"
RECIPE = PROFILES / "recipes/sn100c-tht.toml"
ROWS, COLUMNS = 24, 100


def six_stations(folder: Path) -> Path:
    stations = [
        f'[[station]]\nname = "dde-{number}"\nurl = "port-{number}"\nfamily = "dde"\n'
        for number in range(1, 7)
    ]
    line = folder / "line.toml"
    line.write_text('[line]\nname = "bench"\n' + "".join(stations))
    return line


def test_six_stations_fit_on_one_screen(tmp_path: Path) -> None:
    lines = invoked("plan", RECIPE, "--line", six_stations(tmp_path)).stdout.splitlines()
    assert len(lines) <= ROWS
    assert max(map(len, lines)) <= COLUMNS + 5
    assert lines[3:5] == [
        "dde-1  dde, ports 1, 2: 5 Hz, 44 % of the link; 6 keys of the recipe not for it",
        '  writes 18 settings (port 1: 350 °C, port 2: 330 °C), then "working"; at the end "stand"',
    ]


def test_every_setting_and_the_arithmetic_are_shown_with_verbose(tmp_path: Path) -> None:
    text = invoked("plan", RECIPE, "--line", six_stations(tmp_path), "--verbose").stdout
    assert text.count("  write     ") == 6 * 18
    assert text.count("  fits      up to ") == 6


def test_a_condition_that_is_compared_is_named(tmp_path: Path) -> None:
    recipe = PROFILES / "recipes/omega-point.toml"
    text = invoked("plan", recipe, "--line", PROFILES / "lines/omega.toml").stdout
    assert "  writes nothing; at the end nothing: it has no safe state\n" in text
    assert "  compares condition 101; a difference stops the start" in text
