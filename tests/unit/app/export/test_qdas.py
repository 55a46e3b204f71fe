"""Q-DAS files as aqdefreader reads them, in a process of its own: its import warns of what chardet
deprecates.
"""

from __future__ import annotations

import functools
import json
import subprocess
import sys
from pathlib import Path

import pytest

import jbclog
from jbclog.app.export import qdas
from jbclog.app.export.source import Source
from jbclog.core.errors import UsageError
from jbclog.core.rows import StationFacts
from support.records.sealed_run import samples, seal, station, table

READER = """
import contextlib, json, sys
from aqdefreader import read_dfq_file

def read(path):
    file = read_dfq_file(path)
    part, found = file.get_part(0), []
    for one in part.get_characteristics():
        values = [
            [m.value, m.attribute if m.attribute is not None else 0, str(m.datetime)]
            for m in one.get_measurements()
        ]
        found.append([{key: one.get_data(key) for key in one.get_data_keys()}, values])
    keys = ("K1001", "K1002", "K1053", "K1081", "K1342", "K1900")
    fields = {key: part.get_data(key) for key in keys}
    return [file.part_count(), fields, found]

with contextlib.redirect_stdout(sys.stderr):
    files = [read(path) for path in sys.argv[1:]]
print(json.dumps(files))
"""
Read = tuple[int, dict[str, str], dict[str, tuple[dict[str, object], list[list[object]]]]]


@pytest.fixture(scope="module")
def folder(source: Source, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("qdas") / "out"
    qdas.write(source, out)
    return out


@functools.cache
def files(folder: Path) -> dict[str, Read]:
    paths = sorted(folder.iterdir())
    command = [sys.executable, "-W", "ignore::DeprecationWarning", "-c", READER, *map(str, paths)]
    ended = subprocess.run(command, capture_output=True, text=True, check=True)
    return {
        path.name: (
            parts,
            fields,
            {described["K2001"]: (described, values) for described, values in found},
        )
        for path, (parts, fields, found) in zip(paths, json.loads(ended.stdout), strict=True)
    }


def read(path: Path) -> Read:
    return files(path.parent)[path.name]


def test_aqdefreader_reads_each_joint_of_a_port(folder: Path, run: jbclog.Run) -> None:
    parts, fields, found = read(folder / "dde-1-port2.dfq")
    joints = run.joints("dde-1")
    expected = joints[joints["port"] == 2]
    assert parts == 1
    assert [*found] == [one.column for one in qdas.CHARACTERISTICS]
    assert fields["K1053"] == "WO-1"
    assert (fields["K1002"], fields["K1342"]) == ("Joints of dde-1 port 2", "sn100c-tht revision 7")
    for name, (_, values) in found.items():
        is_known = expected[name].notna()  # the reader leaves out placeholders
        assert [value for value, _, _ in values] == pytest.approx(
            expected[name][is_known].tolist(), abs=5e-4
        ), name
        assert [time for _, _, time in values] == expected["start"][is_known].dt.strftime(
            "%Y-%m-%d %H:%M:%S"
        ).tolist()


def test_what_is_not_known_is_a_placeholder_with_attribute_255_and_never_0(
    folder: Path, run: jbclog.Run
) -> None:
    joints = run.joints("dde-1")
    unknown = joints[joints["recovery_s"].isna() & (joints["port"] == 2)]
    assert len(unknown)
    lines = [
        line
        for line in (folder / "dde-1-port2.dfq").read_text("utf-8-sig").splitlines()
        if qdas.BETWEEN_FIELDS in line
    ]
    cells = [
        line.split(qdas.BETWEEN_CHARACTERISTICS)[1].split(qdas.BETWEEN_FIELDS) for line in lines
    ]
    assert sum(cell[:2] == ["-99999", "255"] for cell in cells) == len(unknown)
    assert not any(cell[0] in ("", "0", "0.000") for cell in cells)


def test_units_limits_and_decimals(folder: Path) -> None:
    _, _, found = read(folder / "dde-1-port1.dfq")
    recovery, deficit = found["recovery_s"][0], found["deficit_c"][0]
    assert (recovery["K2142"], recovery["K2022"], recovery["K2009"], recovery["K2004"]) == (
        "s",
        3,
        800,
        0,
    )
    assert (recovery["K2110"], recovery["K2120"], recovery["K2111"], recovery["K2121"]) == (
        0,
        2,
        "2.5",
        1,
    )
    assert "95 of 100 joints" in str(recovery["K2900"])
    assert (deficit["K2120"], deficit["K2121"], deficit.get("K2110")) == (0, 0, None)
    assert found["dwell_s"][0]["K2121"] == 0


def test_heat_in_joules_needs_a_declared_power(folder: Path) -> None:
    _, _, found = read(folder / "dde-2-port1.dfq")
    assert {"heat_j", "energy_j"} & found.keys() == set()
    assert (folder / "dde-2-port1.dfq").read_text("utf-8-sig").startswith(f"K0100 {len(found)}\n")


def test_foreign_text_neither_begins_a_field_nor_separates_values(folder: Path) -> None:
    lines = (folder / "dde-1-port1.dfq").read_bytes().decode("utf-8-sig").split("\r\n")
    assert [line for line in lines if line.startswith("K1001")] == [
        'K1001/1 Müller K0001/1 9?255?1,";'
    ]
    assert not any(line.startswith("K0001") for line in lines)
    serials = [line for line in lines if line.startswith("K0014")]
    assert set(serials) == {'K0014/0 Müller K0001/1 9?255?1,";'}
    assert 0 < len(serials) < sum(qdas.BETWEEN_FIELDS in line for line in lines)


def test_the_remark_names_run_fingerprint_and_version_within_255_characters(
    folder: Path, run: jbclog.Run
) -> None:
    _, fields, _ = read(folder / "dde-1-port1.dfq")
    assert fields["K1900"].startswith(f"run {run.name}; fingerprint ")
    assert f"jbclog {jbclog.__version__}, methods" in fields["K1900"]
    assert len(fields["K1900"]) <= 255


def test_a_file_is_ascii_unless_foreign_text_is_not(tmp_path: Path, folder: Path) -> None:
    assert (folder / "dde-1-port1.dfq").read_bytes().startswith(b"\xef\xbb\xbf")  # Müller
    plain = seal(tmp_path, [station(rows=300)], table(samples(300)))
    qdas.write(Source(jbclog.open_run(plain), is_checked=True), tmp_path / "out")
    assert (tmp_path / "out" / "dde-1-port1.dfq").read_bytes().isascii()


def test_a_joint_whose_kind_is_not_known_is_not_evaluated() -> None:
    assert qdas._value(1.5, "not known", "t").split(qdas.BETWEEN_FIELDS) == ["1.500", "129", "t"]
    assert qdas._value(1.5, "joint", "t").split(qdas.BETWEEN_FIELDS) == ["1.500", "0", "t"]


def test_a_run_without_tips_is_refused(tmp_path: Path) -> None:
    air = StationFacts("jtse-1", "x", "jtse", ports=[1], outcome="completed", period_s=0.1)
    folder = seal(tmp_path, [air], table())
    with pytest.raises(UsageError, match="no station with tips"):
        qdas.write(Source(jbclog.open_run(folder), is_checked=True), tmp_path / "out")
