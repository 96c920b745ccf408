"""A camera that stands still for five seconds amid a drive stays there, and the scale goes on."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from farpoint import Camera, Frame, Odometry, OdometryOptions, OdometryResult, PoseStatus
from farpoint.synthetic import ImagingOptions, RenderedSequence, street_drive
from farpoint.tracks import TrackerOptions

CAMERA = Camera.pinhole(320, 240, 220.0, 220.0, 159.5, 119.5)
BEFORE, AFTER, STILL = 10, 8, 50  # motions, and pictures of the same place: 5 s
FPS = 10.0


@pytest.fixture(scope="module")
def drive() -> RenderedSequence:
    path = street_drive(BEFORE + AFTER + 1, FPS, seed=6)
    return RenderedSequence(CAMERA, path, seed=6, imaging=ImagingOptions(noise_grey=0.0))


@pytest.fixture(scope="module")
def results(drive: RenderedSequence) -> list[OdometryResult]:
    """Every picture has noise of its own, those of the standing camera too."""
    places = [*range(BEFORE), *(STILL + 1) * [BEFORE], *range(BEFORE + 1, len(drive))]
    seen = {place: drive.view(place).frame.image for place in set(places)}

    def frames() -> Iterator[Frame]:
        rng = np.random.default_rng(8)
        for index, place in enumerate(places):
            assert seen[place] is not None
            noisy = seen[place] + rng.normal(0.0, 1.0, seen[place].shape)
            image = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
            yield Frame(index=index, timestamp=index / FPS, image=image, name=str(index))

    options = OdometryOptions(tracker=TrackerOptions(max_tracks=300))
    return list(Odometry(CAMERA, options).run(frames()))


def test_nothing_wanders(results: list[OdometryResult]):
    stood = results[BEFORE : BEFORE + STILL + 1]
    statuses = [result.pose.status for result in stood[1:] if result.pose is not None]
    assert statuses.count(PoseStatus.STATIC) >= STILL - 2
    places = np.array([result.world_from_cam[:3, 3] for result in stood])
    assert np.linalg.norm(places - places[0], axis=1).max() < 0.01  # of the first step
    assert {result.segment for result in results} == {0}
    assert not any(result.scale_is_guessed for result in results)


def test_the_scale_goes_on(drive: RenderedSequence, results: list[OdometryResult]):
    steps = np.linalg.norm(np.diff(drive.world_from_cam[:, :3, 3], axis=0), axis=1)
    moved = [result for result in results[1:] if result.scale is not None]
    after = [result for result in moved if result.frame0 >= BEFORE + STILL]
    assert len(after) == AFTER
    for result in after:
        assert result.scale is not None
        assert result.scale_sigma is not None
        true = steps[result.frame0 - STILL] / steps[0]
        assert result.scale == pytest.approx(true, rel=0.02)
        assert abs(np.log(true / result.scale)) < 4.0 * result.scale_sigma / result.scale
