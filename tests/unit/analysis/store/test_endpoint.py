"""A store at a server that never answers, or never ends to, is an error after the time for one
answer; one that does so later, after the time for one request.
"""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from jbclog.analysis.store import endpoint, place
from jbclog.analysis.store.place import place_of
from jbclog.app.publish.safe_place import expect_safe
from jbclog.core.errors import StoreError
from support.faults.silent_servers import LATER, NO_ANSWER, PROXIES, SERVERS, SilentServer

PLACE = place_of("s3://plant-runs/soldering")
HANGS = (
    'import signal, sys, time; print("loaded", flush=True);'
    " signal.setitimer(0, float(sys.argv[1])); time.sleep(60)"
)
LONG_S = 30.0  # on a busy machine


@pytest.fixture
def hanging(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever asks waits, whatever the address."""
    monkeypatch.setenv(endpoint.ENDPOINT, "http://me:hidden@127.0.0.1:9/plant")
    monkeypatch.setenv(endpoint.KEY, "a key")
    monkeypatch.setattr(endpoint, "ASK", HANGS)
    monkeypatch.setattr(endpoint, "ANSWERS_S", 0.1)


@pytest.mark.parametrize("kind", NO_ANSWER)
def test_a_server_without_a_whole_answer_is_named(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(endpoint, "ANSWERS_S", 1.0)
    with (
        SilentServer(kind, monkeypatch) as server,
        pytest.raises(
            StoreError,
            match=rf"^{PLACE}: its server 127\.0\.0\.1:{server.port} \({endpoint.ENDPOINT}\) does"
            r" not answer within 1 s$",
        ),
    ):
        PLACE.expect_answer()


def test_a_server_is_asked_until_it_has_answered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(endpoint, "ANSWERS_S", 0.5)
    with SilentServer("silent", monkeypatch) as server:
        for _ in range(2):
            with pytest.raises(StoreError, match="does not answer"):
                PLACE.expect_answer()
        server.kind = "closes"
        monkeypatch.setattr(endpoint, "ANSWERS_S", LONG_S)
        PLACE.expect_answer()
        before = server.connections
        assert before
        PLACE.expect_answer()
        assert server.connections == before


@pytest.mark.usefixtures("hanging")
def test_a_publisher_does_not_ask_again_to_remove_what_it_has_not_written(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked, ask = [], endpoint._ask

    def counted(*words: str) -> None:
        asked.append(words)
        ask(*words)

    monkeypatch.setattr(endpoint, "_ask", counted)
    with pytest.raises(StoreError, match="does not answer"):
        expect_safe(PLACE)
    assert len(asked) == 1


def test_a_library_that_hangs_as_it_is_loaded_is_an_error_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As in a home folder on a network; the server is not blamed for that."""
    (tmp_path / "deltalake.py").write_text("import time; time.sleep(600)", "utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr(endpoint, "LOADS_S", 0.3)
    asked = place_of("s3://plant-runs/not-asked-before")
    with pytest.raises(StoreError) as hung:
        asked.expect_answer()
    assert str(hung.value) == (
        f"{asked}: its server was not asked: deltalake did not load within 0.3 s"
    )


@pytest.mark.usefixtures("hanging")
def test_a_password_in_the_address_is_not_shown() -> None:
    with pytest.raises(StoreError) as refused:
        PLACE.expect_answer()
    assert str(refused.value) == (
        f"{PLACE}: its server 127.0.0.1:9 ({endpoint.ENDPOINT}) does not answer within 0.1 s"
    )


@pytest.mark.usefixtures("hanging")
def test_without_credentials_it_says_where_they_come_from(monkeypatch: pytest.MonkeyPatch) -> None:
    """The library then asks the computer's network for them."""
    monkeypatch.delenv(endpoint.KEY)
    with pytest.raises(StoreError, match=f"does not answer within 0.1 s; .*{endpoint.KEY}"):
        PLACE.expect_answer()


@pytest.mark.parametrize("kind", sorted({*SERVERS} - {*NO_ANSWER}))
def test_any_answer_is_the_library_s_to_judge(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(endpoint, "ANSWERS_S", LONG_S)
    with SilentServer(kind, monkeypatch) as server:
        PLACE.expect_answer()
        assert server.connections


def test_a_request_has_half_a_minute_unless_the_environment_gives_it_more(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv(place.TIMEOUT, raising=False)
    assert (PLACE.options or {})["timeout"] == "30s"
    monkeypatch.setenv(place.TIMEOUT, "2m")
    assert (PLACE.options or {})["timeout"] == "2m"
    assert place_of(tmp_path).options is None


@pytest.mark.parametrize("kind", LATER)
def test_a_server_that_is_slow_only_later_is_an_error(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(endpoint, "ANSWERS_S", LONG_S)
    monkeypatch.setenv(place.TIMEOUT, "1s")
    with SilentServer(kind, monkeypatch) as server:
        PLACE.expect_answer()
        assert server.connections
        began = time.monotonic()
        with pytest.raises(StoreError) as slow:
            PLACE.has_table("runs")
        assert time.monotonic() - began < LONG_S
    assert "does not answer" not in str(slow.value)  # that is the first question's error


@pytest.mark.parametrize(
    "url", ["http://", "http://127.0.0.1:99999", "127.0.0.1:9000", "ftp://127.0.0.1", "http://["]
)
def test_an_address_that_is_none_is_the_library_s_to_judge(
    url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(endpoint, "ANSWERS_S", LONG_S)
    monkeypatch.setenv(endpoint.ENDPOINT, url)
    for name in PROXIES:
        monkeypatch.delenv(name, raising=False)
    PLACE.expect_answer()
