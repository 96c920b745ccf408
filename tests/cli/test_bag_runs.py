"""Runs over bags: the same results as over files, whatever the bag; metres out of its topics."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bags_kit import KINDS, Sent, header, image_message, info_message, write_bag
from cli_kit import HEIGHT, WIDTH, CommandLine, assert_refused, encoded, record_of
from rosbags.highlevel import AnyReader

from farpoint.sinks import read_motions
from farpoint.synthetic.sequence import RenderedSequence

QUICK = ("--no-overlay", "--no-report", "--halves-every", "0")
STEP_NS = 10**8
START_NS = 1_400_000_000 * 10**9  # image files of that age are named by nanoseconds
K = [180.0, 0.0, 119.5, 0.0, 180.0, 71.5, 0.0, 0.0, 1.0]


def stamps(count: int) -> list[int]:
    return [START_NS + STEP_NS * number for number in range(count)]


def sent_images(images: tuple[np.ndarray, ...]) -> list[Sent]:
    return [
        image_message(image, "mono8", stamp)
        for image, stamp in zip(images, stamps(len(images)), strict=True)
    ]


def test_a_folder_and_every_kind_of_bag_give_the_same_bytes(
    farpoint: CommandLine, tmp_path: Path, images: tuple[np.ndarray, ...], calibration: Path
):
    folder = tmp_path / "folder"
    folder.mkdir()
    for image, stamp in zip(images, stamps(len(images)), strict=True):
        (folder / f"{stamp}.png").write_bytes(encoded(image))
    sent = [info_message(size=(WIDTH, HEIGHT), k=K, d=[0.0] * 4), *sent_images(images)]
    sources = {kind: write_bag(tmp_path, kind, sent) for kind in KINDS}
    assert (
        farpoint("run", folder, "--camera", calibration, *QUICK, "--out", tmp_path / "0").code == 0
    )
    expected = {
        name: (tmp_path / "0" / name).read_bytes() for name in ("motions.csv", "trajectory.tum")
    }
    assert b"1400000000.1" in expected["motions.csv"]
    for kind, source in sources.items():
        for given in ((), ("--camera", calibration)):
            out = tmp_path / f"{kind}{len(given)}"
            outcome = farpoint("run", source, *given, *QUICK, "--out", out)
            assert outcome.code == 0, outcome.err
            for name, data in expected.items():
                assert (out / name).read_bytes() == data
    assert record_of(tmp_path / "mcap0")["camera"]["name"] == "/cam/camera_info"


def test_a_bag_without_camera_info_asks_for_a_calibration(
    farpoint: CommandLine, tmp_path: Path, images: tuple[np.ndarray, ...]
):
    bag = write_bag(tmp_path, "mcap", sent_images(images[:2]))
    assert_refused(farpoint("run", bag), "--camera", "/cam/image_raw has no CameraInfo")
    assert_refused(
        farpoint("run", bag, "--topic", "/other"), "no topic /other", "/cam/image_raw (2)"
    )


def test_faults_of_single_messages_are_counted(
    farpoint: CommandLine, tmp_path: Path, images: tuple[np.ndarray, ...], calibration: Path
):
    bag = write_bag(
        tmp_path,
        "ros1",
        sent_images(images),
        damage=lambda number, data: data[:100] if number == 3 else data,
    )
    out = tmp_path / "out"
    assert farpoint("run", bag, "--camera", calibration, *QUICK, "--out", out).code == 0
    record = record_of(out)
    assert record["frames"] == len(images)
    assert record["frames_without_image"] == 1


def wheels(drive: RenderedSequence, kind: str, variance: float) -> list[Sent]:
    """Speeds between the images, along the body's x axis."""
    poses = drive.world_from_cam
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    covariance = np.zeros(36)
    covariance[0] = covariance[7] = covariance[14] = variance
    sent = []
    for number, step in enumerate(steps):
        stamp = START_NS + STEP_NS // 2 + STEP_NS * number
        twist = {
            "linear": {"x": 10.0 * step, "y": 0.0, "z": 0.0},
            "angular": {"x": 0.0, "y": 0.0, "z": 0.0},
        }
        fields: dict[str, Any] = {"header": header(stamp), "twist": twist}
        if kind != "geometry_msgs/msg/TwistStamped":
            fields["twist"] = {"twist": twist, "covariance": covariance}
        if kind == "nav_msgs/msg/Odometry":
            place = {
                "position": dict.fromkeys("xyz", 0.0),
                "orientation": dict.fromkeys("xyzw", 0.0),
            }
            fields |= {
                "child_frame_id": "base_link",
                "pose": {"pose": place, "covariance": np.zeros(36)},
            }
        sent.append(Sent("/wheels", kind, stamp, fields))
    return sent


@pytest.mark.parametrize(
    "kind",
    [
        "nav_msgs/msg/Odometry",
        "geometry_msgs/msg/TwistStamped",
        "geometry_msgs/msg/TwistWithCovarianceStamped",
    ],
)
def test_speeds_of_the_bag_put_lengths_in_metres(
    farpoint: CommandLine,
    tmp_path: Path,
    images: tuple[np.ndarray, ...],
    drive: RenderedSequence,
    calibration: Path,
    kind: str,
):
    bag = write_bag(tmp_path, "mcap", [*sent_images(images), *wheels(drive, kind, 1e-4)])
    out = tmp_path / "out"
    options = ("--camera", calibration, *QUICK, "--out", out, "--metric.speed-topic", "/wheels")
    outcome = farpoint("run", bag, *options)
    assert outcome.code == 0, outcome.err
    truth = np.linalg.norm(np.diff(drive.world_from_cam[:, :3, 3], axis=0), axis=1)
    scale = read_motions(out / "motions.csv").scale
    np.testing.assert_allclose(np.nansum(scale), truth.sum(), rtol=0.03)
    assert record_of(out)["metric"]["unit"] == "m"


def test_the_covariances_of_speeds_count(
    farpoint: CommandLine,
    tmp_path: Path,
    images: tuple[np.ndarray, ...],
    drive: RenderedSequence,
    calibration: Path,
):
    sigmas = []
    speed = 10.0 * np.linalg.norm(np.diff(drive.world_from_cam[:2, :3, 3], axis=0))
    for share in (0.01, 0.5):  # 1-sigma of a speed; of ten in a second, a third of that
        kind, out = "geometry_msgs/msg/TwistWithCovarianceStamped", tmp_path / f"{share}"
        sent = [*sent_images(images), *wheels(drive, kind, (share * speed) ** 2)]
        bag = write_bag(tmp_path, "mcap", sent, name=out.name)
        options = ("--metric.speed-topic", "/wheels", "--metric.speed-sigma", "0.001")
        outcome = farpoint("run", bag, "--camera", calibration, *QUICK, "--out", out, *options)
        assert outcome.code == 0, outcome.err
        sigmas.append(record_of(out)["metric"]["relative_sigma"])
    assert sigmas[0] < 0.05
    assert 0.1 < sigmas[1] < 0.25


def fixes(drive: RenderedSequence, variance: float, *, known: int = 2) -> list[Sent]:
    """Positions about 48 N, 11 E: x to the east, z to the north."""
    latitude, radius = np.radians(48.0), 6378137.0
    # Radii of curvature of WGS 84 at 48 degrees.
    north_m = radius * (1 - 0.00669438) / (1 - 0.00669438 * np.sin(latitude) ** 2) ** 1.5
    east_m = radius / np.sqrt(1 - 0.00669438 * np.sin(latitude) ** 2) * np.cos(latitude)
    sent = []
    for number, (x, y, z) in enumerate(drive.world_from_cam[:, :3, 3]):
        fields = {
            "header": header(START_NS + STEP_NS * number),
            "status": {"status": 0 if number != 2 else -1, "service": 1},
            "latitude": 48.0 + np.degrees(z / north_m),
            "longitude": 11.0 + np.degrees(x / east_m),
            "altitude": -y if number != 2 else float("nan"),
            "position_covariance": np.diag([variance] * 3).ravel(),
            "position_covariance_type": known,
        }
        stamp = START_NS + STEP_NS * number
        sent.append(Sent("/gps/fix", "sensor_msgs/msg/NavSatFix", stamp, fields))
    return sent


def test_positions_of_the_bag_do_so_with_their_own_covariances(
    farpoint: CommandLine,
    tmp_path: Path,
    images: tuple[np.ndarray, ...],
    drive: RenderedSequence,
    calibration: Path,
):
    sigmas = []
    truth = np.linalg.norm(np.diff(drive.world_from_cam[:, :3, 3], axis=0), axis=1)
    for variance, known in ((1e-4, 2), (4e-4, 2), (1e-4, 0)):
        out = tmp_path / f"{variance}{known}"
        sent = [*sent_images(images), *fixes(drive, variance, known=known)]
        bag = write_bag(tmp_path, "ros1", sent, name=out.name)
        given = ("--metric.gnss-topic", "gps/fix", "--metric.gnss-sigma", "0.04")
        outcome = farpoint("run", bag, "--camera", calibration, *QUICK, "--out", out, *given)
        assert outcome.code == 0, outcome.err
        scale = read_motions(out / "motions.csv").scale
        np.testing.assert_allclose(np.nansum(scale), truth.sum(), rtol=0.03)
        sigmas.append(record_of(out)["metric"]["relative_sigma"])
    assert sigmas[0] < sigmas[1] < sigmas[2]


def test_topics_need_a_bag_that_has_them(
    farpoint: CommandLine, tmp_path: Path, images: tuple[np.ndarray, ...], calibration: Path
):
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "0.png").write_bytes(encoded(images[0]))
    speed = ("--camera", calibration, "--metric.speed-topic", "/wheels")
    assert_refused(farpoint("run", folder, *speed), "--metric.speed-topic: expected a bag")
    bag = write_bag(tmp_path, "mcap", sent_images(images[:2]))
    assert_refused(farpoint("run", bag, *speed), "--metric.speed-topic: no topic /wheels")
    fix = ("--camera", calibration, "--metric.gnss-topic", "/cam/image_raw")
    assert_refused(farpoint("run", bag, *fix), "holds sensor_msgs/msg/Image; expected NavSatFix")


def test_the_motions_of_a_run_are_written_as_a_bag(
    farpoint: CommandLine, tmp_path: Path, images: tuple[np.ndarray, ...], drive: RenderedSequence
):
    sent = [info_message(size=(WIDTH, HEIGHT), k=K), *sent_images(images)]
    source = write_bag(tmp_path, "mcap", [*sent, *wheels(drive, "nav_msgs/msg/Odometry", 1e-4)])
    bag, out = tmp_path / "motions.mcap", tmp_path / "out"
    speed = ("--metric.speed-topic", "/wheels")
    outcome = farpoint("run", source, *QUICK, *speed, "--out", out, "--bag", bag)
    assert outcome.code == 0, outcome.err
    counts, last = {}, None
    with AnyReader([bag]) as reader:
        for topic, info in reader.topics.items():
            counts[topic] = info.msgcount
        odometry = [c for c in reader.connections if c.topic == "/farpoint/odometry"]
        for connection, _, data in reader.messages(odometry):
            last = reader.deserialize(data, connection.msgtype)
    count = len(images)
    assert counts["/farpoint/odometry"] == counts["/farpoint/camera_info"] == count
    assert counts["/farpoint/twist"] == count - 1
    # In metres: forward is x.
    place = drive.world_from_cam[-1][:3, 3] - drive.world_from_cam[0][:3, 3]
    start = drive.world_from_cam[0][:3, :3].T @ place
    position: Any = last.pose.pose.position  # type: ignore[union-attr]
    found = np.array([position.x, position.y, position.z])
    np.testing.assert_allclose(found, [start[2], -start[0], -start[1]], atol=0.06 * start[2])
    assert "bag" in record_of(out)["wall_clock"]["stages_s"]


def test_messages_have_the_times_of_their_images_to_the_nanosecond(
    farpoint: CommandLine, tmp_path: Path, images: tuple[np.ndarray, ...], calibration: Path
):
    times = [START_NS + STEP_NS * number + 123_456_789 for number in range(len(images))]
    assert [round(time / 10**9 * 1e9) for time in times] != times
    sent = [image_message(i, "mono8", t) for i, t in zip(images, times, strict=True)]
    source, bag = write_bag(tmp_path, "sqlite3", sent), tmp_path / "motions.mcap"
    given = ("--camera", calibration, *QUICK, "--out", tmp_path / "out", "--bag", bag)
    assert farpoint("run", source, *given).code == 0
    with AnyReader([bag]) as reader:
        odometry = [c for c in reader.connections if c.topic == "/farpoint/odometry"]
        assert [time for _, time, _ in reader.messages(odometry)] == times


def test_a_bag_never_replaces_its_source(
    farpoint: CommandLine, tmp_path: Path, images: tuple[np.ndarray, ...], calibration: Path
):
    source = write_bag(tmp_path, "ros1", sent_images(images[:2]))
    data = source.read_bytes()
    given = ("--camera", calibration, *QUICK, "--out", tmp_path / "out", "--bag")
    assert_refused(farpoint("run", source, *given, source), "--bag: is the source itself")
    assert source.read_bytes() == data
    folder = write_bag(tmp_path, "sqlite3", sent_images(images[:2]))
    outcome = farpoint("run", folder, *given, folder / "out.mcap")
    assert_refused(outcome, "expected a place outside of the source")
