"""report.html in a browser: no complaint in the console, charts drawn, cursor and zoom at work."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable
from html import unescape
from pathlib import Path

import cv2
import numpy as np
import pytest

from farpoint.camera import Camera
from farpoint.odometry import OdometryResult
from farpoint.pose import PoseStatus
from farpoint.sinks.output_folder import OutputFolder
from farpoint.sinks.run_record import RunDescription

MakeResult = Callable[..., OdometryResult]

# What a hand does: drag over the middle of a chart, then point; keys for who has no mouse. What
# came of it is written into the page for the test to read.
HAND = """<script>
addEventListener("load", () => {
  const said = [], plot = document.querySelectorAll(".plot[tabindex]")[2];
  const box = plot.getBoundingClientRect(), svg = plot.querySelector("svg");
  const point = (type, x) => plot.dispatchEvent(new PointerEvent(type, {
    clientX: box.left + x * box.width, clientY: box.top + 20, pointerType: "mouse", button: 0,
  }));
  const key = (name) => plot.dispatchEvent(new KeyboardEvent("keydown", { key: name }));
  const peek = document.getElementById("peek"), output = plot.parentElement.querySelector("output");
  said.push(svg.getAttribute("viewBox"));
  point("pointermove", 0.5);
  said.push(output.value, peek.hidden, peek.querySelector("img").src.slice(0, 22));
  point("pointerdown", 0.25); point("pointermove", 0.75); point("pointerup", 0.75);
  said.push(svg.getAttribute("viewBox"), document.getElementById("all").hidden);
  document.getElementById("all").click();
  said.push(svg.getAttribute("viewBox"));
  point("pointermove", 0.5); key("ArrowRight"); said.push(output.value);
  key("+"); said.push(svg.getAttribute("viewBox"));
  key("Escape"); said.push(svg.getAttribute("viewBox"), output.value);
  plot.focus(); said.push(output.getAttribute("aria-live"));
  const pre = document.createElement("pre");
  pre.id = "said"; pre.textContent = said.join("\\n"); document.body.append(pre);
});
</script></body>"""


@pytest.fixture(scope="module")
def browser() -> str:
    for name in ("chromium", "chromium-browser", "google-chrome"):
        if path := shutil.which(name):
            return path
    pytest.skip("no Chromium to look at the page with")


@pytest.fixture(scope="module")
def firefox() -> str:
    for name in ("firefox", "firefox-esr"):
        if path := shutil.which(name):
            return path
    pytest.skip("no Firefox to look at the page with")


@pytest.fixture(scope="module")
def report(
    tmp_path_factory: pytest.TempPathFactory, camera: Camera, make_result: MakeResult
) -> Path:
    folder = tmp_path_factory.mktemp("run")
    run = RunDescription(source="drive.mp4", source_name="drive", camera=camera, options={})
    with OutputFolder(folder, run) as outputs:
        for k in range(61):
            status = PoseStatus.FAILED if k == 30 else PoseStatus.OK
            outputs.write(make_result(k, status), np.full((480, 640), 60, np.uint8))
    return folder / "report.html"


def look(browser: str, profile: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [browser, "--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr",
         f"--user-data-dir={profile}", *arguments],
        capture_output=True, text=True, timeout=120, check=True,
    )  # fmt: skip


def complaints(seen: subprocess.CompletedProcess[str]) -> list[str]:
    return [line for line in seen.stderr.splitlines() if "CONSOLE" in line]


def test_hand_and_keys_move_cursor_and_zoom(browser: str, report: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text(report.read_text().replace("</body>", HAND))
    seen = look(browser, tmp_path / "profile", "--dump-dom", page.as_uri())
    assert complaints(seen) == []
    found = re.search(r'<pre id="said">(.*?)</pre>', seen.stdout, re.S)
    assert found
    said = unescape(found[1]).split("\n")
    assert said[0] == "0 0 1000 300"
    assert re.match(r"3 s: y [\d.e-]+ ± [\d.e-]+$|3 s: y –$", said[1])
    assert said[2:4] == ["false", "data:image/jpeg;base64"]
    zoomed = [float(number) for number in said[4].split()]
    assert zoomed == pytest.approx([250, 0, 500, 300], abs=3)
    assert said[5] == "false"  # the button that shows all is there
    assert said[6] == "0 0 1000 300"
    assert said[7].startswith("3.1 s: y ")
    assert float(said[8].split()[2]) == pytest.approx(500, abs=3)
    assert said[9:] == ["0 0 1000 300", "", "polite"]


@pytest.mark.parametrize("width", [1000, 500])
def test_the_charts_are_drawn_on_a_desk_and_on_a_phone(
    browser: str, report: Path, tmp_path: Path, width: int
) -> None:
    shot = tmp_path / "shot.png"
    size = f"--window-size={width},6000"
    seen = look(
        browser, tmp_path / "profile", "--hide-scrollbars", size, f"--screenshot={shot}",
        report.as_uri(),
    )  # fmt: skip
    assert complaints(seen) == []
    assert_charts_drawn(shot, width)


def test_the_charts_are_drawn_in_firefox(firefox: str, report: Path, tmp_path: Path) -> None:
    shot, profile = tmp_path / "shot.png", tmp_path / "profile"
    profile.mkdir()
    subprocess.run(
        [firefox, "--headless", "--no-remote", "--profile", str(profile), "--window-size",
         "1000,6000", "--screenshot", str(shot), report.as_uri()],
        capture_output=True, timeout=120, check=True,
    )  # fmt: skip
    assert_charts_drawn(shot, 1000)


def assert_charts_drawn(shot: Path, width: int) -> None:
    picture = cv2.imread(str(shot))
    assert picture.shape[1] == width
    # Colours of the curves, of a FAILED pair in the status bar, and of pictures of the film.
    for colour in ((0x25, 0x63, 0xB8), (0xB3, 0x52, 0x0A), (0xC9, 0x2A, 0x2A), (22, 24, 28)):
        found = np.abs(picture[..., ::-1].astype(int) - colour).max(axis=-1) < 8
        assert found.sum() > 40, colour
    # Nothing stands out of the page: the last columns are its ground.
    assert (picture[:, -4:] > 240).all()
