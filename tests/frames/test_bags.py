"""Images, times and cameras out of bags of every kind."""

from __future__ import annotations

import json
import re
from base64 import b64encode
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from bags_kit import (
    KINDS,
    RECORDED_NS,
    ROS1,
    ROS2,
    Kind,
    Sent,
    build,
    compressed_message,
    foxglove_mcap,
    header,
    image_message,
    info_message,
    png,
    proto,
    proto_stamp,
    write_bag,
)
from frames_kit import HEIGHT, WIDTH, picture, video_frame
from rosbags.highlevel import AnyReader

from farpoint.camera import KannalaBrandt, Pinhole
from farpoint.camera.files.load import load_camera
from farpoint.errors import InputError, MissingExtraError
from farpoint.frames import open_frames
from farpoint.frames.bags import BagImages, compression
from farpoint.frames.bags.decoding import decoder_of
from farpoint.frames.bags.images import samples_of
from farpoint.frames.bags.records import Topic
from farpoint.frames.bags.video import VideoTopic

TENTH_NS = 10**8
K = [100.0, 0.0, 79.0, 0.0, 101.0, 59.0, 0.0, 0.0, 1.0]


def images(count: int = 6, **options: Any) -> list[Sent]:
    return [
        image_message(picture(number), "mono8", TENTH_NS * (number + 1), **options)
        for number in range(count)
    ]


def open_bag(path: Path, topic: str | None = None) -> BagImages:
    opened = open_frames(path, topic=topic)
    assert isinstance(opened, BagImages)
    return opened


@pytest.mark.parametrize(
    ("kind", "compression"),
    [
        *(("ros1", ""), ("ros1", "bz2"), ("ros1", "lz4")),
        *(("sqlite3", ""), ("sqlite3", "file"), ("sqlite3", "message")),
        *(("mcap", ""), ("mcap", "file"), ("mcap", "message"), ("mcap", "storage")),
    ],
)
def test_every_kind_of_bag_gives_the_same_frames(tmp_path: Path, kind: Kind, compression: Any):
    bag = open_bag(write_bag(tmp_path, kind, images(), compression=compression))
    assert bag.count == 6
    assert bag.name.startswith("drive")
    assert "headers of /cam/image_raw" in bag.timestamp_source
    for _ in range(2):  # it can be read again
        frames = list(bag)
        assert [frame.timestamp for frame in frames] == [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
        for number, frame in enumerate(frames):
            np.testing.assert_array_equal(frame.image, picture(number))


@pytest.mark.parametrize("kind", KINDS)
def test_messages_are_those_that_rosbags_reads(tmp_path: Path, kind: Kind):
    path = write_bag(tmp_path, kind, [*images(), info_message(size=(8, 8), k=K)])
    with AnyReader([path]) as reader:
        theirs = [
            (connection.topic, time_ns, bytes(data))
            for connection, time_ns, data in reader.messages()
        ]
    bag = open_bag(path).bag
    ours = [
        (message.topic.name, message.time_ns, bytes(message.data))
        for message in bag.messages([topic.name for topic in bag.topics()])
        if message.topic is not None
    ]
    assert sorted(ours) == sorted(theirs)


def test_parts_of_a_bag_follow_one_another_and_a_lone_file_is_one_too(tmp_path: Path):
    first = write_bag(tmp_path, "mcap", images(3), name="one")
    parts = tmp_path / "split"
    parts.mkdir()
    second = write_bag(tmp_path, "mcap", images(6)[3:], name="two")
    (first / "one-mcap.mcap").rename(parts / "drive_9.mcap")
    (second / "two-mcap.mcap").rename(parts / "drive_10.mcap")
    bag = open_bag(parts)
    assert bag.count == 6
    assert [frame.timestamp for frame in bag] == [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
    assert len(list(open_bag(parts / "drive_10.mcap"))) == 3


RNG = np.random.default_rng(3)
COLOUR = RNG.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
FOURTH = RNG.integers(0, 256, (HEIGHT, WIDTH, 1), dtype=np.uint8)
DEEP = RNG.integers(0, 1 << 16, (HEIGHT, WIDTH), dtype=np.uint16)
GREY_OF_PNG = cv2.imdecode(np.frombuffer(png(COLOUR), np.uint8), cv2.IMREAD_GRAYSCALE)


@pytest.mark.parametrize(
    ("encoding", "pixels"),
    [
        ("bgr8", COLOUR),
        ("8UC3", COLOUR),
        ("rgb8", COLOUR[..., ::-1]),
        ("bgra8", np.dstack([COLOUR, FOURTH])),
        ("rgba8", np.dstack([COLOUR[..., ::-1], FOURTH])),
    ],
)
def test_colours_become_what_a_png_file_of_them_becomes(
    tmp_path: Path, encoding: str, pixels: np.ndarray
):
    path = write_bag(tmp_path, "mcap", [image_message(pixels, encoding, 1, padding=5)])
    np.testing.assert_array_equal(next(iter(open_bag(path))).image, GREY_OF_PNG)


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("encoding", ["mono16", "16UC1"])
def test_deep_images_keep_their_upper_bits(tmp_path: Path, encoding: str, big: bool):
    path = write_bag(tmp_path, "ros1", [image_message(DEEP, encoding, 1, big=big, padding=2)])
    np.testing.assert_array_equal(next(iter(open_bag(path))).image, DEEP >> 8)


@pytest.mark.parametrize(
    ("pattern", "row", "column"),
    [("rggb", 0, 0), ("bggr", 1, 1), ("gbrg", 1, 0), ("grbg", 0, 1)],
)
@pytest.mark.parametrize("deep", [False, True])
def test_bayer_patterns_find_the_red_pixel(pattern: str, row: int, column: int, deep: bool):
    mosaic = np.zeros((HEIGHT, WIDTH), np.uint16 if deep else np.uint8)
    red = 200 << (8 if deep else 0)
    mosaic[row::2, column::2] = red  # red light alone
    sent = image_message(mosaic, f"bayer_{pattern}{16 if deep else 8}", 1)
    samples = samples_of(build(ROS2, sent.type_name, sent.fields), "Image", 1.0)
    # Luma of a red surface, everywhere alike.
    np.testing.assert_allclose(samples[4:-4, 4:-4], 0.299 * red, rtol=0.02)


@pytest.mark.parametrize(("encoding", "at"), [("yuv422", 1), ("yuv422_yuy2", 0)])
def test_luma_is_taken_out_of_packed_colours(tmp_path: Path, encoding: str, at: int):
    packed = np.full((HEIGHT, WIDTH, 2), 128, np.uint8)
    packed[..., at] = picture(1)
    path = write_bag(tmp_path, "mcap", [image_message(packed, encoding, 1)])
    np.testing.assert_array_equal(next(iter(open_bag(path))).image, picture(1))


@pytest.mark.parametrize("kind", KINDS)
def test_compressed_images_are_decoded_as_files_are(tmp_path: Path, kind: Kind):
    jpeg = cv2.imencode(".jpg", picture(1))[1].tobytes()
    sent = [
        compressed_message(png(picture(0)), TENTH_NS),
        compressed_message(jpeg, 2 * TENTH_NS, kind="bgr8; jpeg compressed bgr8"),
        compressed_message(jpeg[:-200], 3 * TENTH_NS, kind="jpeg"),
    ]
    frames = list(open_bag(write_bag(tmp_path, kind, sent)))
    np.testing.assert_array_equal(frames[0].image, picture(0))
    (tmp_path / "jpeg").mkdir()
    for number in range(2):
        (tmp_path / "jpeg" / f"{number}.jpg").write_bytes(jpeg)
    from_file = next(iter(open_frames(tmp_path / "jpeg")))
    np.testing.assert_array_equal(frames[1].image, from_file.image)
    assert frames[2].fault == "the JPEG is truncated"


def test_unknown_encodings_and_sizes_beyond_the_limit_are_faults(tmp_path: Path):
    floats = np.zeros((8, 8), np.float32)
    sent = [*images(1), image_message(floats, "32FC1", 2 * TENTH_NS)]
    path = write_bag(tmp_path, "mcap", sent)
    assert "'32FC1' is not supported" in (list(open_bag(path))[1].fault or "")
    small = open_frames(path, max_megapixels=0.01)
    assert "--max-megapixels" in (next(iter(small)).fault or "")


def test_frames_of_deep_images_are_equal_for_every_source(tmp_path: Path):
    rng = np.random.default_rng(0)
    deep = [rng.integers(7000, 7300 + 40 * k, (32, 48)).astype(np.uint16) for k in range(20)]
    folder = tmp_path / "folder"
    folder.mkdir()
    for number, image in enumerate(deep):
        (folder / f"{number:03d}.png").write_bytes(png(image))
    files = open_frames(folder)
    sent = [image_message(image, "mono16", TENTH_NS * (k + 1)) for k, image in enumerate(deep)]
    bag = open_bag(write_bag(tmp_path, "ros1", sent))
    assert bag.notes == files.notes != ()
    for ours, theirs in zip(bag, files, strict=True):
        np.testing.assert_array_equal(ours.image, theirs.image)


def encode(codec: str, count: int) -> list[bytes]:
    context: Any = av.CodecContext.create(codec, "w")
    context.width, context.height, context.pix_fmt = WIDTH, HEIGHT, "yuv420p"
    context.time_base, context.framerate = Fraction(1, 10), Fraction(10)
    context.max_b_frames, context.gop_size = 0, 5
    context.options = {"tune": "zerolatency", "crf": "4"}
    packets = []
    for number in range(count):
        frame = video_frame(picture(number), "yuv420p")
        frame.pts = number
        packets += [bytes(packet) for packet in context.encode(frame)]
    packets += [bytes(packet) for packet in context.encode(None)]
    assert len(packets) == count
    return packets


@pytest.mark.parametrize(("codec", "name"), [("libx264", "h264"), ("libx265", "h265")])
def test_compressed_video_gives_a_picture_for_each_message(tmp_path: Path, codec: str, name: str):
    if codec == "libx265":
        av.logging.set_level(av.logging.PANIC)
    sent = [
        Sent(
            "/camera",
            "foxglove_msgs/msg/CompressedVideo",
            RECORDED_NS + number,
            {
                "timestamp": TENTH_NS * (number + 1),
                "frame_id": "camera",
                "data": np.frombuffer(packet, np.uint8),
                "format": name,
            },
        )
        for number, packet in enumerate(encode(codec, 12))
    ]
    frames = list(open_bag(write_bag(tmp_path, "mcap", sent)))
    assert [frame.timestamp for frame in frames] == [(k + 1) / 10 for k in range(12)]
    for number, frame in enumerate(frames):
        assert frame.image is not None, frame.fault
        assert np.abs(frame.image.astype(int) - picture(number)).mean() < 4


def test_a_damaged_picture_costs_only_the_pictures_decoded_from_it(tmp_path: Path):
    packets = encode("libx264", 15)
    packets[6] = b"\xff" * 40
    packets[12] = b"\0\0\0\1\x09\xf0"  # a delimiter, and no picture behind it
    messages = [
        (k, proto((1, proto_stamp(TENTH_NS * (k + 1))), (3, packet), (4, "h264")))
        for k, packet in enumerate(packets)
    ]
    path = foxglove_mcap(tmp_path / "v.mcap", messages, type_name="foxglove.CompressedVideo")
    frames = list(open_bag(path))
    assert len(frames) == 15
    faults = [frame.index for frame in frames if frame.fault]
    assert {6, 12} <= set(faults)
    assert set(faults) <= {6, 7, 8, 9, 12, 13, 14}  # pictures stand alone at 5 and 10
    assert np.abs(frames[11].image.astype(int) - picture(11)).mean() < 4
    assert [frame.timestamp for frame in frames] == [(k + 1) / 10 for k in range(15)]


@pytest.mark.parametrize("encoding", ["protobuf", "json"])
def test_plain_mcap_with_the_images_of_foxglove(tmp_path: Path, encoding: str):
    messages = []
    for number in range(3):
        stamp_ns, data = TENTH_NS * (number + 1), png(picture(number))
        text = {
            "timestamp": {"sec": 0, "nsec": stamp_ns},
            "frame_id": "camera",
            "data": b64encode(data).decode(),
            "format": "png",
        }
        raw = proto((1, proto_stamp(stamp_ns)), (2, data), (3, "png"), (4, "camera"))
        messages.append(
            (RECORDED_NS + number, raw if encoding == "protobuf" else json.dumps(text).encode())
        )
    path = tmp_path / "plain.mcap"
    foxglove_mcap(path, messages, type_name="foxglove.CompressedImage", encoding=encoding)
    bag = open_bag(path)
    assert bag.frame_id == "camera"
    for number, frame in enumerate(bag):
        assert frame.timestamp == (number + 1) / 10
        np.testing.assert_array_equal(frame.image, picture(number))


def test_images_without_a_time_in_their_header_have_that_of_the_recording(tmp_path: Path):
    sent = [image_message(picture(k), "mono8", 0, recorded_ns=k * TENTH_NS) for k in range(1, 4)]
    bag = open_bag(write_bag(tmp_path, "sqlite3", sent))
    assert bag.timestamp_source == "recording of /cam/image_raw"
    assert [frame.timestamp for frame in bag] == [0.1, 0.2, 0.3]


@pytest.mark.parametrize("kind", KINDS)
def test_headers_may_begin_at_zero(tmp_path: Path, kind: Kind):
    sent = [image_message(picture(k), "mono8", k * TENTH_NS) for k in range(4)]
    sent.insert(3, image_message(picture(0), "mono8", 0, recorded_ns=RECORDED_NS + 25 * 10**7))
    bag = open_bag(write_bag(tmp_path, kind, sent))
    times = [frame.timestamp for frame in bag]
    assert times[:3] == [0.0, 0.1, 0.2]
    assert times[3] == pytest.approx(0.25, abs=1e-6)
    assert times[4] == 0.3
    assert "headers" in bag.timestamp_source


def test_a_header_without_a_time_among_others_has_about_that_of_the_recording(tmp_path: Path):
    sent = images(30)
    sent[20] = image_message(picture(0), "mono8", 0, recorded_ns=sent[20].recorded_ns)
    times = [frame.timestamp for frame in open_bag(write_bag(tmp_path, "mcap", sent))]
    assert times[20] == pytest.approx(2.1, abs=1e-6)
    assert times[21] == 2.2


# Which topic


def test_several_image_topics_are_listed_with_their_counts(tmp_path: Path):
    sent = [*images(3), *images(2, topic="/right/image_raw")]
    path = write_bag(tmp_path, "ros1", sent)
    words = re.escape("topic: several topics hold images: expected one of ")
    counts = re.escape("/cam/image_raw (3), /right/image_raw (2)")
    with pytest.raises(InputError, match=words + counts):
        open_frames(path)
    assert open_bag(path, "/right/image_raw").count == 2
    assert open_bag(path, "right/image_raw").topic.name == "/right/image_raw"


def test_topics_that_are_no_images_or_not_there_are_refused(tmp_path: Path):
    path = write_bag(tmp_path, "mcap", [*images(1), info_message(size=(8, 8), k=K)])
    with pytest.raises(InputError, match=r"holds sensor_msgs/msg/CameraInfo; expected images"):
        open_frames(path, topic="/cam/camera_info")
    with pytest.raises(InputError, match=r"no topic /nowhere; expected one of /cam/image_raw "):
        open_frames(path, topic="/nowhere")
    only = write_bag(tmp_path, "mcap", [info_message(size=(8, 8), k=K)], name="without")
    with pytest.raises(InputError, match=r"holds no images; its topics are /cam/camera_info \(1\)"):
        open_frames(only)
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "0.png").write_bytes(png(picture(0)))
    with pytest.raises(InputError, match="only a bag has topics"):
        open_frames(tmp_path / "folder", topic="/cam")


def test_a_missing_extra_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = write_bag(tmp_path, "mcap", images(1))
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    with pytest.raises(MissingExtraError, match=r"farpoint\[ros\]"):
        open_frames(path)


# The camera


def camera_of(folder: Path, *infos: Sent, topic: str = "/cam/image_raw") -> Any:
    sent = [*infos, *images(1, topic=topic)]
    return open_bag(write_bag(folder, "mcap", sent), topic).camera()


@pytest.mark.parametrize(
    ("model", "d", "expected"),
    [
        ("plumb_bob", [0.1, -0.2, 0.001, 0.002, 0.03], Pinhole),
        ("rational_polynomial", [0.1, -0.2, 0.001, 0.002, 0.03, 0.2, 0.1, 0.01], Pinhole),
        ("equidistant", [0.1, -0.02, 0.003, 0.004], KannalaBrandt),
        ("fisheye", [0.1, -0.02, 0.003, 0.004], KannalaBrandt),
        ("", [], Pinhole),
        ("whatever", [0.0, 0.0, 0.0, 0.0, 0.0], Pinhole),
    ],
)
@pytest.mark.parametrize("kind", KINDS)
def test_the_lens_is_that_of_the_message(
    tmp_path: Path, kind: Kind, model: str, d: list[float], expected: type
):
    info = info_message(size=(WIDTH, HEIGHT), k=K, d=d, model=model)
    camera = open_bag(write_bag(tmp_path, kind, [info, *images(1)])).camera()
    assert isinstance(camera.model, expected)
    assert camera.size == (WIDTH, HEIGHT)
    values = dict(camera.model.parameters)
    assert (values["fx"], values["fy"], values["cx"], values["cy"]) == (100.0, 101.0, 79.0, 59.0)
    if any(d):
        # The same numbers as of the YAML file that camera_calibration writes.
        text = f"image_width: {WIDTH}\nimage_height: {HEIGHT}\ncamera_matrix: {{data: {K}}}\n"
        text += f"distortion_model: {model}\ndistortion_coefficients: {{data: {d}}}\n"
        (tmp_path / "camera.yaml").write_text(text)
        assert load_camera(tmp_path / "camera.yaml").model == camera.model


def test_an_unknown_lens_and_an_uncalibrated_one_are_refused(tmp_path: Path):
    with pytest.raises(InputError, match="cahvore"):
        camera_of(tmp_path, info_message(size=(8, 8), k=K, d=[1.0], model="cahvore"))
    (tmp_path / "other").mkdir()
    with pytest.raises(InputError, match="K is not calibrated"):
        camera_of(tmp_path / "other", info_message(size=(8, 8), k=[0.0] * 9))


def test_rectified_topics_have_the_projection_matrix(tmp_path: Path):
    p = [90.0, 0, 70.0, -9.0, 0, 91.0, 50.0, 0, 0, 0, 1, 0]
    info = info_message(size=(WIDTH, HEIGHT), k=K, d=[0.1, 0, 0, 0, 0], p=p)
    for name in ("image_rect", "image_rect_color"):
        (tmp_path / name).mkdir()
        model = camera_of(tmp_path / name, info, topic=f"/cam/{name}").model
        assert model == Pinhole(fx=90.0, fy=91.0, cx=70.0, cy=50.0)
    (tmp_path / "raw").mkdir()
    assert camera_of(tmp_path / "raw", info, topic="/cam/image_direct").model.fx == 100.0


def test_binning_and_region_of_interest_move_the_image(tmp_path: Path):
    info = info_message(
        size=(640, 480), k=K, d=[0.1, 0, 0, 0, 0], binning=(2, 4), roi=(40, 20, 316, 400)
    )
    camera = camera_of(tmp_path, info)
    assert camera.size == (158, 100)
    values = dict(camera.model.parameters)
    assert values["fx"], values["fy"] == (50.0, 25.25)
    assert (values["cx"], values["cy"]) == ((79.0 - 40) / 2, (59.0 - 20) / 4)
    # A point lands where its pixel of the full image is read out.
    full = Pinhole(fx=100.0, fy=101.0, cx=79.0, cy=59.0, distortion=(0.1, 0, 0, 0, 0))
    point = np.array([[0.2, 0.1, 1.0]])
    expected = (full.project(point) - [40, 20]) / [2, 4]
    np.testing.assert_allclose(camera.project(point), expected)


def test_the_camera_is_the_one_beside_the_images_or_of_their_frame(tmp_path: Path):
    left = info_message("/left/camera_info", size=(8, 8), k=[1.0, *K[1:]], frame_id="left")
    right = info_message("/right/camera_info", size=(8, 8), k=K, frame_id="camera")
    assert camera_of(tmp_path, left, right, topic="/left/image_raw").model.fx == 1.0
    (tmp_path / "frame").mkdir()
    assert camera_of(tmp_path / "frame", left, right, topic="/images").model.fx == 100.0
    (tmp_path / "none").mkdir()
    with pytest.raises(InputError, match=r"no CameraInfo in the bag \(there are /left/camera_info"):
        camera_of(tmp_path / "none", left, topic="/images")


def test_the_calibration_of_foxglove_is_read():
    data = proto((9, "camera"), (4, "plumb_bob"), (5, [0.1, 0.2]), (6, K))
    data += b"\x15" + (640).to_bytes(4, "little") + b"\x1d" + (480).to_bytes(4, "little")
    topic = Topic(name="/c", type_name="foxglove.CameraCalibration", encoding="protobuf")
    found = decoder_of(topic)(data)
    assert (found.width, found.height, found.d, found.k) == (640, 480, [0.1, 0.2], K)


def test_chunks_are_not_unpacked_beyond_what_they_announce():
    bomb = compression._zstd().compress(bytes(1 << 24))
    assert len(compression.decompress(memoryview(bomb), "zstd", 1000)) == 1000


def test_the_kit_builds_what_rosbags_reads_back():
    fields = {"header": header(12, "here"), "format": "png", "data": np.arange(3, dtype=np.uint8)}
    name = "sensor_msgs/msg/CompressedImage"
    raw = ROS2.serialize_cdr(build(ROS2, name, fields), name)
    assert ROS2.deserialize_cdr(raw, name).header.stamp.nanosec == 12


def test_a_bag_beside_images_is_passed_over(tmp_path: Path):
    (tmp_path / "0.png").write_bytes(png(picture(0)))
    write_bag(tmp_path, "ros1", images(3))
    assert open_frames(tmp_path).count == 1
    (tmp_path / "0.png").unlink()
    assert open_bag(tmp_path).count == 3


def test_json_without_sense_is_a_fault(tmp_path: Path):
    messages = [
        b'{"timestamp": {"sec": "x"}, "data": ""}',
        b'{"timestamp": {"sec": 1, "nsec": 5}, "data": 7}',
        b"[1, 2]",
        b'{"timestamp": {"sec": 1, "nsec": 5}, "width": "w", "height": 2, "encoding": "mono8"}',
    ]
    path = tmp_path / "x.mcap"
    rows = [(k, message) for k, message in enumerate(messages)]
    foxglove_mcap(path, rows, type_name="foxglove.RawImage", encoding="json")
    frames = list(open_bag(path))
    assert len(frames) == 4
    assert all(frame.fault for frame in frames)


def test_every_message_of_a_video_has_its_turn_whatever_leaves_the_decoder(
    monkeypatch: pytest.MonkeyPatch,
):
    leaving: dict[int, list[int]] = {0: [], 1: [0], 2: [], 3: [3], 4: []}  # 1 and 2 never do

    class Decoder:
        def decode(self, packet: Any) -> list[Any]:
            pictures = []
            for number in [4] if packet is None else leaving[packet.pts]:
                frame = video_frame(picture(number), "yuv420p")
                frame.pts = number
                pictures.append(frame)
            return pictures

    monkeypatch.setattr("farpoint.frames.bags.video._open", lambda _av, _kind: Decoder())
    video = VideoTopic[int]()
    given = [found for k in range(5) for found in video.add(b"x", "h264", k)]
    given += list(video.close())
    assert [found.label for found in given] == [0, 1, 2, 3, 4]
    assert [found.label for found in given if found.fault == "no picture came of it"] == [1, 2]
    for found in given:
        if found.image is not None:
            np.testing.assert_array_equal(found.image, picture(found.label))


def test_plain_mcap_with_messages_of_ros_1(tmp_path: Path):
    name = "sensor_msgs/msg/Image"
    messages = [
        (sent.recorded_ns, bytes(ROS1.serialize_ros1(build(ROS1, name, sent.fields), name)))
        for sent in images(3)
    ]
    definition = ROS1.generate_msgdef(name)[0].encode()
    path = tmp_path / "x.mcap"
    described = ("ros1msg", definition)
    foxglove_mcap(path, messages, type_name="sensor_msgs/Image", encoding="ros1", schema=described)
    frames = list(open_bag(path))
    assert [frame.timestamp for frame in frames] == [0.1, 0.2, 0.3]
    np.testing.assert_array_equal(frames[2].image, picture(2))
