"""Tells systemd how the service is doing (sd_notify(3)); does nothing where it was not started by systemd."""

import os
import socket

READY = "READY=1"
STOPPING = "STOPPING=1"
WATCHDOG = "WATCHDOG=1"


def notify(*messages: str) -> None:
    """Send lines such as `READY=1` or `STATUS=…`; one that does not arrive does no harm here."""
    address = os.environ.get("NOTIFY_SOCKET")
    if not address:
        return
    if address.startswith("@"):
        address = "\0" + address[1:]  # the abstract namespace
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as channel:
        try:
            channel.sendto("\n".join(messages).encode(), address)
        except OSError:
            return
