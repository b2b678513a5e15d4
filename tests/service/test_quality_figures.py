"""Figures of quality of walls whose errors are known."""

import numpy as np
import pytest
from made_walls import FOCAL, SHAPE, TILTED, across, blank, noisy, seen, stepped, take, wall

from service.errors import ConfigurationError, UnmeasurableError
from service.evaluation import figures
from service.evaluation.edges import edge_profile
from service.evaluation.planes import Plane, find_planes, fit_plane
from service.evaluation.quality import measure
from service.evaluation.regions import regions_of
from service.evaluation.requirements import parse_requirement

WHOLE = np.ones(SHAPE, bool)


def near(value, within=0.05):
    return pytest.approx(value, rel=within)


def test_a_plane_is_found_through_its_points():
    rays = blank().rays.reshape(-1, 3)
    true = Plane(TILTED / np.linalg.norm(TILTED), 1.7)
    found = fit_plane(rays * true.distances(rays)[:, None])
    np.testing.assert_allclose(found.normal, true.normal, atol=1e-9)
    assert found.offset == pytest.approx(1.7)


def test_flatness_is_the_noise_across_a_wall_that_is_flat():
    sights = [noisy(2.0, 0.010, seed, normal=TILTED) for seed in range(3)]
    cosine = blank().rays @ (TILTED / np.linalg.norm(TILTED))
    assert figures.flatness(sights, WHOLE) == near(0.010 * np.sqrt(np.mean(cosine**2)), 0.03)


def test_flatness_holds_what_the_camera_bends():
    rows = np.indices(SHAPE)[0]
    bent = wall(2.0) + 0.004 * np.sin(2 * np.pi * rows / 24)
    assert figures.flatness([seen(bent)], WHOLE) == near(0.004 / np.sqrt(2))


def test_noise_in_time_leaves_out_what_stays():
    bend = 0.05 * np.sin(np.indices(SHAPE)[1] / 5)
    random = np.random.default_rng(1)
    sights = [seen(wall(2.0) + bend + random.normal(0, 0.007, SHAPE)) for _ in range(4)]
    assert figures.noise(sights, WHOLE) == near(0.007, 0.03)


def test_repeatability_is_how_the_mean_varies():
    offsets = np.array([0.0, 0.003, -0.002, 0.004])
    sights = [noisy(2.0, 0.001, number) for number in range(4)]
    moved = [seen(sight.distance + offset) for sight, offset in zip(sights, offsets, strict=True)]
    assert figures.repeatability(moved, WHOLE) == near(offsets.std(ddof=1), 0.02)


def test_bias_has_a_sign():
    sights = [noisy(2.012, 0.010, seed) for seed in range(2)]
    assert figures.bias_of_plane(sights, WHOLE, 2.0) == near(0.012)
    lying = Plane(TILTED / np.linalg.norm(TILTED), 1.5)
    short = [seen(wall(1.5, normal=TILTED) - 0.008)]
    assert figures.bias_of_surface(short, WHOLE, lying) == near(-0.008)


def test_fill_is_the_share_that_is_known():
    distance = wall(2.0)
    distance[:18] = np.nan
    assert figures.fill([seen(distance)], WHOLE) == 0.75


@pytest.mark.parametrize("factor", [1, 4])
def test_step_and_edge_of_two_walls(factor):
    sight = stepped(2.0, 2.3, 2.0 * factor, 0.008, factor)
    left, right = across(factor) < -3 * factor, across(factor) > 3 * factor
    assert figures.step([sight], left, right) == near(0.3, 0.01)
    profile = edge_profile(sight, left, right, factor)
    # A ramp of 2 pixels of a frame, of which 80 % lie between 10 and 90 %, seen at 2 m.
    assert profile.width == near(0.8 * 2.0 / FOCAL * 2.0)


@pytest.mark.parametrize("lean", [0.0, -0.4, 2.5])
def test_an_edge_may_lean(lean):
    sight = stepped(2.0, 2.5, 4.0, 0.004, lean=lean)
    left, right = across(lean=lean) < -4, across(lean=lean) > 4
    within = 0.05 if lean else 0.1  # along a column there is nothing between the pixels
    assert edge_profile(sight, left, right, 1).width == near(0.8 * 4.0 / FOCAL * 2.0, within)


def test_what_is_no_edge_is_refused():
    left, right = across() < -3, across() > 3
    with pytest.raises(UnmeasurableError, match="lost in the noise"):
        edge_profile(stepped(2.0, 2.01, 1.0, 0.02), left, right, 1)
    with pytest.raises(UnmeasurableError, match="pixels apart"):
        edge_profile(stepped(2.0, 2.5, 1.0), across() < -20, across() > 20, 1)
    slanted = np.where(across() < 0, wall(2.0), wall(1.4, normal=(-1.0, 0, 1.0)))
    with pytest.raises(UnmeasurableError, match="not parallel"):
        figures.step([seen(slanted)], left, right)


def test_planes_are_found_and_balls_are_not():
    masks = list(find_planes(stepped(2.0, 2.5, 1.0, 0.004).points()))
    assert len(masks) == 2
    assert np.mean(across()[masks[0] | masks[1]] < 0) == pytest.approx(0.5, abs=0.05)
    assert all(mask.mean() > 0.4 for mask in masks)
    assert not (masks[0] & masks[1]).any()
    rays, centre = blank().rays, np.array([0, 0, 2.5])
    along = rays @ centre
    inside = along**2 - (centre @ centre - 0.6**2)
    ball = np.where(inside > 0, along - np.sqrt(np.maximum(inside, 0)), np.nan)
    assert list(find_planes(seen(ball).points())) == []


def test_holes_in_a_plane_count_as_missing():
    distance = noisy(2.0, 0.004, 0).distance.copy()
    distance[30:38, 40:48] = np.nan
    (mask,) = find_planes(seen(distance).points())
    assert mask[30:38, 40:48].all()
    assert figures.fill([seen(distance)], mask) == pytest.approx(1 - 64 / mask.sum())


def judged(takes, texts, known=None):
    regions = regions_of(texts, takes[0])
    return measure(takes, regions, found=texts == ["planes"], known=known, source="x", method="m", frames=2)


def test_everything_before_and_after():
    takes = [take([noisy(2.0, 0.012, n)], noisy(2.0, 0.002, 10 + n, factor=2)) for n in range(3)]
    found = judged(takes, ["planes"], known=1.99)
    assert (found.upsampling, found.bursts) == (2, 3)
    assert (found.flatness.before, found.flatness.after) == (near(0.012), near(0.002))
    assert (found.noise.before, found.noise.after) == (near(0.012), near(0.002))
    assert (found.fill.before, found.fill.after) == (1, 1)
    assert (found.bias.before, found.bias.after) == (near(0.010), near(0.010))
    assert found.step.after is None
    assert "no two regions" in found.step.why


def test_of_given_regions_the_worst_counts():
    rough = noisy(2.0, 0.002, 0).distance.copy()
    rough[:, 44:] = noisy(2.0, 0.006, 1).distance[:, 44:]
    found = judged([take([seen(rough)], seen(rough))], ["0,0,72,40", "0,48,72,40"])
    assert found.flatness.after == near(0.006)
    assert [part.flatness.after for part in found.regions] == [near(0.002), near(0.006)]


def test_one_burst_has_no_noise_in_time_and_nothing_flat_no_flatness():
    found = judged([take([noisy(2.0, 0.01, 0)], noisy(2.0, 0.01, 1))], ["whole"])
    assert (found.noise.after, found.repeatability.after) == (None, None)
    assert "at least two bursts" in found.noise.why
    rough = seen(np.random.default_rng(0).uniform(1, 4, SHAPE))
    found = judged([take([rough], rough)], ["planes"])
    assert (found.flatness.after, found.fill.after) == (None, 1)
    assert "nothing flat" in found.flatness.why


def test_a_region_without_data_has_fill_alone():
    empty = wall(2.0)
    empty[:20, :20] = np.nan
    found = judged([take([seen(empty)], seen(empty))], ["0,0,20,20"])
    assert (found.fill.after, found.flatness.after) == (0, None)
    assert "0 pixels" in found.flatness.why


def test_a_map_without_frames_has_no_before():
    found = judged([take([], noisy(2.0, 0.01, 0))], ["whole"])
    assert (found.flatness.before, found.flatness.after) == (None, near(0.01))
    assert found.flatness.why == "the frames are not there"


@pytest.mark.parametrize(
    ("text", "name", "value", "met"),
    [
        ("flatness<3mm", "flatness", 0.0029, True),
        ("flatness<3mm", "flatness", 0.003, False),
        ("noise <= 0.003 m", "noise", 0.003, True),
        ("fill>95%", "fill", 0.96, True),
        ("fill>=95%", "fill", 0.94, False),
        ("bias<5mm", "bias", -0.006, False),
        ("step>0.01m", "step", 0.02, True),
    ],
)
def test_requirements(text, name, value, met):
    rule = parse_requirement(text)
    assert (rule.name, rule.is_met(value)) == (name, met)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "flatness",
        "flatness=3mm",
        "flat<3mm",
        "flatness<3%",
        "fill>2mm",
        "noise<-1mm",
        "noise<3cm",
        "flatness<3",
        "fill>95",
    ],
)
def test_bad_requirements(text):
    with pytest.raises(ConfigurationError, match="--require"):
        parse_requirement(text)


@pytest.mark.parametrize("text", ["", "1,2,3", "a,b,c,d", "0,0,73,10", "-1,0,5,5", "0,0,0,5", "plane"])
def test_bad_regions(text):
    with pytest.raises(ConfigurationError, match="--region"):
        regions_of([text], take([], noisy(2.0, 0.01, 0)))
