"""Registration where texture looks alike in many places."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks" / "battery"))

from parts import checked, printed, scene, stairs, wall
from rig import BASE, FOCAL, RANGE, capture, look

from solver import FusionOptions, FusionWarning, SlidingFusion, fuse
from solver.registration import register


def registered(made, poses):
    burst = capture(look(made, (4,)), replace(BASE, poses=poses), seed=0)
    found = register(
        burst.distance,
        burst.amplitude,
        intrinsics=burst.given["intrinsics"],
        initial=burst.given.get("initial"),
        ambiguity_range=RANGE,
    )
    return found, FOCAL * np.abs(found.rotations - burst.rotations)[:, :2].max()


@pytest.mark.parametrize(
    "made",
    [
        scene("print", wall(2.0, texture=printed(0.3))),
        scene("stairs", stairs(1.9, 0.04, 7, printed(0.12, 4), lying=False)),
    ],
    ids=lambda made: made.name,
)
def test_text_is_placed_without_a_guess_and_no_frame_rejected(made):
    found, off = registered(made, "none")
    assert not found.rejected
    assert off < 0.05


def test_checks_stay_where_the_stage_says():
    """Each of their cells looks like the next but one."""
    found, off = registered(scene("checks", wall(2.0, texture=checked(0.3, 0.025))), "guess")
    assert not found.rejected
    assert off < 0.05


def shifted(light, span, frames=15, seed=0):
    """Frames of a slanted wall with light (rows, columns of 8 rays a pixel), and how far each is shifted."""
    random, rays, margin, size = np.random.default_rng(seed), 8, 4, (56, 64)
    row, column = (np.arange((n + 2 * margin) * rays) / rays - margin for n in size)
    row, column = np.meshgrid(row, column, indexing="ij")
    field = light(row, column) * np.exp(2j * np.pi * (2 + 0.002 * row) / RANGE)
    steps = np.rint(random.uniform(-span, span, (frames, 2)) * rays).astype(int)
    steps[0] = 0
    parts = []
    for down, right in margin * rays + steps:
        part = field[down : down + size[0] * rays, right : right + size[1] * rays]
        parts.append(part.reshape(size[0], rays, size[1], rays).mean((1, 3)))
    noises = random.normal(size=(2, frames, *size))
    phasors = np.array(parts) + 25 * (noises[0] + 1j * noises[1])
    return np.mod(np.angle(phasors), 2 * np.pi) * RANGE / (2 * np.pi), np.abs(phasors), steps / rays


def cells(period):
    return lambda row, column: np.where(
        (np.floor(2 * row / period) + np.floor(2 * column / period)) % 2 > 0, 1000, 3000
    )


def lines(period):
    return lambda row, column: np.where((np.mod(row, period) < 1) | (np.mod(column, period) < 1), 500, 3000)


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("light", [cells(24), lines(12)], ids=["checks", "lines"])
def test_frames_of_hard_edges_are_not_rejected_for_what_falls_between_pixels(light, seed):
    distance, amplitude, shifts = shifted(light, 1.5, seed=seed)
    found = register(distance, amplitude, ambiguity_range=RANGE)
    assert not found.rejected
    assert np.abs(found.shifts - shifts).max() < 0.15


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_mirrored_frames_and_noise_are_rejected_though_printed_alike(seed):
    ink = np.random.default_rng(3).random((120, 120)) < 0.5

    def text(row, column):
        return np.where(ink[(row / 0.8 + 20).astype(int), (column / 0.8 + 20).astype(int)], 600, 3000)

    distance, amplitude, _ = shifted(text, 1.5, seed=seed)
    for frame in (5, 8):
        distance[frame], amplitude[frame] = distance[frame, ::-1], amplitude[frame, ::-1]
    distance[11] = np.random.default_rng(0).uniform(1, 3, distance[11].shape)
    assert sorted(register(distance, amplitude, ambiguity_range=RANGE).rejected) == [5, 8, 11]


@pytest.mark.parametrize("light", [cells(16), lines(8)], ids=["checks", "lines"])
def test_what_repeats_is_placed_within_half_a_period_and_said(light):
    distance, amplitude, shifts = shifted(light, 2.4)
    found = register(distance, amplitude, ambiguity_range=RANGE)
    assert found.period is not None
    assert 8 <= found.period <= 16
    assert not found.rejected
    assert np.abs(found.shifts - shifts).max() < 0.3
    with pytest.warns(FusionWarning, match="repeats after"):
        fuse(distance, amplitude, ambiguity_range=RANGE, options=FusionOptions(method="nearest"))
    assert register(distance, amplitude, initial=shifts, ambiguity_range=RANGE).period == found.period


def test_stripes_repeat_across_and_not_along_them():
    def light(row, column):
        return np.where(np.floor(2 * column / 16) % 2 > 0, 1000, 3000) + 0 * row

    distance, amplitude, shifts = shifted(light, 3.0)
    found = register(distance, amplitude, ambiguity_range=RANGE)
    assert found.period == 16
    assert np.abs(found.shifts - shifts)[:, 1].max() < 0.2


def test_a_scene_with_one_thing_in_it_does_not_repeat():
    def light(row, column):
        thing = np.hypot(row - 30, column - 20) < 6
        return np.where(thing, 2000, cells(16)(row, column))

    distance, amplitude, shifts = shifted(light, 3.5)
    found = register(distance, amplitude, ambiguity_range=RANGE)
    assert found.period is None
    assert np.abs(found.shifts - shifts)[[k for k in range(15) if k not in found.rejected]].max() < 0.3


@pytest.mark.filterwarnings("error")
def test_a_guess_that_looks_behind_the_camera_is_only_a_guess():
    burst = capture(look(scene("print", wall(2.0, texture=printed(0.3))), (4,)), BASE, seed=0)
    wrong = burst.rotations.copy()
    wrong[3] += (0.0, 3.0, 0.0)
    found = register(
        burst.distance,
        burst.amplitude,
        intrinsics=burst.given["intrinsics"],
        initial=wrong,
        ambiguity_range=RANGE,
    )
    assert FOCAL * np.abs(found.rotations - burst.rotations)[[0, 1, 2, *range(4, 15)], :2].max() < 0.05


def test_a_stream_of_what_resembles_itself_is_placed_as_a_burst_is():
    made = scene("stairs", stairs(2.0, 0.06, 5, printed(0.2, 9, 0.012), lying=True))
    steps = capture(look(made, (4,)), replace(BASE, poses="none"), seed=0)
    options, matrix = FusionOptions(method="shift-and-add", upsampling=1), steps.given["intrinsics"]
    sliding = SlidingFusion(options, window=10, ambiguity_range=RANGE, intrinsics=matrix)
    for number, (frame, light) in enumerate(zip(steps.distance, steps.amplitude, strict=True)):
        found = sliding.push(frame, light).rotations
        true = steps.rotations[max(0, number - 9) : number + 1]
        if number >= 6:
            assert FOCAL * np.abs(found - found[0] - true + true[0])[:, :2].max() < 0.1


def test_a_stream_that_pans_goes_on_beyond_what_its_first_frame_shows():
    ink = np.random.default_rng(3).random((120, 120)) < 0.5

    def patches(row, column):
        return np.where(ink[(row / 3 + 20).astype(int), (column / 3 + 20).astype(int)], 600, 3000)

    distance, amplitude, shifts = shifted(patches, 1.5)
    shifts = shifts + np.outer(np.arange(15), (0, 2))
    sliding = SlidingFusion(FusionOptions(method="shift-and-add"), window=12, ambiguity_range=RANGE)
    for number, (frame, light) in enumerate(zip(distance, amplitude, strict=True)):
        view = np.s_[:, 2 * number : 2 * number + 36]
        found = sliding.push(frame[view], light[view]).shifts
        true = shifts[max(0, number - 11) : number + 1]
        assert np.abs(found - found[0] - true + true[0]).max() < 0.3


def test_a_stream_says_that_what_it_shows_repeats_unless_it_is_guided():
    distance, amplitude, shifts = shifted(cells(16), 2.4)
    for guided in (False, True):
        sliding = SlidingFusion(FusionOptions(method="shift-and-add"), window=8, ambiguity_range=RANGE)
        for frame, light, shift in zip(distance, amplitude, shifts, strict=True):
            fused = sliding.push(frame, light, initial=shift if guided else None)
            assert (
                np.abs(fused.shifts - fused.shifts[-1] - shifts[list(fused.report.used)] + shift).max() < 0.3
            )
            if fused.report.used != (0,):
                assert ["repeats after 11 pixels" in note for note in fused.report.notes] == [True] * (
                    not guided
                )
