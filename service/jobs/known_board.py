"""A printed board in view: its place is known from its corners, so it tells the true distance."""

import cv2
import numpy as np

from service.calibration.board import Board, find_board
from service.errors import ServiceError
from service.evaluation.planes import Plane
from service.evaluation.regions import Region
from service.evaluation.sight import Take


def board_region(take: Take, board: Board) -> tuple[Region, Plane]:
    """What lies within the board's outermost corners, and the plane that it lies in.

    The pose follows from the corners seen in the amplitude of the reference frame (perspective-n-point;
    OpenCV's iterative solution from IPPE: Collins and Bartoli, IJCV 109, 2014), so it is as good as the
    intrinsics are.

    Raises:
        ServiceError: no frame, or the board is not in it.
    """
    if take.amplitude is None or not take.before:
        raise ServiceError("a board is looked for in the amplitude of a frame, and no frame is there")
    sight = take.before[0]
    found = find_board(take.amplitude, board)
    if found is None:
        raise ServiceError(
            f"no board of {board.columns} x {board.rows} inner corners is seen in the first frame: bring it "
            "into view, or give its corners as they are (--board)"
        )
    lens = np.array(sight.distortion or (0.0,) * 5)
    _, turn, place = cv2.solvePnP(found.points, found.pixels, sight.intrinsics, lens, flags=cv2.SOLVEPNP_IPPE)
    turn, place = cv2.solvePnPRefineLM(found.points, found.pixels, sight.intrinsics, lens, turn, place)
    normal = np.asarray(cv2.Rodrigues(turn)[0][:, 2], dtype=np.float64)
    offset = float(normal @ place.ravel())
    plane = Plane(normal, offset) if offset >= 0 else Plane(-normal, -offset)
    mask = np.zeros(sight.distance.shape, np.uint8)
    cv2.fillConvexPoly(mask, np.round(found.outline).astype(np.int32), 1)
    return Region("board", mask.astype(bool)), plane
