"""The pages that are made from the code, and nothing else: ``python tests/support/pages.py`` writes them anew."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import command_line_page
import configuration_page
import contradictions_page
import exit_codes_page
import manifest_page
import other_files_page
import python_page
import station_commands_page
import tables_page
import verdict_page

ROOT = Path(__file__).parents[2]
REFERENCE = ROOT / "docs" / "reference"
PAGES: Mapping[Path, Callable[[], str]] = {
    REFERENCE / "commands.md": command_line_page.page,
    REFERENCE / "configuration.md": configuration_page.page,
    REFERENCE / "exit-codes.md": exit_codes_page.page,
    REFERENCE / "manifest.md": manifest_page.page,
    REFERENCE / "audit-files.md": other_files_page.page,
    REFERENCE / "python.md": python_page.page,
    REFERENCE / "tables.md": tables_page.page,
    REFERENCE / "verdict.md": verdict_page.page,
    REFERENCE / "station-commands.md": station_commands_page.page,
    REFERENCE / "contradictions.md": contradictions_page.page,
}


def main() -> None:
    """Write every page; say which one changed."""
    for path, page in PAGES.items():
        text = page()
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
            print(f"{path.relative_to(ROOT)} is written")


if __name__ == "__main__":
    main()
