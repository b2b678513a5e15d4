"""Frames and fused maps of recordings as NumPy arrays and point clouds."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.errors import RecordingError
from drivers.messages import decode_calibration, decode_image
from drivers.recording import Recording, open_recording
from service.files import whole_file
from service.jobs.ply import write_ply
from service.messages.topics import (
    FUSED_AMPLITUDE,
    FUSED_CALIBRATION,
    FUSED_DEPTH,
    FUSED_DEVIATION,
    FUSED_REASON,
)
from solver.geometry.points import distance_from_depth, points_from_distance

Arrays = dict[str, NDArray[Any]]

_MOST_TERMS = 14
"""Of OpenCV's distortion."""

_NUMBERS = (
    "pan",
    "tilt",
    "integration_time",
    "modulation_frequency",
    "ambiguity_range",
    "metres_per_count",
)

_MAP_TOPICS = {
    FUSED_DEPTH: "depth",
    FUSED_DEVIATION: "deviation",
    FUSED_AMPLITUDE: "amplitude",
    FUSED_REASON: "reason",
}


def frame_arrays(recording: Recording, which: slice = slice(None)) -> Arrays:
    """Every frame, or `which` of them, stacked.

    Returns:
        counts (N, H, W) uint16, or float32 metres; amplitude (N, H, W) uint16 where all frames have one;
        distance (N, H, W) float32 metres, NaN where there is none, as delivered; timestamp (ns), sequence,
        burst and pose (−1 = not said), pan and tilt (radians), integration_time (seconds),
        modulation_frequency (Hz), ambiguity_range (metres), metres_per_count, NaN = not known or none, and
        burst_index, the number of the burst in the recording (two may have one id), each (N,).

    Raises:
        RecordingError: the frames have several sizes.
    """
    entries = recording.entries[which]
    if len({entry.shape for entry in entries}) > 1:
        raise RecordingError(f"{recording.path}: its frames have several sizes; export them as .ply")
    frames, bursts = list(recording.fetch(entries)), recording.cut(None)
    images = ["counts", "distance"]
    if all(frame.has_amplitude for frame in frames):
        images.append("amplitude")
    said: Arrays = {name: np.stack([getattr(frame, name) for frame in frames]) for name in images}
    for name in ("timestamp", "sequence"):
        said[name] = np.array([getattr(frame, name) for frame in frames], dtype=np.int64)
    for name in ("burst", "pose"):
        values = [getattr(frame, name) for frame in frames]
        said[name] = np.array([-1 if value is None else value for value in values], dtype=np.int64)
    for name in _NUMBERS:
        values = [getattr(frame, name) for frame in frames]
        said[name] = np.array([np.nan if value is None else value for value in values])
    said["burst_index"] = np.repeat(np.arange(len(bursts)), [len(burst) for burst in bursts])[which]
    return said


def fused_maps(recording: Recording) -> list[Arrays]:
    """Every fused map.

    Returns:
        for each, depth and, where they were recorded, deviation (metres) and amplitude, (βH, βW) float32,
        and reason, uint8 (0 measured, 1 filled; unknown: 2 dark, 3 saturated, 4 contradicted, 5 outside);
        timestamp (ns, of the reference frame); intrinsics (3, 3) and distortion where there is a calibration.
    """
    found: dict[tuple[int, int], Arrays] = {}
    for message, _ in recording.messages([*_MAP_TOPICS, FUSED_CALIBRATION]):
        parts = found.setdefault((message.publish_time, message.sequence), {})
        parts["timestamp"] = np.array(message.publish_time)
        if message.topic == FUSED_CALIBRATION:
            said = decode_calibration(message.payload)
            if len(said.K) != 9:
                raise RecordingError(f"{FUSED_CALIBRATION}: K has {len(said.K)} values, expected 9")
            parts |= {"intrinsics": np.array(said.K).reshape(3, 3), "distortion": np.array(said.D)}
        else:
            parts[_MAP_TOPICS[message.topic]] = decode_image(message.payload)
    maps = [parts for parts in found.values() if "depth" in parts]
    for parts in maps:
        shapes = {parts[name].shape for name in _MAP_TOPICS.values() if name in parts}
        if len(shapes) > 1:
            raise RecordingError(
                f"{recording.path}: the images of the map at {parts['timestamp']} ns have sizes "
                f"{', '.join(map(str, shapes))}; expected one"
            )
    return maps


def export_arrays(recording: Recording, path: Path, which: slice | None = None) -> str:
    """Write everything as one .npz, or `which` of what `clouds` gives; returns what it holds, in words.

    Frames as `frame_arrays` has them, with `intrinsics` and `distortion` where there is a calibration, or
    `burst_intrinsics` (B, 3, 3) and `burst_distortion` (B, 14) where bursts have different ones; fused maps
    of one size stacked as `fused_depth`, `fused_deviation`, `fused_amplitude`, `fused_reason` and
    `fused_timestamp`, with `fused_intrinsics` and `fused_distortion` of the first.

    Raises:
        RecordingError: there are neither frames nor maps, none of that number, or some of several sizes.
        OutputError: the file cannot be written.
    """
    arrays: Arrays = {}
    frames, maps = range(recording.frame_count), fused_maps(recording)
    if not (frames or maps):
        raise RecordingError(f"{recording.path}: holds neither frames nor fused maps; nothing to export")
    if which is not None:
        frames, maps = frames[:0] if maps else frames[which], maps[which]
        if not (frames or maps):
            raise none_of(recording, which.start)
    if frames:
        arrays |= frame_arrays(open_recording(recording.path), which or slice(None))
        arrays |= _lens(recording, np.unique(arrays["burst_index"]))
    if len({found["depth"].shape for found in maps}) > 1:
        raise RecordingError(f"{recording.path}: its fused maps have several sizes; export them as .ply")
    for name in set.intersection(*(set(found) for found in maps)) if maps else set():
        stacked = [found[name] for found in maps]
        arrays[f"fused_{name}"] = stacked[0] if name in ("intrinsics", "distortion") else np.stack(stacked)
    with whole_file(path) as partial, partial.open("wb") as stream:
        np.savez_compressed(stream, **arrays)  # type: ignore[arg-type]
    return f"{len(frames)} frames, {len(maps)} fused maps"


def none_of(recording: Recording, number: int) -> RecordingError:
    """What is said where there is no map, nor frame, of a number."""
    return RecordingError(f"{recording.path}: has no map or frame number {number}; they count from 0")


def clouds(recording: Recording) -> Iterator[NDArray[Any]]:
    """Points of each fused map, or of each frame where there is no map.

    Yields:
        (M,) structured float32: x, y, z (metres; right, down, forward), amplitude, and of maps deviation and
        reason; points that are not known are left out.

    Raises:
        RecordingError: there is no calibration, or nothing to make points of.
    """
    maps = fused_maps(recording)
    if maps:
        yield from (_map_points(found, recording) for found in maps)
        return
    whole = open_recording(recording.path)
    for frame in whole.frames():
        known = whole.calibration_of(frame)
        distance = known.correct(frame.distance, frame.ambiguity_range)
        xyz = points_from_distance(distance, known.intrinsics.matrix, known.distortion or None)
        light = {} if frame.amplitude is None else {"amplitude": frame.amplitude.astype(np.float32)}
        yield _points(xyz, light)


def export_cloud(points: NDArray[Any], path: Path) -> str:
    """Write points as PLY; returns what was written, in words. Raises `OutputError`."""
    with whole_file(path) as partial:
        write_ply(partial, points)
    return f"{len(points)} points"


def _map_points(found: Arrays, recording: Recording) -> NDArray[Any]:
    if "intrinsics" not in found:
        raise RecordingError(f"{recording.path}: its fused maps have no {FUSED_CALIBRATION}; export as .npz")
    lens = found["distortion"] if found["distortion"].any() else None
    distance = distance_from_depth(found["depth"], found["intrinsics"], lens)
    xyz = points_from_distance(distance, found["intrinsics"], lens)
    return _points(xyz, {name: found[name] for name in ("amplitude", "deviation", "reason") if name in found})


def _points(xyz: NDArray[np.float32], more: Arrays) -> NDArray[Any]:
    known = np.isfinite(xyz[..., 2])
    points = np.empty(int(known.sum()), dtype=[(name, "<f4") for name in ("x", "y", "z", *more)])
    for number, name in enumerate(("x", "y", "z")):
        points[name] = xyz[..., number][known]
    for name, image in more.items():
        points[name] = image[known]
    return points


def _lens(recording: Recording, wanted: NDArray[np.int64]) -> Arrays:
    bursts = recording.cut(None)
    try:
        known = [recording.calibration_of(bursts[number][0]) for number in wanted]
    except RecordingError:  # arrays are of use without it
        return {}
    first = known[0]
    if all((one.intrinsics, one.distortion) == (first.intrinsics, first.distortion) for one in known):
        return {"intrinsics": first.intrinsics.matrix, "distortion": np.array(first.distortion)}
    terms = np.zeros((len(known), _MOST_TERMS))
    for row, one in zip(terms, known, strict=True):
        row[: len(one.distortion)] = one.distortion
    return {
        "burst_intrinsics": np.stack([one.intrinsics.matrix for one in known]),
        "burst_distortion": terms,
    }
