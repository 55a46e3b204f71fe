"""A share: a folder that the kernel reaches through a file system of a program, as it reaches those
of SSH, S3 or Windows. Hard links work, are refused with an error, or are copies.

The program speaks the kernel's protocol itself (include/uapi/linux/fuse.h, version 7.31): names,
attributes and data go to a folder behind the share. It keeps nothing between two calls but the path
of each node.
"""

from __future__ import annotations

import ctypes
import errno
import os
import shutil
import stat
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

LINKS, COPIES = "links", "copies"
DETACH = 2  # of umount2
MOST_WRITTEN = 1 << 17
BUFFER = MOST_WRITTEN + 4096
IN, OUT = struct.Struct("<IIQQIIIHH"), struct.Struct("<IiQ")
SET_MODE, SET_SIZE, SET_ATIME, SET_MTIME = 1, 8, 16, 32
DONE = b""


@contextmanager
def fuse_share(mount: Path, behind: Path, links: str = LINKS) -> Iterator[Path]:
    """Mount `behind` at `mount` while a `with` lasts. `links`: ``links``, ``copies`` or the name of
    an error. Raises OSError where that cannot be.
    """
    for path in (mount, behind):
        path.mkdir()
    device = os.open("/dev/fuse", os.O_RDWR)
    try:
        options = f"fd={device},rootmode=40000,user_id={os.geteuid()},group_id={os.getegid()}"
        call("mount", b"jbclog-test", os.fsencode(mount), b"fuse", 0, options.encode())
        words = [sys.executable, __file__, str(device), str(behind), links]
        server = subprocess.Popen(words, pass_fds=[device])
    finally:
        os.close(device)
    try:
        yield mount
    finally:
        call("umount2", os.fsencode(mount), DETACH)
        server.kill()
        server.wait()


def call(name: str, *words: bytes | int) -> None:
    """Call a function of the C library. Raises OSError."""
    if getattr(ctypes.CDLL(None, use_errno=True), name)(*words):
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


class Share:
    """The file system: a method for each call of the kernel."""

    def __init__(self, behind: str, links: str) -> None:
        self._links = links
        self._paths: dict[int, str] = {1: behind}
        self._nodes: dict[str, int] = {behind: 1}
        self._last = 1
        self._calls: dict[int, Callable[[int, bytes], bytes]] = {
            1: self._lookup,
            3: self._attributes,
            4: self._change,
            9: self._make_folder,
            10: self._unlink,
            11: self._remove_folder,
            12: self._rename,
            13: self._link,
            14: self._open,
            15: self._read,
            16: self._write,
            17: self._space,
            18: self._close,
            20: self._sync,
            25: self._nothing,
            26: self._begin,
            27: self._nothing_opened,
            28: self._list,
            29: self._nothing,
            30: self._nothing,
            35: self._create,
            45: self._rename_2,
        }

    def answer(self, data: bytes) -> bytes | None:
        """Return the answer to a call of the kernel; None if it expects none."""
        _, code, unique, node, *_ = IN.unpack_from(data)
        if code in (2, 36, 42):  # forget, interrupt, forget many
            return None
        error, body = -errno.ENOSYS, b""
        if code in self._calls:
            try:
                error, body = 0, self._calls[code](node, data[IN.size :])
            except OSError as failed:
                error, body = -(failed.errno or errno.EIO), b""
        return OUT.pack(OUT.size + len(body), error, unique) + body

    def _begin(self, _: int, words: bytes) -> bytes:
        (ahead,) = struct.unpack_from("<8xI", words)
        return struct.pack("<4I2H2I2HI28x", 7, 31, ahead, 0, 16, 12, MOST_WRITTEN, 1, 0, 0, 0)

    def _nothing(self, _: int, __: bytes) -> bytes:
        return DONE

    def _nothing_opened(self, _: int, __: bytes) -> bytes:
        return struct.pack("<QII", 0, 0, 0)

    def _child(self, node: int, name: bytes) -> str:
        return f"{self._paths[node]}/{os.fsdecode(name.rstrip(bytes(1)))}"

    def _entry(self, path: str) -> bytes:
        found = os.lstat(path)
        if path not in self._nodes:
            self._last += 1
            self._nodes[path], self._paths[self._last] = self._last, path
        node = self._nodes[path]
        return struct.pack("<QQQQII", node, 0, 0, 0, 0, 0) + _facts(node, found)

    def _lookup(self, node: int, name: bytes) -> bytes:
        return self._entry(self._child(node, name))

    def _attributes(self, node: int, _: bytes) -> bytes:
        return struct.pack("<QII", 0, 0, 0) + _facts(node, os.lstat(self._paths[node]))

    def _change(self, node: int, words: bytes) -> bytes:
        valid, _, size, _, atime, mtime, _, a_ns, m_ns, _, mode = struct.unpack_from(
            "<I4xQQQQQQIIII", words
        )
        path = self._paths[node]
        if valid & SET_SIZE:
            os.truncate(path, size)
        if valid & SET_MODE:
            Path(path).chmod(stat.S_IMODE(mode))
        if valid & (SET_ATIME | SET_MTIME):
            before = os.lstat(path)
            times = (
                atime * 10**9 + a_ns if valid & SET_ATIME else before.st_atime_ns,
                mtime * 10**9 + m_ns if valid & SET_MTIME else before.st_mtime_ns,
            )
            os.utime(path, ns=times)
        return self._attributes(node, b"")

    def _make_folder(self, node: int, words: bytes) -> bytes:
        path = self._child(node, words[8:])
        Path(path).mkdir()
        return self._entry(path)

    def _unlink(self, node: int, name: bytes) -> bytes:
        self._gone(self._child(node, name), os.unlink)
        return DONE

    def _remove_folder(self, node: int, name: bytes) -> bytes:
        self._gone(self._child(node, name), os.rmdir)
        return DONE

    def _gone(self, path: str, how: Callable[[str], None]) -> None:
        how(path)
        self._nodes.pop(path, None)  # a file of that name made later is another node

    def _rename(self, node: int, words: bytes) -> bytes:
        return self._renamed(node, words, 8)

    def _rename_2(self, node: int, words: bytes) -> bytes:
        if struct.unpack_from("<8xI", words)[0]:
            raise OSError(errno.EINVAL, "flags")
        return self._renamed(node, words, 16)

    def _renamed(self, node: int, words: bytes, begin: int) -> bytes:
        (into,) = struct.unpack_from("<Q", words)
        name, new_name, _ = words[begin:].split(bytes(1))
        old, new = self._child(node, name), self._child(into, new_name)
        os.rename(old, new)  # noqa: PTH104  # texts, as all here
        self._nodes.pop(new, None)
        for path in [one for one in self._nodes if one == old or one.startswith(f"{old}/")]:
            number, moved = self._nodes.pop(path), new + path[len(old) :]
            self._nodes[moved], self._paths[number] = number, moved
        return DONE

    def _link(self, node: int, words: bytes) -> bytes:
        (old,) = struct.unpack_from("<Q", words)
        new = self._child(node, words[8:])
        if self._links == COPIES:
            shutil.copyfile(self._paths[old], new)
        elif self._links == LINKS:
            os.link(self._paths[old], new)
        else:
            raise OSError(getattr(errno, self._links), "")
        return self._entry(new)

    def _opened(self, path: str, flags: int, mode: int = 0o666) -> bytes:
        descriptor = os.open(path, flags & ~(os.O_NOFOLLOW | os.O_APPEND), stat.S_IMODE(mode))
        return struct.pack("<QII", descriptor, 0, 0)

    def _open(self, node: int, words: bytes) -> bytes:
        return self._opened(self._paths[node], struct.unpack_from("<I", words)[0])

    def _create(self, node: int, words: bytes) -> bytes:
        flags, mode = struct.unpack_from("<II", words)
        path = self._child(node, words[16:])
        opened = self._opened(path, flags | os.O_CREAT, mode)
        return self._entry(path) + opened

    def _read(self, _: int, words: bytes) -> bytes:
        file, offset, size = struct.unpack_from("<QQI", words)
        return os.pread(file, size, offset)

    def _write(self, _: int, words: bytes) -> bytes:
        file, offset, size = struct.unpack_from("<QQI", words)
        return struct.pack("<II", os.pwrite(file, words[40 : 40 + size], offset), 0)

    def _sync(self, _: int, words: bytes) -> bytes:
        os.fsync(struct.unpack_from("<Q", words)[0])
        return DONE

    def _close(self, _: int, words: bytes) -> bytes:
        os.close(struct.unpack_from("<Q", words)[0])
        return DONE

    def _space(self, _: int, __: bytes) -> bytes:
        found = os.statvfs(self._paths[1])
        blocks = (found.f_blocks, found.f_bfree, found.f_bavail, found.f_files, found.f_ffree)
        return struct.pack("<5Q3I28x", *blocks, found.f_bsize, 255, found.f_frsize)

    def _list(self, node: int, words: bytes) -> bytes:
        _, offset, size = struct.unpack_from("<QQI", words)
        listed = b""
        for place, name in enumerate(sorted(os.listdir(self._paths[node]))[offset:], offset + 1):  # noqa: PTH208  # texts
            text = os.fsencode(name)
            one = struct.pack("<QQII", place, place, len(text), 0) + text
            one += bytes(-len(one) % 8)
            if len(listed) + len(one) > size:
                break
            listed += one
        return listed


def _facts(node: int, found: os.stat_result) -> bytes:
    times = [found.st_atime_ns, found.st_mtime_ns, found.st_ctime_ns]
    return struct.pack(
        "<6Q10I",
        *(node, found.st_size, found.st_blocks, *(one // 10**9 for one in times)),
        *(one % 10**9 for one in times),
        *(found.st_mode, found.st_nlink, found.st_uid, found.st_gid, 0, 4096, 0),
    )


def serve(device: int, behind: str, links: str) -> None:
    """Answer the kernel until the share is unmounted."""
    share = Share(behind, links)
    with suppress(OSError):
        while True:
            answer = share.answer(os.read(device, BUFFER))
            if answer is not None:
                with suppress(FileNotFoundError):  # the call was interrupted
                    os.write(device, answer)


if __name__ == "__main__":
    serve(int(sys.argv[1]), *sys.argv[2:4])
