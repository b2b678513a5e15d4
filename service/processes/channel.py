"""Objects from process to process, their arrays through anonymous shared memory.

An object is pickled with its arrays left out (protocol 5); all of it lies in a memfd, of which only the
descriptor crosses the socket. Nothing has a name, so nothing is left behind whichever process is killed. Both
ends are this program: nothing that comes from a file or the network is ever read here.
"""

import array
import mmap
import os
import pickle
import socket
import struct
import time
from collections.abc import Callable
from typing import Any

from service.errors import WorkerError

_ALIGNMENT = 64
"""Bytes; a cache line, and what vector instructions want."""

_LENGTH = struct.Struct("<Q")

_LOOK = 0.5
"""Seconds between two looks whether waiting was cancelled."""


class Channel:
    """One end of a connection; for one thread at a time."""

    def __init__(self, connection: socket.socket) -> None:
        self._socket = connection

    @classmethod
    def pair(cls) -> tuple["Channel", "Channel"]:
        """Two connected ends."""
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        return cls(ours), cls(theirs)

    def fileno(self) -> int:
        """The descriptor, to be inherited by a child."""
        return self._socket.fileno()

    def send(self, value: object, timeout: float = 10.0) -> None:
        """Send an object.

        Raises:
            WorkerError: the other end is gone, or takes nothing for `timeout` seconds.
        """
        memory = _written(value)
        try:
            self._socket.settimeout(timeout)
            descriptors = [(socket.SOL_SOCKET, socket.SCM_RIGHTS, array.array("i", [memory]))]
            self._socket.sendmsg([b"\0"], descriptors)
        except TimeoutError as error:
            raise WorkerError(f"it took nothing for {timeout:g} s") from error
        except OSError as error:
            raise WorkerError(f"it is gone ({error.strerror or error})") from error
        finally:
            os.close(memory)

    def receive(self, timeout: float | None = None, cancelled: Callable[[], bool] = lambda: False) -> Any:
        """The next object; its arrays lie in shared memory, which is freed with them.

        Raises:
            TimeoutError: none within `timeout` seconds, or `cancelled` became true.
            EOFError: the other end is gone.
        """
        end = None if timeout is None else time.monotonic() + timeout
        while True:
            left = _LOOK if end is None else min(_LOOK, max(0.001, end - time.monotonic()))
            self._socket.settimeout(left)
            try:
                said, descriptors, _, _ = socket.recv_fds(self._socket, 1, 1)
            except TimeoutError:
                if cancelled() or (end is not None and time.monotonic() >= end):
                    raise
                continue
            except OSError as error:
                raise EOFError(str(error)) from error
            if not said or not descriptors:
                raise EOFError("closed")
            return _read(descriptors[0])

    def close(self) -> None:
        """Close this end."""
        self._socket.close()


def _written(value: object) -> int:
    """A memfd that holds the object: count of parts, their lengths, then each part aligned."""
    buffers: list[pickle.PickleBuffer] = []
    text = pickle.dumps(value, protocol=5, buffer_callback=buffers.append)
    parts = [memoryview(text), *(buffer.raw() for buffer in buffers)]
    memory = os.memfd_create("lidarboost", os.MFD_CLOEXEC)
    try:
        header = b"".join(_LENGTH.pack(number) for number in (len(parts), *(part.nbytes for part in parts)))
        place = _write(memory, memoryview(header), 0)
        for part in parts:
            place = _write(memory, part, _aligned(place))
        os.ftruncate(memory, max(1, place))
    except BaseException:
        os.close(memory)
        raise
    return memory


def _write(memory: int, data: memoryview, place: int) -> int:
    """Write at a place; returns where it ends."""
    while data.nbytes:
        done = os.pwrite(memory, data, place)
        data, place = data[done:], place + done
    return place


def _read(memory: int) -> Any:
    try:
        # Private: who receives may write to its arrays without the sender or anybody else noticing.
        content = mmap.mmap(memory, 0, flags=mmap.MAP_PRIVATE, prot=mmap.PROT_READ | mmap.PROT_WRITE)
    finally:
        os.close(memory)
    view = memoryview(content)
    (count,) = _LENGTH.unpack_from(view)
    lengths = [_LENGTH.unpack_from(view, _LENGTH.size * (k + 1))[0] for k in range(count)]
    place, parts = _LENGTH.size * (count + 1), []
    for length in lengths:
        place = _aligned(place)
        parts.append(view[place : place + length])
        place += length
    return pickle.loads(parts[0], buffers=parts[1:])


def _aligned(place: int) -> int:
    return -(-place // _ALIGNMENT) * _ALIGNMENT
