"""A live session with simulated faults of the camera, whose counts are compared with the faults."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path

from farpoint.bench.processes import resident_mb
from farpoint.camera import Camera
from farpoint.errors import optional_import
from farpoint.frames import Frame
from farpoint.frames.live import Black, Disconnect, Fault, Playback, Stall
from farpoint.live import LiveSession, LiveState
from farpoint.pose import PoseStatus
from farpoint.sinks import OutputOptions, ViewerOptions
from farpoint.sinks.motions import read_motions
from farpoint.sinks.run_record import read_run
from farpoint.synthetic.sequence import render_drive
from farpoint.trajectory.files import read_tum

__all__ = ["Claim", "LiveMoment", "LiveTrial", "try_live"]

_CAMERA = Camera.pinhole(320, 180, 245.0, 245.0, 159.5, 89.5)
_FPS = 30.0
_PICTURES = 60
_PERIOD_S = 60.0  # each fault occurs once in this time
_MOMENTS = 10
_RECORDING = "session.rrd"


@dataclass(frozen=True)
class Claim:
    """A count that must equal the true count.

    Attributes
    ----------
    what : str
    expected, found : int
        Expected number, known from the source or from the counts of the session, and number found
        in the counts of the session or in the files.
    """

    what: str
    expected: int
    found: int


@dataclass(frozen=True, kw_only=True)
class LiveMoment:
    """State of a session at a time.

    Attributes
    ----------
    elapsed_s : float
    memory_mb : float
        Memory of this process and of the drawing processes, MB.
    state : LiveState
    """

    elapsed_s: float
    memory_mb: float
    state: LiveState


@dataclass(frozen=True, kw_only=True)
class LiveTrial:
    """Result of a live session.

    Attributes
    ----------
    claims : tuple of Claim
    moments : tuple of LiveMoment
        States at 10 times, which are equally spaced.
    state : LiveState
        State after everything was closed.
    black, failed : int
        Number of black frames, and number of FAILED pairs.
    """

    claims: tuple[Claim, ...]
    moments: tuple[LiveMoment, ...]
    state: LiveState
    black: int
    failed: int


def try_live(
    duration_s: float, out: Path, *, seed: int = 0, output: OutputOptions | None = None
) -> LiveTrial:
    """Run a live session on a looped drive at 30 frames per second, with simulated faults.

    The faults are stalls, black frames and disconnections.

    Parameters
    ----------
    duration_s : float
        Duration of the session, s. The session is divided into ``max(1, round(duration_s / 60))``
        equal periods. Each fault occurs once in each period, and lasts 5 % of the period.
    out : Path
        Folder for the outputs. A recording of the display is written beside this folder.
    seed : int
        Seed of the drive.
    output : OutputOptions, optional
        Options of the outputs; by default those of ``farpoint live``, without overlay.
    """
    periods = max(1, round(duration_s / _PERIOD_S))
    playback = Playback(
        frames=_there_and_back(seed), endless=True, loop=True, faults=_faults(duration_s, periods)
    )
    session = LiveSession(
        playback,
        "rehearsal",
        _CAMERA,
        out,
        output=output or OutputOptions(overlay=False),
        viewer=ViewerOptions(rrd=out.with_name(out.name + "-" + _RECORDING)),
    )
    moments: list[LiveMoment] = []
    with session:
        for number in range(_MOMENTS):
            session.run(duration_s / _MOMENTS)
            moments.append(
                LiveMoment(
                    elapsed_s=(number + 1) * duration_s / _MOMENTS,
                    memory_mb=resident_mb(),
                    state=session.state,
                )
            )
    recording = out.with_name(out.name + "-" + _RECORDING)
    return LiveTrial(
        claims=_claims(session, playback, periods, recording),
        moments=tuple(moments),
        state=session.state,
        black=playback.black,
        failed=session.counts[PoseStatus.FAILED],
    )


def _there_and_back(seed: int) -> list[Frame]:
    """A drive forward and back, which can be repeated without a jump."""
    drive = list(render_drive(_CAMERA, frames=_PICTURES, seed=seed))
    return [
        Frame(index=k, timestamp=k / _FPS, image=frame.image, name=frame.name)
        for k, frame in enumerate([*drive, *drive[-2:0:-1]])
    ]


def _faults(duration_s: float, periods: int) -> tuple[Fault, ...]:
    period_s = duration_s / periods
    kinds = ((Black, 0.2), (Stall, 0.45), (Disconnect, 0.7))
    return tuple(
        kind(at_s=(number + share) * period_s, for_s=0.05 * period_s)
        for number in range(periods)
        for kind, share in kinds
    )


def _claims(
    session: LiveSession, playback: Playback, periods: int, recording: Path
) -> tuple[Claim, ...]:
    state, account = session.state, session.state.account
    run = read_run(session.path / "run.json")
    written = run["live"]
    poses = len(read_tum(session.path / "trajectory.tum"))
    report = (session.path / "report.html").read_text(encoding="utf-8").rstrip()
    drawn = account.taken - state.not_drawn
    return (
        Claim("frames delivered", playback.delivered, account.captured),
        Claim("frames used, dropped or broken", account.captured, _accounted(written)),
        Claim("disconnections", periods, account.disconnects),
        Claim("reconnections", periods, account.reconnects),
        Claim("pairs counted", account.taken - 1, session.counts.total()),
        Claim("rows of motions.csv", account.taken - 1, len(read_motions(_motions(session)))),
        Claim("poses of trajectory.tum", account.taken, poses),
        Claim("pictures in the recording", drawn, _recorded_pictures(recording)),
        Claim("run.json has the state done", 1, int(run["state"] == "done")),
        Claim("report.html is whole", 1, int(report.endswith("</html>"))),
    )


def _motions(session: LiveSession) -> Path:
    return session.path / "motions.csv"


def _accounted(written: dict[str, int]) -> int:
    return sum(written[name] for name in ("taken", "dropped", "broken", "waiting"))


def _recorded_pictures(recording: Path) -> int:
    chunk = optional_import("rerun.chunk", extra="rerun", purpose="reading the recording")
    with warnings.catch_warnings():  # the recording has no footer, see `open_recording`
        warnings.simplefilter("ignore")
        parts = chunk.RrdReader(recording).stream()
    return sum(part.num_rows for part in parts if part.entity_path == "/image")
