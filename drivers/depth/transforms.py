"""Transforms between frames of reference as they are told over time (tf)."""

from bisect import bisect_right
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from drivers.depth.messages import Link


@dataclass(slots=True)
class _Edge:
    """A frame's place in its parent over time."""

    parent: str
    links: list[Link] = field(default_factory=list)
    is_sorted: bool = True


class TransformTree:
    """Every frame has one parent; between two messages a transform is interpolated."""

    def __init__(self) -> None:
        self._edges: dict[str, _Edge] = {}

    def __contains__(self, frame: str) -> bool:
        return frame.lstrip("/") in self._edges

    def add(self, link: Link) -> None:
        """Take a transform; a frame with another parent hangs on that from now on; none without a turn."""
        turn = np.linalg.norm(link.rotation)
        if not (np.isfinite(turn) and turn > 0.5 and np.isfinite(link.translation).all()):
            return
        edge = self._edges.get(link.child)
        if edge is None or edge.parent != link.parent:
            edge = self._edges[link.child] = _Edge(link.parent)
        edge.is_sorted = edge.is_sorted and (not edge.links or edge.links[-1].stamp <= link.stamp)
        edge.links.append(link)

    def pose(self, frame: str, stamp: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(3, 3) rotation and (3,) translation, metres, that take a frame's axes to the root's."""
        rotation, place = np.eye(3), np.zeros(3)
        name, seen = frame.lstrip("/"), set()
        while name in self._edges and name not in seen:
            seen.add(name)
            edge = self._edges[name]
            turn, shift = _at(edge, stamp)
            rotation, place = turn @ rotation, turn @ place + shift
            name = edge.parent
        return rotation, place


def _at(edge: _Edge, stamp: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    from scipy.spatial.transform import Rotation, Slerp

    if not edge.is_sorted:
        edge.links.sort(key=lambda link: link.stamp)
        edge.is_sorted = True
    after = bisect_right(edge.links, stamp, key=lambda link: link.stamp)
    earlier = edge.links[max(0, after - 1)]
    later = edge.links[min(after, len(edge.links) - 1)]
    turns = Rotation.from_quat([earlier.rotation, later.rotation])
    start, end = np.array(earlier.translation), np.array(later.translation)
    if later.stamp <= earlier.stamp:
        return turns[0].as_matrix(), start
    share = min(1.0, max(0.0, (stamp - earlier.stamp) / (later.stamp - earlier.stamp)))
    return Slerp([0.0, 1.0], turns)(share).as_matrix(), start + share * (end - start)
