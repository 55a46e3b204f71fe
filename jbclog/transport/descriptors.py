"""Descriptors: how many ports one process may hold open."""

from __future__ import annotations

from jbclog.core.errors import UsageError

EACH_PORT = 1  # `opening.py` frees the pipes that pyserial opens beside each device
BESIDE = 160  # the record, the loop, the interpreter, and eight ports being opened with five each


def allow_ports(ports: int) -> None:
    """Raise this process's soft limit so that `ports` ports fit. Raises `UsageError` where the hard limit forbids it."""
    try:
        import resource
    except ImportError:  # Windows has no such limit
        return
    wanted = ports * EACH_PORT + BESIDE
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY or soft >= wanted:
        return
    try:
        if hard == resource.RLIM_INFINITY or hard >= wanted:
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
            return
    except (OSError, ValueError):  # macOS has a ceiling below the hard limit
        pass
    raise UsageError(
        f"{ports} ports need {wanted} open files and this process may have only {hard}; raise that with "
        f"`ulimit -Hn {wanted}` as root or LimitNOFILE={wanted} in the systemd unit, or record the line in two runs"
    )
