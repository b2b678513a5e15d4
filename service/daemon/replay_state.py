"""Where a replay is, as it is told."""

from service.capture.player import Player
from service.messages.replay import MOST_GAPS, ReplayGap, ReplayState


def replay_state(player: Player, file: str, mode: str, now: int, error: str | None = None) -> ReplayState:
    """What is told of a player.

    Args:
        player: of the recording.
        file, mode: what is played, and as what.
        now: ns since the epoch.
        error: why it stands still.
    """
    at, line, entries = player.at, player.reel.line, player.reel.recording.entries
    return ReplayState(
        timestamp=now,
        file=file,
        mode=mode,
        playing=player.playing,
        ended=player.ended,
        speed=player.speed,
        loop=player.loop,
        round=player.rounds,
        seconds=player.seconds,
        duration=line.duration / 1e9,
        frame=at,
        frames=len(entries),
        burst=player.burst,
        bursts=len(player.bursts),
        recorded=entries[at].timestamp if at < len(entries) else None,
        gaps=tuple(ReplayGap(frame=gap.frame, seconds=gap.seconds) for gap in line.gaps[:MOST_GAPS]),
        gap_count=len(line.gaps),
        error=error,
    )
