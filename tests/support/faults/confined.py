"""A command under what a systemd unit lets it do, without systemd running: its system calls, its
address families, no new rights, no memory that is written and then executed, no file system to
write but for the folders named.

    python confined.py UNIT FOLDER[:FOLDER...] COMMAND...

Needs root, `systemd-analyze` (for the names behind @system-service) and libseccomp, which systemd
brings. Not done: namespaces of the unit's own, devices. PrivateTmp is an empty /var/tmp, to which
TMPDIR points: /tmp holds the folders of the test.
"""

from __future__ import annotations

import ctypes
import mmap
import os
import socket
import subprocess
import sys
from pathlib import Path
from typing import Final

CLONE_NEWNS, MS_REMOUNT, MS_BIND, MS_RDONLY, MS_REC, MS_PRIVATE = (
    0x20000,
    0x20,
    0x1000,
    1,
    0x4000,
    0x40000,
)
PR_SET_NO_NEW_PRIVS, PR_CAPBSET_DROP = 38, 24
ALLOW, EPERM, EQUAL, MASKED_EQUAL = 0x7FFF0000, 0x00050001, 4, 7
STAY: Final = ("/dev", "/proc", "/sys")  # ProtectSystem=strict leaves them writable


class Compared(ctypes.Structure):
    _fields_ = (
        ("arg", ctypes.c_uint),
        ("op", ctypes.c_int),
        ("a", ctypes.c_uint64),
        ("b", ctypes.c_uint64),
    )


def directives(text: str, key: str) -> list[str]:
    """The words of all lines of that key, in order."""
    return [
        word
        for line in text.splitlines()
        if line.startswith(f"{key}=")
        for word in line.partition("=")[2].split()
    ]


def calls_of(name: str) -> set[str]:
    """The system calls of a group, those of the groups in it included."""
    if not name.startswith("@"):
        return {name}
    done = subprocess.run(
        ["systemd-analyze", "--no-pager", "syscall-filter", name],
        capture_output=True,
        text=True,
        check=True,
    )
    words = [line.strip() for line in done.stdout.splitlines()[1:]]
    return {call for word in words if word and not word.startswith("#") for call in calls_of(word)}


def allowed_calls(text: str) -> set[str]:
    """By systemd's rule: the first line says that what is listed is allowed; ~ takes from it."""
    allowed = calls_of("@default")
    for line in (
        line.partition("=")[2] for line in text.splitlines() if line.startswith("SystemCallFilter=")
    ):
        named = {call for word in line.removeprefix("~").split() for call in calls_of(word)}
        allowed = allowed - named if line.startswith("~") else allowed | named
    return allowed


def main() -> None:
    unit, folders, *command = sys.argv[1:]
    text = Path(unit).read_text(encoding="utf-8")
    libc = ctypes.CDLL(None, use_errno=True)
    if "ProtectSystem=strict" in text:
        _close_the_disk(libc, folders.split(":"))
    if "PrivateTmp=yes" in text:
        _must(libc.mount(b"tmpfs", b"/var/tmp", b"tmpfs", 0, None), "private /var/tmp")
        os.environ["TMPDIR"] = "/var/tmp"
    calls, families = allowed_calls(text), directives(text, "RestrictAddressFamilies")
    if "CapabilityBoundingSet=" in text.splitlines():
        for capability in range(64):
            # those that this kernel does not have fail
            libc.prctl(PR_CAPBSET_DROP, capability, 0, 0, 0)
    _must(libc.prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0), "no_new_privs")
    if "MemoryDenyWriteExecute=yes" in text:
        _deny_code_in_memory()
    _filter(calls, {int(getattr(socket, family)) for family in families})
    os.execvp(command[0], command)


def _close_the_disk(libc: ctypes.CDLL, folders: list[str]) -> None:
    _must(libc.unshare(CLONE_NEWNS), "unshare")
    _must(libc.mount(b"none", b"/", None, MS_REC | MS_PRIVATE, None), "private")
    for folder in folders:
        _must(libc.mount(folder.encode(), folder.encode(), None, MS_BIND, None), folder)
    places = [line.split()[4] for line in Path("/proc/self/mountinfo").read_text().splitlines()]
    for place in places:
        if place not in folders and not place.startswith(STAY):
            _must(
                libc.mount(b"none", place.encode(), None, MS_REMOUNT | MS_BIND | MS_RDONLY, None),
                place,
            )


def _library() -> ctypes.CDLL:
    library = ctypes.CDLL("libseccomp.so.2", use_errno=True)
    library.seccomp_init.restype = ctypes.c_void_p
    return library


def _deny_code_in_memory() -> None:
    """As systemd does it: no memory both writable and executable, none becomes executable."""
    library = _library()
    context = ctypes.c_void_p(library.seccomp_init(ALLOW))
    for call, bits in {
        "mmap": mmap.PROT_WRITE | mmap.PROT_EXEC,
        "mprotect": mmap.PROT_EXEC,
    }.items():
        one = Compared(2, MASKED_EQUAL, bits, bits)
        number = library.seccomp_syscall_resolve_name(call.encode())
        _must(library.seccomp_rule_add_array(context, EPERM, number, 1, ctypes.byref(one)), call)
    _must(library.seccomp_load(context), "seccomp_load")


def _filter(calls: set[str], families: set[int]) -> None:
    library = _library()
    context = ctypes.c_void_p(library.seccomp_init(EPERM))
    for call in calls:
        number = library.seccomp_syscall_resolve_name(call.encode())
        if number < 0:
            continue  # of another kind of computer
        if call == "socket" and families:
            for family in families:
                one = Compared(0, EQUAL, family, 0)
                _must(
                    library.seccomp_rule_add_array(context, ALLOW, number, 1, ctypes.byref(one)),
                    call,
                )
        else:
            _must(library.seccomp_rule_add_array(context, ALLOW, number, 0, None), call)
    _must(library.seccomp_load(context), "seccomp_load")


def _must(result: int, what: str) -> None:
    if result != 0:
        sys.exit(f"not confined: {what}: {os.strerror(ctypes.get_errno() or -result)}")


if __name__ == "__main__":
    main()
