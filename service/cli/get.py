"""`lidarboost get`: the latest value of a topic, shown or saved."""

from pathlib import Path
from typing import Annotated

import typer

from service.cli.remote import DEFAULT_ENDPOINT, DEFAULT_PREFIX, Endpoint, Prefix, Timeout, connected


def get(
    topic: Annotated[str, typer.Argument(metavar="TOPIC", help="For example fused/depth, or status.")],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", help="Save it: .npy, .npz, .ply (points) or .json."),
    ] = None,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    prefix: Prefix = DEFAULT_PREFIX,
    timeout: Timeout = 5.0,
) -> None:
    """Get the latest value of a topic from a running service.

    Images and points are described on standard output, everything else is printed as JSON. With `-o` they
    go to .npy (the array) or .npz (`value`, `timestamp`, `intrinsics`, `distortion`), points also to .ply.
    """
    from service.jobs.saving import describe, save, summarize, writer_for

    if output is not None:
        writer_for(output)
    with connected(endpoint, prefix) as client:
        received = client.latest(topic, timeout)
    if output is None:
        print(describe(received))
    else:
        save(received, output)
        print(f"wrote {output}: {summarize(received)}")
