"""How an audit is called by itself: a line for cron, two units for systemd, and in words the Task Scheduler of Windows."""

from __future__ import annotations

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Final

HOUR, MINUTE = 6, 17  # no hour that summer time takes away or gives twice; no minute at which all other timers ring
LONGEST: Final = "15min"
UNIT: Final = "jbclog-audit"

HARDENED: Final = """\
NoNewPrivileges=yes
CapabilityBoundingSet=
AmbientCapabilities=
ProtectSystem=strict
PrivateTmp=yes
PrivateMounts=yes
ProtectClock=yes
ProtectControlGroups=yes
ProtectHostname=yes
ProtectKernelLogs=yes
ProtectKernelModules=yes
ProtectKernelTunables=yes
LockPersonality=yes
MemoryDenyWriteExecute=yes
RemoveIPC=yes
RestrictNamespaces=yes
RestrictRealtime=yes
RestrictSUIDSGID=yes
SystemCallArchitectures=native
SystemCallFilter=@system-service
SystemCallFilter=~@privileged @resources
SystemCallFilter=setpriority
SystemCallErrorNumber=EPERM
RestrictAddressFamilies=AF_UNIX AF_INET AF_INET6
# Serial ports of USB adapters and of the computer; another kind needs a line with the name that /proc/devices has for it.
DevicePolicy=closed
DeviceAllow=char-ttyUSB rw
DeviceAllow=char-ttyACM rw
DeviceAllow=char-ttyS rw
"""
"""What a unit that talks to stations may do, and nothing else. The unit in profiles/systemd has the same lines and says why.

Left as they are: PrivateDevices (it takes the serial ports away), ProtectProc and ProcSubset (they hide who holds a port).
"""


@dataclass(frozen=True, slots=True)
class Timed:
    """What is to be called: the program, and its words behind `audit`, paths among them absolute.

    `folders` are those that it writes into, the ledger's first.
    """

    program: str
    words: tuple[str, ...]
    folders: tuple[str, ...]
    user: str

    @property
    def call(self) -> tuple[str, ...]:
        return (self.program, "audit", *self.words)


def program() -> str:
    """This very program, as it can be called from anywhere."""
    beside = Path(sys.executable).with_name("jbclog")
    return str(beside) if beside.exists() else "jbclog"


def timers_lines(timed: Timed) -> list[str]:
    """All three, each under a comment that says where it goes."""
    return [*_cron(timed), "", *_systemd(timed), "", *_windows(timed)]


def cron_line(timed: Timed) -> str:
    """A line for `crontab -e`. A % would end the command there."""
    call = " ".join(map(shlex.quote, (*timed.call, "--quiet"))).replace("%", "\\%")
    return f"{MINUTE} {HOUR} * * * {call}"


def service_text(timed: Timed) -> str:
    """The unit that does it once."""
    folders = " ".join(map(_path, timed.folders))
    return f"""[Unit]
Description=jbclog counter audit
RequiresMountsFor={folders}

[Service]
Type=oneshot
User={timed.user}
SupplementaryGroups=dialout
ExecStart={" ".join(map(_quoted, timed.call))}
# 1: something is due or suspect; the page and the exit code say so, and the service itself did its work.
SuccessExitStatus=1
TimeoutStartSec={LONGEST}

# It reads what it is given and writes only here; a ledger or page that you move needs its new folder here.
ReadWritePaths={folders}
ProtectHome=read-only
{HARDENED}"""


def timer_text() -> str:
    """The unit that calls it each day; a day on which the machine was off is made up for."""
    return f"""[Unit]
Description=jbclog counter audit, each day

[Timer]
OnCalendar=*-*-* {HOUR:02d}:{MINUTE:02d}:00
Persistent=true

[Install]
WantedBy=timers.target
"""


def _cron(timed: Timed) -> list[str]:
    return [
        "# cron: add this line with `crontab -e`. It says nothing where nothing is due and all went well; else cron mails it.",
        cron_line(timed),
    ]


def _systemd(timed: Timed) -> list[str]:
    return [
        f"# systemd: /etc/systemd/system/{UNIT}.service",
        service_text(timed).rstrip(),
        "",
        f"# systemd: /etc/systemd/system/{UNIT}.timer; then `systemctl daemon-reload && systemctl enable --now {UNIT}.timer`",
        timer_text().rstrip(),
    ]


def _windows(timed: Timed) -> list[str]:
    call = " ".join(f'"{word}"' if " " in word else word for word in timed.call[1:])
    return [
        "# Windows: in the Task Scheduler, Create Task; tick `Run whether user is logged on or not`.",
        f"#   Triggers: Daily, at {HOUR:02d}:{MINUTE:02d}.",
        f"#   Actions: Start a program; Program: {timed.program}; Add arguments: {call}",
        "#   Settings: tick `Run task as soon as possible after a scheduled start is missed`;",
        "#   if the task is already running: `Do not start a new instance`.",
        "# All times in the ledger are UTC, so that summer time changes nothing in it.",
    ]


def _path(path: str) -> str:
    """A path as the keys with lists of paths take it: % means something there, and a blank ends it."""
    plain = path.replace("\\", "\\\\").replace('"', '\\"').replace("%", "%%")
    return f'"{plain}"' if plain != path or any(sign.isspace() or sign == "'" for sign in path) else path


def _quoted(word: str) -> str:
    """A word as ExecStart takes it: % and $ mean something there, and so does a blank."""
    plain = word.replace("\\", "\\\\").replace('"', '\\"').replace("%", "%%").replace("$", "$$")
    return f'"{plain}"' if plain != word or any(sign.isspace() or sign in "';" for sign in word) else word
