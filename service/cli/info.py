"""`lidarboost info`: what a recording holds, and what is wrong with it."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from drivers.calibration import Calibration
    from drivers.recording import RecordingSummary
    from drivers.recording.summary import FramesSummary

MOST_BURSTS = 8
"""Lines of bursts that are shown."""


def info(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A recording (MCAP), whole, torn or active.")],
    as_json: Annotated[bool, typer.Option("--json", help="Everything as JSON.")] = False,
) -> None:
    """Show what a recording holds: frames, bursts, calibration, truth, topics, attachments, damage.

    The file is read through once and its checksums compared. The status is 3 where something is missing.
    """
    from drivers.recording import Recording
    from service.cli import DATA_LOST

    summary = Recording(file).summary()
    if as_json:
        print(summary.model_dump_json(indent=2))
    else:
        print("\n".join(f"{name:<12} {said}" for name, said in _lines(summary)))
    if summary.damage is not None:
        raise typer.Exit(DATA_LOST)


def _lines(summary: "RecordingSummary") -> Iterator[tuple[str, str]]:
    yield "recording", f"{summary.path}, {_bytes(summary.size)}"
    if summary.start is not None:
        at = f"{summary.start:%Y-%m-%d %H:%M:%S.%f} UTC" if summary.start.year > 1970 else "date not known"
        yield "recorded", f"{at}, for {summary.duration:.3f} s"
    if summary.frames is not None:
        yield from _frame_lines(summary.frames)
    if summary.problem is not None:
        yield "problem", summary.problem
    if summary.calibration is not None:
        yield "calibration", _calibration(summary.calibration)
    else:
        yield "calibration", f"none: {summary.calibration_problem}"
    if summary.truth_problem is not None:
        yield "truth", f"none: {summary.truth_problem}"
    if summary.truth is not None:
        yield "truth", f"{summary.truth[1]} × {summary.truth[0]} pixels of the first pose, noise-free"
    for topic in summary.topics:
        rate = "" if topic.rate is None else f", {topic.rate:.2f} Hz"
        yield "topic", f"{topic.topic:<20} {topic.messages:>7} × {topic.schema_name}{rate}"
    for attached in summary.attachments:
        yield "attachment", f"{attached.name:<20} {_bytes(attached.size):>9}, {attached.media_type}"
    for key, value in sorted(summary.metadata.items()):
        yield "metadata", f"{key} = {value}"
    yield "damage", summary.damage_text or "none, checksums agree"
    if summary.damage is not None and (summary.topics or summary.attachments or summary.metadata):
        yield "", f"to make a whole file of the rest: lidarboost recover {summary.path}"


def _frame_lines(frames: "FramesSummary") -> Iterator[tuple[str, str]]:
    rate = "" if frames.rate is None else f", {frames.rate:.2f} Hz"
    drops = "none dropped" if frames.drops == 0 else f"{frames.drops} dropped by the camera"
    if frames.passed:
        drops += f" ({frames.passed} passed while the stage turned or between bursts)"
    yield (
        "frames",
        f"{frames.count} of {frames.shape[1]} × {frames.shape[0]} pixels{rate}, "
        f"over {frames.duration:.3f} s, {drops}",
    )
    times = ", ".join(
        "not known" if time is None else f"{time * 1e3:g} ms" for time in frames.integration_times
    )
    yield (
        "settings",
        f"integration time {times}; modulation {_carriers(frames)}; "
        f"amplitude {', '.join(frames.amplitude_modes)}",
    )
    for burst in frames.bursts[:MOST_BURSTS]:
        name = "no burst id" if burst.burst is None else f"burst {burst.burst}"
        yield (
            "burst",
            f"{name}: {burst.frames} frames{_size(burst.shape, frames.shape)}, "
            f"pan {burst.pan[0]:.3f}° to {burst.pan[1]:.3f}°, "
            f"tilt {burst.tilt[0]:.3f}° to {burst.tilt[1]:.3f}°",
        )
    if len(frames.bursts) > MOST_BURSTS:
        yield "", f"and {len(frames.bursts) - MOST_BURSTS} more bursts"


def _carriers(frames: "FramesSummary") -> str:
    if frames.ambiguity_ranges == [None]:
        return "none known, so distances do not wrap"
    carrier = ", ".join(
        "none" if frequency is None else f"{frequency / 1e6:g} MHz"
        for frequency in frames.modulation_frequencies
    )
    reach = ", ".join("none" if metres is None else f"{metres:.3f} m" for metres in frames.ambiguity_ranges)
    return f"{carrier} (range {reach})"


def _size(shape: tuple[int, int], usual: tuple[int, int]) -> str:
    return "" if shape == usual else f" of {shape[1]} × {shape[0]} pixels"


def _calibration(known: "Calibration") -> str:
    lens = known.intrinsics
    distortion = ", ".join(f"{term:g}" for term in known.distortion) or "none"
    noise = "not measured" if known.noise is None else f"σ = {known.noise.coefficient:g} m / amplitude"
    return (
        f"f = {lens.fx:.2f}, {lens.fy:.2f} px, centre {lens.cx:.2f}, {lens.cy:.2f} px, "
        f"distortion {distortion}, noise {noise} ({known.source})"
    )


def _bytes(size: int) -> str:
    return f"{size / 1e6:.2f} MB" if size >= 1e5 else f"{size / 1e3:.1f} kB"
