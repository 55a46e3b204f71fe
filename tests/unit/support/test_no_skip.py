"""CI's promise that no test is skipped, held by `tests/conftest.py`."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

CONFTEST = Path(__file__).parents[2] / "conftest.py"
SKIPPED = {
    "a test": "import pytest\ndef test_it():\n    pytest.skip('no ser2net here')\n",
    "a fixture": (
        "import pytest\n@pytest.fixture\ndef f():\n    pytest.skip('no ser2net here')\ndef"
        " test_it(f):\n    pass\n"
    ),
    "a mark": (
        "import pytest\n@pytest.mark.skipif(True, reason='no ser2net here')\ndef test_it():\n   "
        " pass\n"
    ),
    "a file": (
        "import pytest\npytest.skip('no ser2net here', allow_module_level=True)\ndef test_it():\n  "
        "  pass\n"
    ),
}


def outcome_of(text: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Pytest over one made-up file, with the suite's conftest beside it."""
    shutil.copy(CONFTEST, folder)
    (folder / "pytest.ini").write_text("[pytest]\n")
    (folder / "test_made_up.py").write_text(text)
    told = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("JBCLOG", "PYTEST"))
    }
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", str(folder)]
    told |= {"PYTHONPATH": str(CONFTEST.parent)}  # where its `support` is
    return subprocess.run(
        command,
        cwd=folder,
        env=told | environment,
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )


@pytest.mark.parametrize("what", SKIPPED)
def test_a_skip_fails_where_none_is_allowed(what: str, tmp_path: Path) -> None:
    done = outcome_of(SKIPPED[what], tmp_path, JBCLOG_NO_SKIP="1")
    assert done.returncode in (1, 2)  # 2: pytest's word for a file that could not be collected
    assert "JBCLOG_NO_SKIP forbids: " in done.stdout
    assert "no ser2net here" in done.stdout


def test_a_skip_is_a_skip_elsewhere_and_an_expected_failure_is_no_skip(tmp_path: Path) -> None:
    assert outcome_of(SKIPPED["a test"], tmp_path).returncode == 0
    expected = "import pytest\n@pytest.mark.xfail\ndef test_it():\n    assert False\n"
    assert outcome_of(expected, tmp_path, JBCLOG_NO_SKIP="1").returncode == 0
