"""``python tests/support NAME WORDS``: runs the module `support.NAME`, from any folder."""

import runpy
import sys
from pathlib import Path

sys.path[0] = str(Path(__file__).resolve().parents[1])
runpy.run_module(f"support.{sys.argv.pop(1)}", run_name="__main__", alter_sys=True)
