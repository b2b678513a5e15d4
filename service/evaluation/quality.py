"""How well a rig measures: figures of regions before and after fusion."""

from collections.abc import Callable, Sequence

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from service.errors import UnmeasurableError
from service.evaluation import figures
from service.evaluation.edges import EdgeProfile, edge_profile
from service.evaluation.planes import Plane
from service.evaluation.regions import Region
from service.evaluation.sight import Sight, Take


class _Part(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)


class Figure(_Part):
    """One figure; null = it cannot be measured, and `why` says why."""

    before: float | None = Field(None, description="Of one frame.")
    after: float | None = Field(None, description="Of the fused map.")
    why: str | None = Field(None, description="Why a value is null.")


class RegionQuality(_Part):
    """The figures of one region."""

    name: str
    share: float = Field(ge=0, le=1, description="Of the view.")
    away: float | None = Field(description="Perpendicular distance of its plane from the camera, metres.")
    flatness: Figure = Field(description="RMS deviation from the best plane, metres.")
    fill: Figure = Field(description="Share of the pixels that have a distance.")
    noise: Figure = Field(description="Standard deviation of a pixel in time, metres.")
    repeatability: Figure = Field(description="Standard deviation of the mean from burst to burst, metres.")
    bias: Figure = Field(description="Measured minus true distance, metres.")


class Quality(_Part):
    """Figures of a recording or a rig; those at the top are what requirements judge."""

    source: str = Field(description="What was judged.")
    method: str | None = Field(description="How the maps were fused; null = not said.")
    bursts: int = Field(ge=1)
    frames: int = Field(ge=0, description="Of all bursts.")
    upsampling: int = Field(ge=1, description="β.")
    flatness: Figure
    fill: Figure
    noise: Figure
    repeatability: Figure
    bias: Figure
    step: Figure = Field(description="Height of the step between the first two regions, metres.")
    edge: Figure = Field(description="Width of the edge between them, 10 to 90 %, metres.")
    regions: tuple[RegionQuality, ...]
    notes: tuple[str, ...] = Field((), description="What else is to be said.")
    failures: tuple[str, ...] = Field((), description="Bursts that could not be fused, and why.")


Known = float | Plane | None
"""What a bias is measured against: a perpendicular distance, metres, or a plane whose place is known."""


def measure(
    takes: Sequence[Take],
    regions: Sequence[Region],
    *,
    found: bool,
    known: Known = None,
    source: str,
    method: str | None,
    frames: int,
    notes: tuple[str, ...] = (),
    failures: tuple[str, ...] = (),
) -> Quality:
    """All figures.

    Args:
        takes: bursts of one view, at least one.
        regions: what is judged; none = nothing flat was found.
        found: whether the regions are planes that were found: then the first is judged, and the step is that
            beside it; else the worst of all, and the step between the first two.
        known: of the first region.
        source, method, frames, notes, failures: as `Quality` has them.
    """
    parts = [
        _of_region(takes, region, known if number == 0 else None) for number, region in enumerate(regions)
    ]
    if not parts:
        whole = _of_region(takes, Region("whole", np.ones(takes[0].shape, bool)), None)
        none = Figure(why="nothing flat was found: name a region")
        parts = [whole.model_copy(update={"away": None, "flatness": none, "bias": none})]
    judged = parts[:1] if found else parts
    step, edge = _of_pair(takes, pair_of(takes[0], regions, found=found))
    return Quality(
        source=source,
        method=method,
        bursts=len(takes),
        frames=frames,
        upsampling=takes[0].upsampling,
        flatness=_worst([part.flatness for part in judged]),
        fill=_worst([part.fill for part in judged], worst=min),
        noise=_worst([part.noise for part in judged]),
        repeatability=_worst([part.repeatability for part in judged]),
        bias=parts[0].bias,
        step=step,
        edge=edge,
        regions=tuple(parts),
        notes=notes,
        failures=failures,
    )


def pair_of(take: Take, regions: Sequence[Region], *, found: bool) -> tuple[Region, Region] | None:
    """The two regions between which there is a step; of planes found, the largest pair side by side."""
    if not found:
        return (regions[0], regions[1]) if len(regions) > 1 else None
    for number, first in enumerate(regions):
        for second in regions[number + 1 :]:
            try:
                edge_profile(take.coarse, first.mask, second.mask, 1)
                figures.step([take.coarse], first.mask, second.mask)
            except UnmeasurableError:
                continue
            return first, second
    return None


def profile_of(take: Take, pair: tuple[Region, Region] | None, *, after: bool) -> EdgeProfile | None:
    """The edge between two regions in the first frame or the map; None where there is none."""
    factor = take.upsampling if after else 1
    if pair is None or not (after or take.before):
        return None
    try:
        sight = take.after if after else take.before[0]
        return edge_profile(sight, pair[0].at(factor), pair[1].at(factor), factor)
    except UnmeasurableError:
        return None


def _of_region(takes: Sequence[Take], region: Region, known: Known) -> RegionQuality:
    def both(
        measured: Callable[[Sequence[Sight], "figures.Mask"], float], *, repeated: bool = False
    ) -> Figure:
        first = [sight for take in takes for sight in (take.before if repeated else take.before[:1])]
        return _figure(
            lambda: measured(_there(first), region.mask),
            lambda: measured([take.after for take in takes], region.at(takes[0].upsampling)),
        )

    def bias(sights: Sequence[Sight], mask: "figures.Mask") -> float:
        if isinstance(known, Plane):
            return figures.bias_of_surface(sights, mask, known)
        if known is None:
            raise UnmeasurableError("no true distance is known: give --distance, or --board")
        return figures.bias_of_plane(sights, mask, known)

    try:
        away = figures.plane_in(takes[0].after, region.at(takes[0].upsampling)).offset
    except UnmeasurableError:
        away = None
    return RegionQuality(
        name=region.name,
        share=float(region.mask.mean()),
        away=away,
        flatness=both(figures.flatness),
        fill=both(figures.fill),
        noise=both(figures.noise, repeated=True),
        repeatability=both(figures.repeatability),
        bias=both(bias),
    )


def _of_pair(takes: Sequence[Take], pair: tuple[Region, Region] | None) -> tuple[Figure, Figure]:
    if pair is None:
        none = Figure(why="no two regions with a step between them: name two")
        return none, none
    factor = takes[0].upsampling
    masks = pair[0].mask, pair[1].mask
    fine = pair[0].at(factor), pair[1].at(factor)
    before, after = [sight for take in takes for sight in take.before[:1]], [take.after for take in takes]

    def width(sights: Sequence[Sight], pair: tuple["figures.Mask", "figures.Mask"], factor: int) -> float:
        return float(np.mean([edge_profile(sight, *pair, factor).width for sight in sights]))

    return (
        _figure(lambda: figures.step(_there(before), *masks), lambda: figures.step(after, *fine)),
        _figure(lambda: width(_there(before), masks, 1), lambda: width(after, fine, factor)),
    )


def _there(sights: Sequence[Sight]) -> Sequence[Sight]:
    if not sights:
        raise UnmeasurableError("the frames are not there")
    return sights


def _figure(before: Callable[[], float], after: Callable[[], float]) -> Figure:
    values: list[float | None] = []
    reasons: dict[str, None] = {}
    for measured in (before, after):
        try:
            values.append(measured())
        except UnmeasurableError as error:
            values.append(None)
            reasons[str(error)] = None
    return Figure(before=values[0], after=values[1], why="; ".join(reasons) or None)


def _worst(parts: Sequence[Figure], worst: Callable[[Sequence[float]], float] = max) -> Figure:
    """Of each value the worst over the regions; null where one is."""

    def of(values: list[float | None]) -> float | None:
        known = [value for value in values if value is not None]
        return worst(known) if len(known) == len(values) else None

    reasons = dict.fromkeys(part.why for part in parts if part.why)
    return Figure(
        before=of([part.before for part in parts]),
        after=of([part.after for part in parts]),
        why="; ".join(reasons) or None,
    )
