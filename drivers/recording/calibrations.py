"""Which calibration belongs to which frames of a recording."""

from collections.abc import Callable, Sequence

from drivers.calibration import Calibration
from drivers.errors import RecordingError
from drivers.lens_message import calibration_of
from drivers.messages import CAMERA_CALIBRATION, decode_calibration
from drivers.recording import attachments
from drivers.recording.contents import SaidCalibration
from drivers.recording.records import AttachmentEntry


class Calibrations:
    """The calibrations of a recording: attached whole, and said in messages as intrinsics and distortion.

    A message holds from its time on. Where an attached calibration says the same as the message in force, it
    is taken, for it says more; where no message is, the attached one in force is.

    Args:
        origin: the file, for errors.
        attached: entries of attached calibrations.
        said: messages.
        load: gives the content of an entry.
    """

    def __init__(
        self,
        origin: str,
        attached: Sequence[AttachmentEntry],
        said: Sequence[SaidCalibration],
        load: Callable[[AttachmentEntry], bytes],
    ) -> None:
        self._origin, self._load = origin, load
        self._attached, self._said = list(attached), list(said)
        self._known: list[tuple[int, Calibration]] | RecordingError | None = None

    def at(self, timestamp: int) -> Calibration:
        """The calibration of a frame taken then (ns since the epoch); for the same one the same object.

        Raises:
            RecordingError: there is none, one that cannot be used, or several of which it is not said which.
        """
        if self._known is None:
            try:
                self._known = self._resolved()
            except RecordingError as error:
                self._known = error
        if isinstance(self._known, RecordingError):
            raise self._known
        if not self._known:
            why = " (it says that the camera is not calibrated: K is zero)" if self._said else ""
            raise RecordingError(
                f"{self._origin}: holds no calibration{why}; expected the attachment "
                f"{attachments.CALIBRATION} or a message on {CAMERA_CALIBRATION}: name a calibration file in "
                "the configuration"
            )
        return _in_force(self._known, timestamp)

    def _resolved(self) -> list[tuple[int, Calibration]]:
        """Since when (ns) which calibration holds, in order of time."""
        whole = self._whole()
        lenses = self._lenses()
        if not lenses:
            self._require_order(whole)
            return whole
        found: list[tuple[int, Calibration]] = []
        for timestamp, lens in lenses:
            same = [(time, known) for time, known in whole if _is_same_lens(known, lens)]
            self._require_order(same)
            known = _in_force(same, timestamp) if same else lens
            if not found or found[-1][1] != known:
                found.append((timestamp, known))
        self._require_order(found)
        return found

    def _whole(self) -> list[tuple[int, Calibration]]:
        """Attached calibrations, equal ones once."""
        found: list[tuple[int, Calibration]] = []
        for entry in self._attached:
            name = f"{self._origin}: {attachments.CALIBRATION}"
            known = Calibration.from_toml(self._load(entry), name)
            if all(known != other for _, other in found):
                found.append((entry.log_time, known))
        return sorted(found, key=lambda pair: pair[0])

    def _lenses(self) -> list[tuple[int, Calibration]]:
        found: list[tuple[int, Calibration]] = []
        for timestamp, payload in sorted(self._said):
            lens = calibration_of(decode_calibration(payload), f"{self._origin}: {CAMERA_CALIBRATION}")
            if lens is not None:
                found.append((timestamp, lens))
        return found

    def _require_order(self, known: Sequence[tuple[int, Calibration]]) -> None:
        if len({time for time, _ in known}) < len(known):
            raise RecordingError(
                f"{self._origin}: holds {len(known)} different calibrations of one time, and nothing says "
                "which frames are whose: name the right one in the configuration (camera.calibration)"
            )


def _is_same_lens(known: Calibration, lens: Calibration) -> bool:
    """Whether a whole calibration says what a message says; trailing zeros of the distortion say nothing."""
    return (known.shape, known.intrinsics, _significant(known)) == (
        lens.shape,
        lens.intrinsics,
        _significant(lens),
    )


def _significant(known: Calibration) -> tuple[float, ...]:
    terms = list(known.distortion)
    while terms and terms[-1] == 0:
        terms.pop()
    return tuple(terms)


def _in_force(known: Sequence[tuple[int, Calibration]], timestamp: int) -> Calibration:
    """The latest that was known by then, else the first."""
    return next((held for time, held in reversed(known) if time <= timestamp), known[0][1])
