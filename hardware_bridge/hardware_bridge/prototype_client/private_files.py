# SPDX-License-Identifier: Apache-2.0
"""Folders, files and sockets that are this user's alone: nothing that others could have put there, nothing through a link.

In a folder that several users share, such as `/tmp`, a name proves nothing: whoever comes first has it. What counts is
who owns what was really opened, and who may change it.
"""

import errno
import os
import socket
import stat
import struct
from collections.abc import Sequence
from pathlib import Path

_PEER = struct.Struct("iII")
_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH


def open_folder(path: Path, create: bool = False) -> int:
    """A descriptor of a folder of this user's that nobody else can write to. `create`: make it, for this user only.

    Raises:
        OSError: it is another user's, others can write to it, it is a link, it does not exist; `strerror` says which.
    """
    if create:
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
    try:
        folder = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError as error:
        if path.is_symlink():
            raise _refused(f"folder {path} is a link: name the folder itself") from error
        raise
    try:
        _require_ours(os.fstat(folder), f"folder {path}")
    except OSError:
        os.close(folder)
        raise
    return folder


def open_file(folder: int, name: str, flags: int = os.O_RDONLY) -> int:
    """A descriptor of a regular file of this user's in an open folder; with O_CREAT it is made so. Raises OSError: as above."""
    try:
        descriptor = os.open(name, flags | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, mode=0o600, dir_fd=folder)
    except OSError as error:
        raise (_refused(f"{name} is a link: remove it") if error.errno == errno.ELOOP else error) from error
    try:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            raise _refused(f"{name} is no file")
        if flags & os.O_CREAT and status.st_uid == os.geteuid():
            os.fchmod(descriptor, 0o600)
            status = os.fstat(descriptor)
        _require_ours(status, name)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor


def read_link(folder: int, name: str) -> str:
    """Where a link of this user's in an open folder points. Raises OSError: there is none, or it is another user's."""
    if os.stat(name, dir_fd=folder, follow_symlinks=False).st_uid != os.geteuid():
        raise _refused(f"{name} belongs to another user")
    return os.readlink(name, dir_fd=folder)


def listen(path: Path, clients: int) -> socket.socket:
    """A Unix socket at `path` that only this user can connect to; waits for nobody. Raises OSError."""
    path.unlink(missing_ok=True)
    server = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        server.bind(os.fspath(path))
        path.chmod(0o600)
        server.listen(clients)
        server.setblocking(False)
    except OSError:
        server.close()
        raise
    return server


def connect(path: str | Path, limit_s: float, trusted: Sequence[int] = ()) -> socket.socket:
    """A connection to a Unix socket behind which is a process of this user's. `trusted`: further users' numbers.

    Raises:
        OSError: nobody listens; or whoever does is another user (PermissionError): nothing was sent, nothing must be read.
    """
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        connection.settimeout(limit_s)
        connection.connect(os.fspath(path))
        _, user = peer(connection)
        if user not in (os.geteuid(), *trusted):
            raise _refused(f"the process behind {path} is user {user}'s")
    except OSError:
        connection.close()
        raise
    return connection


def peer(connection: socket.socket) -> tuple[int, int]:
    """Process and user at the other end of a Unix socket, by the kernel's word: those who began to listen."""
    process, user, _ = _PEER.unpack(connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _PEER.size))
    return int(process), int(user)


def _require_ours(status: os.stat_result, what: str) -> None:
    if status.st_uid != os.geteuid():
        raise _refused(f"{what} belongs to user {status.st_uid}")
    if status.st_mode & _OTHERS_WRITE:
        raise _refused(f"others can write to {what}: chmod go-w")


def _refused(problem: str) -> PermissionError:
    return PermissionError(errno.EACCES, problem)
