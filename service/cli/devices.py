"""`lidarboost devices`: what is plugged in, and learning a camera from a USB trace."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from drivers.listing import FoundDevice
    from drivers.usb.learn import RegisterName

app = typer.Typer(invoke_without_command=True, rich_markup_mode="rich", add_completion=False)

REGISTERS: tuple["RegisterName", ...] = ("integration_time", "amplitude_threshold")


@app.callback()
def devices(
    ctx: typer.Context,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """List cameras and the serial ports of stages, with backend and permission; nothing is sent to them."""
    if ctx.invoked_subcommand is not None:
        return
    from drivers.errors import NotAvailableError
    from drivers.listing import list_cameras, list_serial_ports, vendor_library_problem

    try:
        cameras, problem = list_cameras(), None
    except NotAvailableError as error:
        cameras, problem = [], str(error)
    ports = list_serial_ports()
    if as_json:
        found = [device.model_dump() for device in (*cameras, *ports)]
        print(json.dumps({"devices": found, "problem": problem}, indent=2))
        return
    _show(cameras, ports)
    print(f"vendor library: {vendor_library_problem() or 'found'}")
    if problem is not None:
        raise NotAvailableError(problem)


@app.command()
def learn(
    trace: Annotated[Path, typer.Argument(help="usbmon or USBPcap capture, pcapng or pcap.")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Profile to write (default: MODEL-learned.toml).")
    ] = None,
    model: Annotated[
        str | None, typer.Option(help="SR2A, SR2B, SR3000 or SR4000, where the trace does not tell.")
    ] = None,
    serial: Annotated[
        str | None, typer.Option(help="Serial number of the camera, where the trace does not tell.")
    ] = None,
    register: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=V1,V2,…",
            help="Values that were set, in this order, while the trace was taken: integration_time in "
            "register values, or amplitude_threshold in counts.",
        ),
    ] = None,
) -> None:
    """Write a USB profile from a trace of the vendor's software opening the camera, taking frames, closing.

    Begin the trace before the camera is plugged in. Linux: `modprobe usbmon`,
    then `tshark -i usbmon0 -w trace.pcapng`. Windows: Wireshark with USBPcap.
    Then plug in, let the software open the camera, take ten frames, close it.

    The profile is data: it lists the requests that were seen, and the camera
    `usb` sends no others, and to no camera with another serial number. Requests
    known to write flash are left out. What it will send is printed here, and
    logged whenever it is used, which needs `profile` and `allow_inferred = true`
    among the camera's options.
    """
    from drivers.usb.learn import learn as learn_profile

    lesson = learn_profile(trace, model, dict(_register(text) for text in register or ()), serial)
    path = output if output is not None else Path(f"{lesson.profile.model.lower()}-learned.toml")
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(lesson.profile.to_toml())
    except FileExistsError:
        raise typer.BadParameter(f"{path} exists already: name another file with -o, or remove it") from None
    for finding in lesson.findings:
        print(finding)
    print(
        f"written: {path}. To use it: camera.backend = 'usb', camera.options = "
        f"{{ profile = '{path}', allow_inferred = true }}"
    )


def _register(text: str) -> tuple["RegisterName", Sequence[int]]:
    name, _, values = text.partition("=")
    if name not in REGISTERS:
        raise typer.BadParameter(f"{text!r}: expected {' or '.join(REGISTERS)}, = and values")
    limit = 0xFF if name == "integration_time" else 0xFFFF
    try:
        numbers = [int(value, 0) for value in values.split(",")]
    except ValueError:
        raise typer.BadParameter(f"{text!r}: expected whole numbers separated by commas") from None
    if not all(0 <= number <= limit for number in numbers):
        raise typer.BadParameter(f"{text!r}: {name} takes 0 to {limit}")
    return name, numbers


def _show(cameras: Sequence["FoundDevice"], ports: Sequence["FoundDevice"]) -> None:
    from rich.table import Table

    from service.cli.terminal import console

    screen = console()
    for title, found in (("Cameras", cameras), ("Serial ports", ports)):
        if not found:
            print(f"{title}: none found")
            continue
        table = Table("Model", "Serial", "Where", "Backend", "Permission", title=title, title_justify="left")
        for device in found:
            cells: list[Any] = [device.model, device.serial or "–", device.where, device.backend]
            table.add_row(*cells, device.permission)
        screen.print(table)
    for device in (*cameras, *ports):
        if device.remedy:
            print(f"{device.where}: {device.remedy}")
