import errno
import os
import pty
import socket

import pytest
import serial

from drivers.clock import SystemClock
from drivers.errors import DeviceLostError, NotAvailableError
from drivers.stages.serial_line import SerialLine


@pytest.fixture
def terminal():
    master, slave = pty.openpty()
    yield master, os.ttyname(slave)
    for end in (slave, master):
        try:
            os.close(end)
        except OSError:
            continue


def received(line, end):
    """Bytes up to `end`, however they are portioned."""
    data = b""
    while not data.endswith(end):
        data += line.receive(1.0)
    return data


def test_bytes_go_both_ways_and_silence_is_empty(terminal):
    master, name = terminal
    line = SerialLine.open(name, 9600, SystemClock())
    line.send(b"PP ")
    assert os.read(master, 10) == b"PP "
    os.write(master, b"* 1")
    assert received(line, b"1") == b"* 1"
    assert line.receive(0.05) == b""
    assert line.pending() == b""
    os.write(master, b"noise")
    assert line.discard(0.05) == b"noise"
    line.close()
    line.close()


def test_port_is_exclusive(terminal):
    _, name = terminal
    line = SerialLine.open(name, 9600, SystemClock())
    with pytest.raises(NotAvailableError, match=f"another program uses the serial port.*fuser -v {name}"):
        SerialLine.open(name, 9600, SystemClock())
    line.close()


def test_cable_that_comes_off_is_one_error_everywhere(terminal):
    master, name = terminal
    line = SerialLine.open(name, 9600, SystemClock())
    os.close(master)
    for action in (lambda: line.receive(0.1), line.pending, lambda: line.send(b"PP ")):
        with pytest.raises(DeviceLostError, match="the serial line is gone"):
            action()
    line.close()


def test_missing_permission_comes_with_the_line_that_mends_it(terminal, monkeypatch):
    _, name = terminal

    def refuse(*_, **__):
        raise serial.SerialException(errno.EACCES, "could not open port: Permission denied")

    monkeypatch.setattr("serial.serial_for_url", refuse)
    monkeypatch.setenv("USER", "ada")
    with pytest.raises(NotAvailableError, match=r"run: sudo usermod -aG \w+ ada  \(then log in again\)"):
        SerialLine.open(name, 9600, SystemClock())


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("/dev/no-such-port", "there is no such serial port; plug the device in"),
        ("gopher://stage", "protocol 'gopher' not known"),
        ("socket://127.0.0.1:1", "Connection refused"),
    ],
)
def test_port_that_cannot_be_opened(name, said):
    with pytest.raises(NotAvailableError, match=said):
        SerialLine.open(name, 9600, SystemClock())


def test_stage_behind_a_network_socket():
    with socket.create_server(("127.0.0.1", 0)) as server:
        line = SerialLine.open(f"socket://127.0.0.1:{server.getsockname()[1]}", 9600, SystemClock())
        connection, _ = server.accept()
        with connection:
            line.send(b"PP ")
            assert connection.recv(10) == b"PP "
            connection.sendall(b"* 1\r\n")
            assert received(line, b"\n") == b"* 1\r\n"
        with pytest.raises(DeviceLostError):
            line.receive(1.0)
        line.close()
