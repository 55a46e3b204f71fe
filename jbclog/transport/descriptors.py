"""Descriptors: how many ports one process may hold open."""

from __future__ import annotations

from jbclog.errors import UsageError

EACH_PORT = 5  # pyserial opens two pipes beside the device
BESIDE = 64  # the record, the loop, the interpreter


def allow_ports(ports: int) -> None:
    """Raise this process's soft limit so that `ports` ports fit. Raises `UsageError` where the hard limit forbids it."""
    try:
        import resource
    except ImportError:  # Windows has no such limit
        return
    wanted = ports * EACH_PORT + BESIDE
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft >= wanted or soft == resource.RLIM_INFINITY:
        return
    if hard != resource.RLIM_INFINITY and hard < wanted:
        raise UsageError(
            f"{ports} ports need {wanted} open files and this process may have {hard}; raise it with `ulimit -Hn {wanted}` "
            "or LimitNOFILE= in the systemd unit, or split the line"
        )
    resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
