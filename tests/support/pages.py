"""The pages that are made from the tables, and nothing else: ``python tests/support/pages.py`` writes them anew."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import commands_page
import contradictions_page

TABLES = Path(__file__).parents[2] / "jbclog" / "protocol" / "commands"
PAGES: Mapping[Path, Callable[[], str]] = {
    TABLES / "COMMANDS.md": commands_page.page,
    TABLES / "CONTRADICTIONS.md": contradictions_page.page,
}


def main() -> None:
    """Write every page; say which one changed."""
    for path, page in PAGES.items():
        text = page()
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
            print(f"{path.relative_to(TABLES.parents[2])} is written")


if __name__ == "__main__":
    main()
