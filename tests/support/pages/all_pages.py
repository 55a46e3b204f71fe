"""The pages that are made from the code, and nothing else: ``python tests/support pages`` writes
them anew.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from support.pages import (
    command_line,
    configuration,
    contradictions,
    exit_codes,
    export,
    main_path,
    manifest,
    other_files,
    python,
    station_commands,
    tables,
    verdict,
)

ROOT = Path(__file__).parents[3]
REFERENCE = ROOT / "docs" / "reference"
PAGES: Mapping[Path, Callable[[], str]] = {
    REFERENCE / "commands.md": command_line.page,
    REFERENCE / "configuration.md": configuration.page,
    REFERENCE / "exit-codes.md": exit_codes.page,
    REFERENCE / "export.md": export.page,
    REFERENCE / "manifest.md": manifest.page,
    REFERENCE / "audit-files.md": other_files.page,
    REFERENCE / "python.md": python.page,
    REFERENCE / "tables.md": tables.page,
    REFERENCE / "verdict.md": verdict.page,
    REFERENCE / "station-commands.md": station_commands.page,
    REFERENCE / "contradictions.md": contradictions.page,
    ROOT / "docs" / "pictures" / "main-path.svg": main_path.svg,
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
