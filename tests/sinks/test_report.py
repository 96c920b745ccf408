"""report.html: one file that asks for nothing, tells the truth, and does not grow with the run."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
from folder_kit import put

from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.geometry import so3
from farpoint.geometry.angles import heading_angles_deg
from farpoint.metrics import SplitHalf
from farpoint.odometry import OdometryResult
from farpoint.pose import PoseStatus
from farpoint.sinks.motions import COLUMNS
from farpoint.sinks.output_folder import OutputFolder, OutputOptions
from farpoint.sinks.overlay.video import KEYFRAME_INTERVAL
from farpoint.sinks.report import write_report
from farpoint.sinks.report.charts import Chart, Curve, draw_chart
from farpoint.sinks.report.digest import (
    MAX_BINS,
    Digest,
    Series,
    digest_motions,
)
from farpoint.sinks.report.histogram import halves_section
from farpoint.sinks.report.lengths import FIRST_STEP
from farpoint.sinks.report.lens import lens_section
from farpoint.sinks.report.maps import path_map
from farpoint.sinks.report.moments import MomentSeeker
from farpoint.sinks.report.paths import Paths, paths_from_above
from farpoint.sinks.report.stills import evenly_spaced_key_packets, stills_at, thumbs_of
from farpoint.sinks.run_record import RunDescription
from farpoint.trajectory.files import Trajectory, read_tum, write_tum

MakeResult = Callable[..., OdometryResult]
IMAGE = np.full((480, 640), 60, np.uint8)
VOID = {"meta", "img", "line", "br"}


class WellFormed(HTMLParser):
    """Fails on tags that do not match; keeps what the page refers to."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.references: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.references += [value or "" for name, value in attrs if name in ("src", "href")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        del tag, attrs

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def run(camera: Camera) -> RunDescription:
    return RunDescription(
        source="/a/<script>alert(1)</script>.mp4",
        source_name="drive & <b>more</b>",
        camera=camera,
        options={"odometry": {"tracker": {"corners": 700}}},
        notes=("Positions have unit steps.",),
    )


@pytest.fixture(scope="module")
def page(
    tmp_path_factory: pytest.TempPathFactory, run: RunDescription, make_result: MakeResult
) -> str:
    path = tmp_path_factory.mktemp("out")
    with OutputFolder(path, run) as folder:
        for k in range(60):
            status = PoseStatus.FAILED if k == 30 else PoseStatus.OK
            put(folder, make_result(k, status, reason="a hard cut <here>"), IMAGE)
    return (path / "report.html").read_text()


def test_it_is_well_formed_and_asks_nothing_of_the_network(page: str) -> None:
    parser = WellFormed()
    parser.feed(page)
    assert parser.open == []
    assert parser.references
    assert all(value.startswith("data:image/jpeg;base64,") for value in parser.references)
    assert "http" not in page
    assert "@import" not in page
    assert "url(" not in page


def test_it_tells_what_was_run_and_what_came_of_it(page: str) -> None:
    assert "<b>58 of 59</b> pairs" in page
    assert "Positions have unit steps." in page
    assert "odometry.tracker.corners" in page
    assert re.search(r"29–30</td>.*?a hard cut &lt;here&gt;", page)
    assert "<script>alert" not in page
    assert "drive &amp; &lt;b&gt;more&lt;/b&gt;" in page


def test_the_pictures_at_a_glance_are_spread_over_the_run(page: str) -> None:
    strip = page[page.index("At a glance") :]
    pictures = re.findall(r"base64,([^\"]+)\"><figcaption>([\d.]+) s<", strip)
    times = [float(seconds) for _, seconds in pictures]
    assert times[0] > 0.0  # the first frame has nothing to show
    np.testing.assert_allclose(np.diff(times), KEYFRAME_INTERVAL * 0.1, atol=0.011)
    assert times[-1] > 4.0
    for data, _ in pictures:
        jpeg = np.frombuffer(base64.b64decode(data), np.uint8)
        assert cv2.imdecode(jpeg, cv2.IMREAD_COLOR).shape[1] == 360


def test_a_worst_moment_shows_the_frame_of_its_time(
    tmp_path: Path, run: RunDescription, make_result: MakeResult
) -> None:
    with OutputFolder(tmp_path, run) as folder:
        for k in range(40):
            # Each frame has a brightness of its own, by which its picture is known.
            put(folder, make_result(k), np.full((480, 640), 3 * k, np.uint8))
    for k in (1, 17, 38):
        (still,) = stills_at(tmp_path / "overlay.mp4", [0.1 * k])
        assert still.time_s == pytest.approx(0.1 * k, abs=1e-4)
        picture = cv2.imdecode(np.frombuffer(still.jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
        assert np.median(picture[:300, :400]) == pytest.approx(3 * k, abs=4)


def test_the_worst_moments_are_the_failures_and_the_extremes(
    tmp_path: Path, run: RunDescription, make_result: MakeResult
) -> None:
    stretch = {12, 13, 14}
    with OutputFolder(tmp_path, run, OutputOptions(overlay=False)) as folder:
        for k in range(1, 60):
            status = PoseStatus.FAILED if k in stretch | {30} else PoseStatus.OK
            result = make_result(k, status, sigma_deg=5.0 if k == 44 else 0.5, reason=f"cut {k}")
            late = 0.7 if k > 50 else 0.0
            put(
                folder,
                replace(
                    result,
                    timestamp0=result.timestamp0 + (0.7 if k > 51 else 0.0),
                    timestamp=result.timestamp + late,
                ),
                None,
            )
    moments = digest_motions(tmp_path / "motions.csv").moments.found({12: "cut 12", 30: "cut 30"})
    found = [(moment.title, moment.frame1, moment.reason) for moment in moments]
    assert found[0] == ("FAILED: 3 pairs in a row", 12, "cut 12")
    assert found[1] == ("FAILED: one pair", 30, "cut 30")
    by_title = {title: frame for title, frame, _ in found}
    assert by_title["Direction least sure"] == 44
    assert by_title["Longest time between frames"] == 51


def test_the_true_path_is_carried_into_the_axes_of_the_run(
    tmp_path: Path, run: RunDescription, make_result: MakeResult
) -> None:
    with OutputFolder(tmp_path, run, OutputOptions(overlay=False)) as folder:
        for k in range(30):
            put(folder, make_result(k), None)
    estimate = read_tum(tmp_path / "trajectory.tum")
    assert estimate.timestamps is not None
    moved = np.eye(4)
    moved[:3, :3] = so3.exp(np.array([0.3, -1.2, 0.4]))
    moved[:3, 3] = [5.0, 6.0, -7.0]
    true = moved @ estimate.world_from_body
    true[:, :3, 3] *= 3.5
    late = estimate.timestamps > estimate.timestamps[4]
    write_tum(
        tmp_path / "truth.tum",
        Trajectory(timestamps=estimate.timestamps[late], world_from_body=true[late]),
    )
    paths = paths_from_above(tmp_path, tmp_path / "truth.tum")
    assert paths.true_x_z is not None
    np.testing.assert_allclose(paths.true_x_z[late], paths.x_z[late], atol=1e-6)
    assert np.isnan(paths.true_x_z[~late]).all()
    page = write_report(tmp_path, tmp_path / "truth.tum").read_text()
    assert 'class="curve truth"' in page


@pytest.mark.parametrize(
    ("factor", "words"), [(1.0, "hold"), (9.0, "too small by about 2.9 times")]
)
def test_the_histogram_says_whether_the_covariances_hold(factor: float, words: str) -> None:
    rng = np.random.default_rng(5)
    halves = [
        SplitHalf(
            statuses=(PoseStatus.OK, PoseStatus.OK),
            difference=np.sqrt(factor) * rng.normal(size=5),
            covariance=np.eye(5),
        )
        for _ in range(400)
    ]
    section = halves_section(halves)
    assert words in section
    assert "5 degrees" in section
    counts = [int(count) for count in re.findall(r"<title>(\d+) tests", section)]
    assert sum(counts) == 400
    assert (counts[-1] > 100) == (factor > 1.0)  # the bar of all that lie beyond
    assert halves_section(halves[:3]) == ""
    opposed = replace(halves[0], difference=np.array([0.0, 0.0, 0.0, np.inf, 0.0]))
    section = halves_section([*halves, opposed])
    assert words in section
    assert "The directions of 1 more are opposite" in section


def test_the_headline_gives_four_answers(page: str) -> None:
    for question in ("How far", "How fast", "How sure", "What went wrong"):
        assert f"<dt>{question}</dt>" in page
    assert "<b>1 FAILED</b>" in page
    rate = re.search(r"<b>([\d.]+) deg/s</b> turning", page)
    assert rate
    turn_deg = np.rad2deg(np.linalg.norm([0.004, 0.03, -0.01]))
    assert float(rate[1]) == pytest.approx(turn_deg / 0.1, rel=0.01)


def test_the_curves_are_those_of_the_poses(page: str, make_result: MakeResult) -> None:
    found = re.search(r'id="curves">(.*?)</script>', page)
    assert found
    curves = json.loads(found.group(1))
    right = next(c for chart in curves["charts"] for c in chart if c["name"] == "right")
    assert len(right["values"]) == 59
    assert right["values"][29] is None
    for index in (0, 17, 58):
        pose = make_result(index + 1).pose
        assert pose is not None
        assert pose.heading_cam0 is not None
        assert pose.heading_covariance is not None
        angles, sigma = heading_angles_deg(pose.heading_cam0, pose.heading_covariance)
        assert right["values"][index] == pytest.approx(angles[0], rel=1e-3)
        assert right["sigma"][index] == pytest.approx(sigma[0], rel=1e-3)


def test_the_report_shows_the_given_and_the_estimated_lens() -> None:
    lens = {
        "refined": True,
        "given": {"fx": 500.0, "k1<": 0.0},
        "found": {"fx": 510.25, "k1<": 0.0125},
        "sigma": {"fx": 2.5, "k1<": 0.001},
        "moved_px": 6.5,
        "readout_s": 0.0215,
        "readout_sigma_s": 0.0005,
    }
    section = lens_section({"lens": lens})
    for words in ("510.25", "2.5", "k1&lt;", "0.0125", "21.5", "0.5", "6.5 px"):
        assert words in section
    assert lens_section({"lens": lens | {"refined": False}}) == ""
    assert lens_section({}) == ""


def test_an_interrupted_folder_gives_a_page(
    tmp_path: Path, run: RunDescription, make_result: MakeResult
) -> None:
    killed = OutputFolder(tmp_path, run)
    for k in range(40):
        killed.write(make_result(k), IMAGE)
    path = write_report(tmp_path)  # nothing was closed
    text = path.read_text()
    assert "<b>39 of 39</b>" in text
    assert "killed before it could end" in text
    assert "data:image/jpeg" in text
    killed.close()


def write_long_run(folder: Path, run: RunDescription, result: OdometryResult, rows: int) -> None:
    """The rows that OutputFolder would write, many times over; one pair in the middle is off."""
    with OutputFolder(folder, run, OutputOptions(overlay=False, report=False)) as outputs:
        put(outputs, result, None)
    header, row = (folder / "motions.csv").read_text().splitlines()
    heading, place = (folder / "positions.csv").read_text().splitlines()
    place = place.split(",", 2)[2]
    cells = row.split(",")
    noisy = [*cells]
    noisy[COLUMNS.index("noise_px")] = "9.5"
    with (
        (folder / "motions.csv").open("w") as motions,
        (folder / "positions.csv").open("w") as positions,
    ):
        motions.write(header + "\n")
        positions.write(heading + "\n")
        for k in range(rows):
            body = noisy if k == rows // 2 + 1 else cells
            motions.write(",".join([repr(k / 30), repr((k + 1) / 30), *body[2:]]) + "\n")
            positions.write(f"{k / 30},{k},{place}\n")


def test_neither_size_nor_curves_grow_with_the_run_and_no_spike_is_lost(
    tmp_path: Path, run: RunDescription, make_result: MakeResult
) -> None:
    sizes = []
    for rows in (6_000, 24_000):
        folder = tmp_path / str(rows)
        write_long_run(folder, run, make_result(1), rows)
        sizes.append(write_report(folder).stat().st_size)
        digest = digest_motions(folder / "motions.csv")
        assert MAX_BINS / 2 < len(digest.time_s) <= MAX_BINS
        assert digest.counts[PoseStatus.OK] == rows
        assert digest.series["noise_px"].high.max() == 9.5
        assert digest.series["noise_px"].first.max() < 1.0
    assert max(sizes) < 2_000_000


def test_the_status_bar_gives_each_pair_its_own_time(page: str) -> None:
    bars = re.findall(r'<rect class="(\w+)" x="([\d.]+)" width="([\d.]+)"', page)
    assert [status for status, _, _ in bars] == ["OK", "FAILED", "OK"]
    edges = np.array([[float(x), float(x) + float(width)] for _, x, width in bars])
    pair = 1000 / 59
    times = [[0, 29 * pair], [29 * pair, 30 * pair], [30 * pair, 1000]]
    np.testing.assert_allclose(edges, times, atol=0.02)
    assert "5.90 s, 60 frames" in page


def test_the_worst_status_of_a_bin_is_the_one_shown(
    tmp_path: Path, run: RunDescription, make_result: MakeResult
) -> None:
    with OutputFolder(tmp_path, run, OutputOptions(overlay=False)) as folder:
        for k in range(1, 2 * MAX_BINS + 1):
            status = PoseStatus.FAILED if k == 500 else PoseStatus.OK
            put(folder, replace(make_result(1, status), frame1=k, timestamp=100 + k / 10), None)
    digest = digest_motions(tmp_path / "motions.csv")
    assert digest.stride == 3
    assert [index for index, s in enumerate(digest.worst) if s is not PoseStatus.OK] == [499 // 3]


def one_curve(values: list[float], period: float = np.inf) -> str:
    first = np.array(values)
    series = Series(first=first, low=first, high=first)
    digest = Digest(
        span_s=len(first) - 1.0,
        begin_s=np.arange(len(first)) - 1.0,
        time_s=np.arange(len(first)) * 1.0,
        stride=1,
        worst=[PoseStatus.OK] * len(first),
        counts={},
        series={},
        moments=MomentSeeker(0.0),
    )
    curve = Curve(name="a", style="c1", values=series, period=period)
    svg = draw_chart(Chart(title="t", unit="u", curves=[curve]), digest, 0)
    return re.findall(r'class="curve c1" d="([^"]*)"', svg)[0]


def test_curves_break_at_gaps_and_where_angles_wrap() -> None:
    assert one_curve([1.0, 2.0, 3.0, 4.0]).count("M") == 1
    assert one_curve([1.0, np.nan, 3.0, 4.0]).count("M") == 2
    assert one_curve([170.0, 179.0, -179.0, -170.0], period=360.0).count("M") == 2
    assert one_curve([0.0, 700.0, 0.0]).count("M") == 1
    assert one_curve([np.nan, np.nan]) == ""
    assert one_curve([5.0]) == "M0.00 150.0h0"


def drawn_map(
    x_z: np.ndarray, segments: list[int], covariance: np.ndarray | None = None
) -> ElementTree.Element:
    if covariance is None:
        covariance = np.full((2, 2), np.nan)
    paths = Paths(
        time_s=np.arange(len(x_z)) * 1.0,
        x_z=x_z,
        segments=np.array(segments),
        covariance=np.broadcast_to(covariance, (len(x_z), 2, 2)),
    )
    return ElementTree.fromstring(path_map(paths, FIRST_STEP).split("<p>")[0])


def test_the_map_breaks_where_the_scale_was_lost_and_shows_how_sure_it_is() -> None:
    x_z = np.array([[0.0, 0.0], [0.0, 30.0], [10.0, 30.0], [20.0, 30.0]])
    svg = drawn_map(x_z, [0, 0, 1, 1], np.array([[4.0, 0.0], [0.0, 1.0]]))
    assert [line.attrib["points"] for line in svg.findall("polyline")] == [
        "0.00,-0.00 0.00,-30.00",
        "10.00,-30.00 20.00,-30.00",
    ]
    (lost,) = (dot for dot in svg.findall("path") if "ROTATION_ONLY" in dot.attrib["class"])
    assert lost.attrib["d"] == "M10.00 -30.00h0"
    last = svg.findall("polygon")[-1].attrib["points"]
    ring = np.array([pair.split(",") for pair in last.split()], float) - [20.0, -30.0]
    # A normal distribution in the plane has 95 % within 2.4477 sigma.
    np.testing.assert_allclose(np.abs(ring).max(axis=0), [2 * 2.4477, 2.4477], atol=0.01)


def test_lengths_are_not_added_across_a_break(
    tmp_path: Path, run: RunDescription, make_result: MakeResult
) -> None:
    with OutputFolder(tmp_path, run, OutputOptions(overlay=False)) as folder:
        for k in range(1, 5):
            place = np.eye(4)
            place[2, 3] = 100.0 * (k > 2) + k
            covariance = np.diag([0.0] * 5 + [0.04 * k, 0.0])
            put(
                folder,
                replace(
                    make_result(k),
                    world_from_cam=place,
                    world_covariance=covariance,
                    scale_sigma=0.1,
                    segment=int(k > 2),
                ),
                None,
            )
    paths = paths_from_above(tmp_path)
    np.testing.assert_allclose(paths.lengths, [1.0, 1.0])
    np.testing.assert_allclose(paths.covariance[-1], [[0.0, 0.0], [0.0, 0.16]])
    page = (tmp_path / "report.html").read_text()
    assert "<b>2</b> units" in page
    assert "the scale lost once" in page
    assert "carried by the last speed" not in page
    run = json.loads((tmp_path / "run.json").read_text())
    (tmp_path / "run.json").write_text(json.dumps({**run, "scale_guesses": 2}))
    write_report(tmp_path)
    page = (tmp_path / "report.html").read_text()
    assert "the scale carried by the last speed alone 2 times" in page
    (tmp_path / "positions.csv").unlink()  # an older run
    np.testing.assert_allclose(paths_from_above(tmp_path).x_z, paths.x_z)


@pytest.mark.parametrize(
    ("unit", "far", "chart", "path"),
    [
        (
            "that of the trajectory",
            "<b>4</b> units, 0.4 s<small>a unit is the first step; the end is known to 0.4 units",
            "unit of the trajectory",
            ("path from above, 0 units wide and 4 units deep", "grid is 1 unit wide"),
        ),
        (
            "m",
            "<b>4</b> m, 0.4 s<small>the end is known to 0.4 m",
            "m",
            ("path from above, 0 m wide and 4 m deep", "grid is 1 m wide"),
        ),
    ],
)
def test_lengths_have_the_unit_of_the_files(
    tmp_path: Path,
    run: RunDescription,
    make_result: MakeResult,
    unit: str,
    far: str,
    chart: str,
    path: tuple[str, str],
) -> None:
    with OutputFolder(tmp_path, run, OutputOptions(overlay=False)) as folder:
        folder.put("metric", {"unit": unit})
        for k in range(5):
            place = np.eye(4)
            place[2, 3] = k
            covariance = np.diag([0.0] * 5 + [0.04 * k, 0.0])
            put(
                folder,
                replace(
                    make_result(k),
                    world_from_cam=place,
                    world_covariance=covariance,
                    scale_sigma=0.1 if k else None,
                ),
                None,
            )
    page = (tmp_path / "report.html").read_text()
    assert far in page
    assert f"<b>Length of the step</b> <small>{chart}</small>" in page
    assert all(words in page for words in path)


def test_the_map_keeps_the_shape_of_the_path() -> None:
    x_z = np.array([[0.0, 0.0], [0.0, 30.0], [10.0, 30.0]])
    svg = drawn_map(x_z, segments=[0, 0, 0])
    left, top, width, height = map(float, svg.attrib["viewBox"].split())
    line = svg.find("polyline")
    assert line is not None
    points = np.array([pair.split(",") for pair in line.attrib["points"].split()], float)
    np.testing.assert_allclose(points, x_z * [1, -1])  # ahead is up
    assert np.all(points >= [left, top])
    assert np.all(points <= [left + width, top + height])


def test_without_a_video_there_are_no_pictures(tmp_path: Path) -> None:
    assert thumbs_of(tmp_path / "overlay.mp4", 4) == []
    assert stills_at(tmp_path / "overlay.mp4", [0.1]) == []
    (tmp_path / "overlay.mp4").write_bytes(b"")
    assert thumbs_of(tmp_path / "overlay.mp4", 4) == []
    assert stills_at(tmp_path / "overlay.mp4", [0.1]) == []
    (tmp_path / "overlay.mp4").write_bytes(b"no film at all" * 100)
    assert thumbs_of(tmp_path / "overlay.mp4", 4) == []
    assert stills_at(tmp_path / "overlay.mp4", [0.1]) == []


@pytest.mark.parametrize("keys", [2, 9, 40, 5000])
def test_few_packets_are_kept_and_they_are_spread_over_the_video(keys: int) -> None:
    video = (SimpleNamespace(is_keyframe=pts % 15 == 0, pts=pts) for pts in range(15 * keys))
    chosen = np.array([packet.pts / 15 for packet in evenly_spaced_key_packets(video, 8)])
    assert len(chosen) == min(8, keys - 1)
    steps = np.diff([0.0, *chosen, keys])
    assert steps.max() <= 2.6 * max(1.0, keys / 8)
    assert np.all(np.diff(chosen) > 0)


@pytest.mark.parametrize("name", ["run.json", "motions.csv", "trajectory.tum"])
def test_a_missing_file_is_named(
    tmp_path: Path, run: RunDescription, make_result: MakeResult, name: str
) -> None:
    with OutputFolder(tmp_path, run, OutputOptions(overlay=False)) as folder:
        put(folder, make_result(1), IMAGE)
    (tmp_path / "positions.csv").unlink()  # which tells more than trajectory.tum
    (tmp_path / name).unlink()
    with pytest.raises(InputError, match=rf"{re.escape(name)}: cannot be read"):
        write_report(tmp_path)
