"""The short form of every benchmark with claims: ``pytest -m bench tests/bench``."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

NAMES = (
    "wire_use",
    "own_profile",
    "many_stations",
    "one_unpaced",
    "memory",
    "start",
    "wire_record",
    "open_run",
    "watch",
    "many_runs",
    "instructions",
    "growth",
)
LONGEST_S = 300


@pytest.mark.bench
@pytest.mark.timeout(LONGEST_S)
@pytest.mark.parametrize("name", NAMES)
def test_short_form_holds_its_claims(name: str) -> None:
    script = Path(__file__).with_name(f"bench_{name}.py")
    done = subprocess.run(
        [sys.executable, str(script), "--short"],
        capture_output=True,
        text=True,
        timeout=LONGEST_S,
        check=False,
    )
    print(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr


LOAD_EACH = """
import runpy, sys
tests, folder, *scripts = sys.argv[1:]
others = sys.path[1:]
for script in scripts:
    sys.path[:] = [folder, *others]
    for name, module in [*sys.modules.items()]:
        if (getattr(module, "__file__", None) or "").startswith(tests):
            del sys.modules[name]
    runpy.run_path(script)
"""


def test_every_benchmark_can_be_loaded_as_a_script() -> None:
    """Each has only its own folder on the path; no other test runs all of them."""
    folder = Path(__file__).parent
    scripts = sorted(map(str, folder.glob("bench_*.py")))
    assert {str(folder / f"bench_{name}.py") for name in NAMES} <= set(scripts)
    loaded = subprocess.run(
        [sys.executable, "-c", LOAD_EACH, str(folder.parent), str(folder), *scripts],
        cwd="/",
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    assert (loaded.returncode, loaded.stderr) == (0, "")


def other_tree(tree: Path, stations: int, seconds: int) -> subprocess.CompletedProcess[str]:
    """One round of this tree and `tree`."""
    script = Path(__file__).with_name("bench_other_tree.py")
    wanted = {"--stations": stations, "--rounds": 1, "--seconds": seconds, "--most": 100}
    options = [str(part) for pair in wanted.items() for part in pair]
    return subprocess.run(
        [sys.executable, str(script), str(tree), *options],
        capture_output=True,
        text=True,
        timeout=LONGEST_S,
        check=False,
    )


@pytest.mark.bench
@pytest.mark.timeout(LONGEST_S)
def test_a_tree_can_be_compared_with_itself() -> None:
    done = other_tree(Path(__file__).parents[2], stations=2, seconds=5)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("PASS") == 2


def test_a_tree_that_records_nothing_is_named_with_the_end_of_its_output(tmp_path: Path) -> None:
    tree = tmp_path.resolve()
    (tree / "jbclog").mkdir()
    (tree / "jbclog/__init__.py").touch()
    (tree / "jbclog/__main__.py").write_text("raise SystemExit('10 Hz does not fit its wire')")
    done = other_tree(tree, stations=1, seconds=1)
    assert done.returncode == 1
    assert done.stderr.count("ended with 1. The end of its output:\n  10 Hz does not fit") == 3
    assert f"{tree}: 3 runs recorded nothing" in done.stderr
