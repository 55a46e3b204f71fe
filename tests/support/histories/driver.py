"""The driver: lives histories with the jbclog that is installed, and writes what came of each.

    python -m support.histories.driver --product FILE --out FOLDER NUMBER ...

`FILE` is `support/histories/product.py` of the tree that is installed. `FOLDER` gets one file of
JSON lines for each history.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import sys
import tempfile
import traceback
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from types import ModuleType
from typing import Any

from support.histories import live, normal
from support.histories.benches import Wire
from support.histories.drawn import History, history
from support.oracles.outside_bench import line_file


def product_of(path: Path) -> ModuleType:
    """Import the part of a tree that knows its jbclog."""
    spec = importlib.util.spec_from_file_location("product_of_its_tree", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def lived(told: History, product: Any, home: Path) -> Iterator[normal.Line]:
    """Live a history on a virtual clock; yield its lines."""
    wires = {bench.name: Wire(bench) for bench in told.benches}
    write_files(told, {name: name for name in wires}, home)
    options = {
        "duration_s": told.duration_s,
        "rate": told.rate,
        "allow_missing": told.allow_missing,
    }
    kind, at_s = told.ends
    if kind == "duration":
        end = None
    else:
        end = (at_s, "Units finished: 3, wanted: 3" if kind == "goal" else kind)
    try:
        folder, _ = product.record(home, wires, options, told.unasked, end)
    except product.Refused as error:
        text = normal.Text(home, None, {})(str(error))
        yield {"table": "refused", "station": "", "row": 0, "is": {"text": text}}
        return
    text = normal.Text(home, folder, {})
    yield from normal.lines(folder, text, round(product.ZERO_UTC_S * 1e6))
    yield from normal.frames(wires, product.ZERO_S)


def write_files(told: History, urls: dict[str, str], home: Path) -> None:
    """Write line file and recipes of a history."""
    keys = {bench.name: f'{bench.keys}recipe = "{bench.recipe}.toml"' for bench in told.benches}
    stated = {bench.name: bench.stated for bench in told.benches}
    (home / "line.toml").write_text(line_file(urls, stated, more=keys), encoding="utf-8")
    for name, text in told.recipes.items():
        (home / f"{name}.toml").write_text(text, encoding="utf-8")


def write(number: int, product_file: Path, out: Path) -> str:
    """Write the lines of one history; return what is wrong with it, or nothing."""
    told = history(number)
    part = out / f"{number:03d}.part"
    # what a run computes after its end may still be written there
    with tempfile.TemporaryDirectory(
        prefix=f"history-{number:03d}-", ignore_cleanup_errors=True
    ) as home:
        try:
            if told.live:
                found = live.lived(told, Path(home), write_files)
            else:
                found = lived(told, product_of(product_file), Path(home))
            with part.open("w", encoding="utf-8") as file:
                for line in found:
                    file.write(json.dumps(line, ensure_ascii=False) + "\n")
        except Exception:
            return f"history {told.name}:\n{traceback.format_exc()}"
    part.rename(out / f"{number:03d}.jsonl")
    return ""


def main() -> int:
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("--product", type=Path, required=True)
    words.add_argument("--out", type=Path, required=True)
    words.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    words.add_argument("numbers", type=int, nargs="+")
    given = words.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    # live histories first: they wait while others compute
    order = sorted(given.numbers, key=lambda number: (not history(number).live, number))
    failed = 0
    with ProcessPoolExecutor(given.jobs, get_context("spawn")) as pool:
        waiting = [pool.submit(write, number, given.product, given.out) for number in order]
        for done in waiting:
            wrong = done.result()
            failed += bool(wrong)
            print(wrong, end="", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
