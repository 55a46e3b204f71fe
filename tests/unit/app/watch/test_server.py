"""Who is let in to the live view's page, and what it answers."""

from __future__ import annotations

import http.client
import json
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from jbclog.app.watch import server
from jbclog.app.watch.server import (
    FILES,
    MOST_BROWSERS,
    POLICY,
    WAITING,
    Access,
    Broadcast,
    is_loopback,
    listening,
)
from jbclog.core.errors import RecordError, UsageError
from support.command import until
from support.records import live_states
from support.records.live_rows import Recording
from support.virtual.watched_page import Served, page

TOKEN = "a-token-of-24-characters"


@pytest.fixture(scope="module")
def served() -> Iterator[Served]:
    with page(live_states.run()) as made:
        yield made


@pytest.fixture(scope="module")
def locked() -> Iterator[Served]:
    with page(live_states.run(), TOKEN, "0.0.0.0") as made:
        yield made


def test_isolation_is_asked_only_of_a_browser_that_heeds_it(served: Served) -> None:
    for headers, expected in (({}, None), ({"Sec-Fetch-Site": "none"}, "same-origin")):
        answer = asked(served, **headers)
        answer.read()
        answer.close_with.close()  # type: ignore[attr-defined]
        assert answer.headers["Cross-Origin-Opener-Policy"] == expected


def asked(
    served: Served, path: str = "/", method: str = "GET", **headers: str
) -> http.client.HTTPResponse:
    connection = http.client.HTTPConnection("127.0.0.1", served.port, timeout=60)
    connection.request(method, path, headers={"Host": f"127.0.0.1:{served.port}", **headers})
    answer = connection.getresponse()
    answer.close_with = connection  # type: ignore[attr-defined]  # keeps it open as long as the answer
    return answer


def code(served: Served, path: str = "/", method: str = "GET", **headers: str) -> int:
    answer = asked(served, path, method, **headers)
    answer.read()
    answer.close_with.close()  # type: ignore[attr-defined]
    return answer.status


def messages(served: Served, count: int, **headers: str) -> list[dict[str, object]]:
    answer = asked(served, "/events", **headers)
    found = []
    while len(found) < count:
        line = answer.readline()
        assert line, "the stream has ended"
        if line.startswith(b"data: "):
            found.append(json.loads(line[6:]))
    answer.close()
    answer.close_with.close()  # type: ignore[attr-defined]
    return found


@pytest.mark.parametrize("path", FILES)
def test_its_files_have_a_strict_policy(served: Served, path: str) -> None:
    answer = asked(served, path)
    text = answer.read().decode()
    answer.close_with.close()  # type: ignore[attr-defined]
    assert answer.status == 200
    assert answer.headers["Content-Security-Policy"] == POLICY
    assert "unsafe" not in POLICY
    assert answer.headers["X-Content-Type-Options"] == "nosniff"
    assert answer.headers["Cache-Control"] == "no-store"
    assert answer.headers["Server"] is None
    if path == "/":
        assert " style=" not in text
        assert "://" not in text


@pytest.mark.parametrize(
    "path",
    [
        *("/watch", "/../pyproject.toml", "/static/watch.js", "/uplot.js/", "/%2e%2e/server.py"),
        *("//etc/passwd", "/runs/..%2f..%2fetc%2fpasswd", "/runs/%2fetc%2fpasswd", "/runs/%00"),
        *("/runs/%2e%2e", "/runs/..%5c..", "/runs/%C0%AE%C0%AE/", f"/runs/{'a' * 5000}"),
    ],
)
def test_nothing_else_is_served(served: Served, path: str) -> None:
    assert code(served, path) in (404, 307)


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "TRACE"])
def test_it_only_reads(served: Served, method: str) -> None:
    assert code(served, "/", method) == 405
    assert code(served, "/events", method) == 405


@pytest.mark.parametrize(
    ("host", "expected"),
    [
        *(
            ("localhost", 200),
            ("localhost:1", 200),
            ("[::1]:8765", 200),
            ("127.0.0.1", 200),
            ("LOCALHOST:80", 200),
        ),
        *(
            ("evil.example", 421),
            ("evil.example:8765", 421),
            ("127.0.0.1.evil.example", 421),
            ("192.168.1.5", 421),
            ("", 421),
            ("127.0.0.1:80:80", 421),
            ("[::1]evil.example", 421),
            ("localhost.evil.example", 421),
            ("127.1", 421),
            ("0.0.0.0", 421),
        ),
    ],
)
def test_it_answers_to_its_own_names(served: Served, host: str, expected: int) -> None:
    assert code(served, "/", Host=host) == expected


@pytest.mark.parametrize(
    ("origin", "expected"),
    [
        ("http://127.0.0.1:{}", 200),
        ("http://evil.example", 403),
        ("null", 403),
        ("http://127.0.0.1:1", 403),
        ("https://127.0.0.1:{}", 403),
    ],
)
def test_other_origins_are_refused(served: Served, origin: str, expected: int) -> None:
    assert code(served, "/", Origin=origin.format(served.port)) == expected


def test_behind_a_proxy_with_tls_its_own_origin_is_that_of_the_proxy(served: Served) -> None:
    origin = f"https://127.0.0.1:{served.port}"
    assert code(served, "/", Origin=origin, **{"X-Forwarded-Proto": "https"}) == 200
    assert (
        code(served, "/", Origin=origin.replace("https", "http"), **{"X-Forwarded-Proto": "https"})
        == 403
    )


def test_another_address_needs_the_token(locked: Served) -> None:
    for path in ("/", "/events", "/watch.js", "/?token=wrong", "/?token=", "/?token=%C3%A4"):
        assert code(locked, path) == 401
    answer = asked(locked, f"/?token={TOKEN}")
    answer.close_with.close()  # type: ignore[attr-defined]
    assert (answer.status, answer.headers["Location"]) == (303, "/")
    cookie = answer.headers["Set-Cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=strict" in cookie
    assert code(locked, "/", Cookie=cookie.partition(";")[0]) == 200
    assert code(locked, "/", Cookie="jbclog_token=wrong") == 401


@pytest.mark.parametrize("host", ["192.168.1.5:8765", "[fe80::1]:80", socket.gethostname()])
def test_with_a_token_it_answers_to_its_addresses(locked: Served, host: str) -> None:
    assert code(locked, "/", Host=host) == 401
    assert code(locked, "/", Host="evil.example") == 421


def test_addresses() -> None:
    assert [
        is_loopback(one)
        for one in ("127.0.0.1", "127.9.9.9", "::1", "localhost", "0.0.0.0", "10.0.0.1", "line-pc")
    ] == [
        *[True] * 4,
        *[False] * 3,
    ]
    assert Access("line-pc", TOKEN).knows_host("line-pc:8765")
    assert not Access("line-pc", TOKEN).knows_host("other-pc:8765")


def test_a_port_in_use() -> None:
    with (
        listening("127.0.0.1", 0) as opened,
        pytest.raises(UsageError, match="cannot be used: Address already in use"),
    ):
        listening("127.0.0.1", opened.getsockname()[1])


def test_the_first_message_has_everything_and_later_ones_what_is_new(served: Served) -> None:
    first, second = messages(served, 2)
    assert first["whole"] is True
    assert second["whole"] is False
    (port, *_), (again, *_) = first["ports"], second["ports"]  # type: ignore[misc]  # lists
    assert (port["name"], port["now"], port["condition"]) == (
        "dde-1 port 1 T210",
        "349 °C",
        "normal",
    )
    assert (len(port["trace"]["seconds"]), len(again["trace"]["seconds"])) == (601, 0)
    assert again["trace"]["whole"] is False


def test_hidden_characters_stay_away(served: Served) -> None:
    assert "\x1b" not in json.dumps(messages(served, 1), ensure_ascii=False)


def test_no_run_and_trouble_are_messages() -> None:
    with page(None) as served:
        first = messages(served, 1)[0]
        assert (first["heading"], first["title"]) == (
            "no run in none yet; it is shown as soon as one begins",
            "NO RUN YET",
        )
        served.answer = RecordError("the disk is away")
        assert messages(served, 3)[-1] == {"trouble": "the disk is away"}
        served.answer = ValueError("a mistake of ours")
        assert "internal error" in str(messages(served, 3)[-1]["trouble"])
        served.answer = live_states.run()
        assert messages(served, 3)[-1]["run"] == "20261123T060000Z-bench-3-k7qd"


def test_a_hundred_browsers_and_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "WAITING", 1_000_000)  # a place is free with the end of its answer
    with page(live_states.run()) as served:
        opened = [asked(served, "/events") for _ in range(MOST_BROWSERS)]
        assert {one.status for one in opened} == {200}
        assert all(one.readline().startswith(b"data: ") for one in opened)
        assert code(served, "/events") == 503
        for one in opened:
            one.close()
            one.close_with.close()  # type: ignore[attr-defined]
        assert until(lambda: messages_or_none(served))
        assert messages(served, 1)[0]["whole"] is True


def test_a_browser_that_takes_nothing_loses_its_place() -> None:
    """One that has vanished without a word; what waits for it is not kept."""
    broadcast = Broadcast(lambda: None)
    silent, other = broadcast.join(), broadcast.join()
    assert silent is not None
    assert other is not None
    for number in range(WAITING + 1):
        broadcast._hand_out(str(number))
        assert other.get_nowait() == str(number)
    assert broadcast.browsers == {other}
    assert (silent.get_nowait(), silent.empty()) == (None, True)


def test_no_more_of_those_that_come_at_once() -> None:
    """Requests that wait together, before the first of them has its answer."""
    with page(live_states.run()) as served:
        request = f"GET /events HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\n\r\n".encode()
        opened = [
            socket.create_connection(("127.0.0.1", served.port), 60)
            for _ in range(MOST_BROWSERS + 20)
        ]
        for one in opened:
            one.sendall(request)
        codes = [one.recv(12).split()[1] for one in opened]
        for one in opened:
            one.close()
    assert (codes.count(b"200"), codes.count(b"503")) == (MOST_BROWSERS, 20)


def messages_or_none(served: Served) -> bool:
    answer = asked(served, "/events")
    answer.close_with.close()  # type: ignore[attr-defined]
    return answer.status == 200


def test_runs_and_their_reports(tmp_path: Path) -> None:
    ended = Recording(tmp_path)
    ended.finalize()
    (ended.folder / "report.html").write_text("<p>the report</p>")
    going = Recording(tmp_path, began_us=ended.began_us + 60_000_000)
    for path in (tmp_path, ended.folder):
        with page(None, path=path) as served:
            answer = asked(served, "/runs")
            listed = json.loads(answer.read())
            answer.close_with.close()  # type: ignore[attr-defined]
            assert listed == [
                {"run": going.folder.name, "text": "open", "report": False},
                {"run": ended.folder.name, "text": "ended · ACCEPT", "report": True},
            ]
            answer = asked(served, f"/runs/{ended.folder.name}")
            assert answer.read() == b"<p>the report</p>"
            answer.close_with.close()  # type: ignore[attr-defined]
            (policy,) = answer.headers.get_all("Content-Security-Policy")
            assert policy.startswith("sandbox allow-scripts")
            assert "allow-same-origin" not in policy
            for name in (
                going.folder.name,
                "notes",
                "..",
                "%2e%2e",
                f"{ended.folder.name}/manifest.json",
            ):
                assert code(served, f"/runs/{name}") in (404, 307)
    going.abandon()


def test_a_report_behind_a_link_is_not_served(tmp_path: Path) -> None:
    recording = Recording(tmp_path)
    recording.abandon()
    (tmp_path / "secret").write_text("secret")
    (recording.folder / "report.html").symlink_to(tmp_path / "secret")
    other = tmp_path / recording.folder.name.replace("bench", "other")
    other.symlink_to(recording.folder)
    with page(None, path=tmp_path) as served:
        assert code(served, f"/runs/{recording.folder.name}") == 404
        assert code(served, f"/runs/{other.name}") == 404


def test_runs_that_cannot_be_listed(tmp_path: Path) -> None:
    with page(None, path=tmp_path / "none") as served:
        assert code(served, "/runs") == 500
