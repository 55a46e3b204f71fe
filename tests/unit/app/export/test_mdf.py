"""MDF files as asammdf and mdfreader read them.

mdfreader 4.3 reads the invalidation bits, but applies them wrongly: `apply_invalid_bit` takes the
first bit for none, and the bit before for each other. The bits are decoded here from the bytes and
positions that it reads. It cannot read a group with three bytes of them (17 to 24 channels), so it
gets one with two.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

import jbclog
from jbclog.app.export.source import Source
from jbclog.core.errors import RecordError
from jbclog.core.text import clean
from jbclog.record.manifest import manifest_sha256
from support.lazy import asammdf, mdf, mdfreader
from support.records.sealed_run import T0_UTC_S, lose, samples, seal, station, table


@pytest.fixture(scope="module")
def path(source: Source, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("mf4") / "run.mf4"
    mdf.write(source, out)
    return out


@pytest.fixture(scope="module")
def file(path: Path) -> Iterator[asammdf.MDF]:
    with asammdf.MDF(path) as opened:
        yield opened


SPLITTING = 'Müller\nK0001/1 9\x14255\x0f1,";'  # as in `run`


def groups(file: asammdf.MDF) -> dict[str, int]:
    return {group.channel_group.acq_name: number for number, group in enumerate(file.groups)}


def test_a_group_for_each_port_and_table(file: asammdf.MDF) -> None:
    assert [*groups(file)] == [
        *("dde-1 port 1", "dde-1 port 2", "dde-2 port 1", "events", "settings", "counters"),
        *("dde-1 port 1 joints", "dde-1 port 2 joints", "dde-2 port 1 joints", "alarms"),
    ]
    assert file.header.start_time == datetime.fromtimestamp(T0_UTC_S, UTC)


@pytest.mark.parametrize("port", [1, 2])
def test_asammdf_reads_values_invalidation_bits_units_and_times(
    file: asammdf.MDF, run: jbclog.Run, port: int
) -> None:
    expected, number = run.samples("dde-1", port), groups(file)[f"dde-1 port {port}"]
    for name, unit in (
        ("temperature_c", "°C"),
        ("power_permille", "‰"),
        ("setpoint_c", "°C"),
        ("alarm_high", ""),
    ):
        found = file.get(name, group=number, ignore_invalidation_bits=True)
        assert found.unit == unit
        assert found.invalidation_bits.tolist() == expected[name].isna().tolist()
        is_known = expected[name].notna().to_numpy()
        assert found.samples[is_known].tolist() == expected[name][is_known].astype(float).tolist()
        assert np.isnan(found.samples[~is_known]).all()  # for readers that ignore the bits
        assert found.timestamps == pytest.approx(expected["tick"].to_numpy() * 0.1)
    assert (
        file.get("temperature_c", group=number).samples.tolist()
        == expected["temperature_c"].dropna().astype(float).tolist()
    )
    utc = file.get("time_utc", group=number)
    assert utc.samples.tolist() == expected["time"].astype("int64").tolist()


def test_texts_that_recur_are_choices(file: asammdf.MDF, run: jbclog.Run) -> None:
    expected, number = run.samples("dde-1", 2), groups(file)["dde-1 port 2"]
    for name in ("quality", "status", "reasons"):
        found = file.get(name, group=number, ignore_invalidation_bits=True)
        assert [text.decode() for text in found.samples] == expected[name].fillna("-").tolist()


def test_a_port_has_the_channels_that_its_family_fills(file: asammdf.MDF) -> None:
    known, unknown = (file.groups[groups(file)[name]] for name in ("dde-1 port 1", "dde-2 port 1"))
    assert "alarm_low" in {channel.name for channel in known.channels}  # read with alarm_high
    assert "transistor_c" not in {channel.name for channel in known.channels}
    # an older record does not list them
    assert "transistor_c" in {channel.name for channel in unknown.channels}


def test_the_header_names_the_run(file: asammdf.MDF, run: jbclog.Run) -> None:
    assert f"exported by jbclog {jbclog.__version__} from run {run.name}" in file.header.comment
    assert f'<e name="fingerprint">{manifest_sha256(run.folder)}</e>' in file.header.comment
    assert "&lt;" not in file.header.comment.partition("<TX>")[0]


def test_foreign_texts_stay_on_their_line(file: asammdf.MDF, path: Path, tmp_path: Path) -> None:
    found = file.get("raw", group=groups(file)["events"]).samples
    assert {text.decode() for text in found} == {"high", clean(SPLITTING)}
    facts = station(rows=20)
    facts.model = SPLITTING
    made = seal(tmp_path / "runs", [facts], table(samples(20)))
    mdf.write(Source(jbclog.open_run(made), is_checked=True), tmp_path / "run.mf4")
    for one in (path, tmp_path / "run.mf4"):
        assert SPLITTING.encode() not in one.read_bytes()


def test_mdfreader_reads_the_same(tmp_path: Path) -> None:
    facts = station(rows=300)
    facts.signals = ["temperature_c", "power_permille", "status", "setpoint_c", "alarm_high"]
    columns = samples(300)
    lose(columns, slice(100, 120))
    run = jbclog.open_run(seal(tmp_path, [facts], table(columns)))
    mdf.write(Source(run, ["samples"], is_checked=True), tmp_path / "run.mf4")
    read, expected = mdfreader.Mdf(str(tmp_path / "run.mf4")), run.samples()
    assert read.get_channel_data("time") == pytest.approx(expected["tick"].to_numpy() * 0.1)
    assert read.get_channel_unit("temperature_c") == "°C"
    assert read.get_channel_master("temperature_c") == "time"
    for name in ("temperature_c", "power_permille", "setpoint_c", "alarm_high"):
        values = read.get_channel_data(name)
        assert (
            bits(read, name).tolist() == expected[name].isna().tolist() == np.isnan(values).tolist()
        ), name
        assert (
            values[~bits(read, name)].tolist() == expected[name].dropna().astype(float).tolist()
        ), name
    assert bits(read, "status").tolist() == expected["status"].isna().tolist()
    assert read.get_channel_data("status").tolist() == expected["status"].fillna("-").tolist()


def bits(read: mdfreader.Mdf, name: str) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """The invalidation bits of a channel."""
    place, raw = (
        read.get_invalid_bit(name) or 0,
        read.get_channel_data(read.get_invalid_channel(name)),
    )
    return (raw[:, place // 8] >> place % 8 & 1).astype(bool)


def test_joints_have_their_times_in_seconds_of_the_run(file: asammdf.MDF, run: jbclog.Run) -> None:
    joints, number = run.joints("dde-1"), groups(file)["dde-1 port 1 joints"]
    expected = joints[joints["port"] == 1]
    found = file.get("peak_permille", group=number, ignore_invalidation_bits=True)
    assert found.timestamps.tolist() == expected["start_s"].tolist()
    assert found.samples.tolist() == expected["peak_permille"].tolist()


def test_rows_written_in_many_stretches_are_the_same(
    source: Source, path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run: jbclog.Run
) -> None:
    pieces = [run.groups("samples", list(run.samples().columns))]
    rows = next(iter(pieces[0]))
    cut = [rows.slice(start, 170) for start in range(0, rows.num_rows, 170)]
    monkeypatch.setattr("jbclog.app.export.mdf.HELD_ROWS", 200)
    one = Source(run, ["samples"], is_checked=True)
    monkeypatch.setattr(one, "pieces", lambda table: iter(cut))
    mdf.write(one, tmp_path / "cut.mf4")
    with asammdf.MDF(tmp_path / "cut.mf4") as again, asammdf.MDF(path) as whole:
        for name, number in groups(again).items():
            for channel in ("time_utc", "temperature_c", "status", "quality", "reasons"):
                two = [
                    each.get(channel, group=groups(each)[name], ignore_invalidation_bits=True)
                    for each in (again, whole)
                ]
                assert two[0].samples.astype(str).tolist() == two[1].samples.astype(str).tolist(), (
                    name,
                    channel,
                    number,
                )
                assert two[0].timestamps.tolist() == two[1].timestamps.tolist()


def test_texts_that_do_not_recur_are_refused(
    source: Source, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A forged part has another text in each row."""
    monkeypatch.setattr("jbclog.app.export.mdf.MOST_CHOICES", 1)
    with pytest.raises(RecordError, match="has more than 1 different texts; MDF has no space"):
        mdf.write(source, tmp_path / "out.mf4")
