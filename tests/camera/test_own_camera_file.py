"""farpoint's own ``camera.yaml``: written, read back to the last digit, and what is wrong in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from lens_collection import FOCAL, LENSES

from farpoint.camera import Camera, Pinhole, load_camera, write_camera
from farpoint.errors import InputError

LENSES = LENSES | {
    "fourteen": Pinhole(**FOCAL, distortion=tuple(0.1 / 3**power for power in range(14)))
}


def back(camera: Camera, folder: Path) -> Camera:
    path = folder / "written.anything"
    write_camera(camera, path)
    found = load_camera(path)
    assert found.source == f"farpoint camera.yaml, {path}"
    return found


def a_covariance(count: int) -> np.ndarray:
    root = np.random.default_rng(count).normal(size=(count, count)) / 7
    root *= 10.0 ** -np.arange(count)[:, None]
    covariance = root @ root.T
    return 0.5 * (covariance + covariance.T)


@pytest.mark.parametrize("name", LENSES)
def test_a_camera_comes_back_as_it_was(name: str, tmp_path: Path) -> None:
    plain = Camera(model=LENSES[name], size=(640, 480), name="left")
    covariance = a_covariance(len(plain.model.refinable().parameters))
    for camera in (
        plain,
        replace(plain, size=None),
        plain.with_uncertainty(focal=1 / 300),
        plain.with_uncertainty(focal=0.1, center_px=2 / 3, distortion_px=1e-5),
        plain.with_parameter_covariance(covariance),
        plain.with_parameter_sigmas([0.1 / 3] * len(plain.model.parameters)),
        plain.with_readout(1 / 47),
        plain.with_readout(0.0).with_uncertainty(center_px=3),
        plain.with_readout(1 / 47, 1e-3 / 7),
    ):
        found = back(camera, tmp_path)
        assert found == camera
        np.testing.assert_array_equal(
            found.project([[0.1, 0.2, 1]]), camera.project([[0.1, 0.2, 1]])
        )


@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    name=st.text(min_size=1),
    numbers=st.lists(st.floats(-1e10, 1e10), min_size=4, max_size=4),
    focal=st.floats(1e-3, 1e9),
)
def test_any_name_and_number_comes_back(
    name: str, numbers: list[float], focal: float, tmp_path: Path
) -> None:
    try:
        name.encode()
    except UnicodeEncodeError:
        return
    model = Pinhole(fx=focal, fy=focal, cx=1e-7, cy=-3, distortion=tuple(numbers))
    camera = Camera(model=model, name=name)
    assert back(camera, tmp_path) == camera


def test_what_farpoint_wrote_is_asked_for_by_its_name(tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    write_camera(Camera(model=Pinhole(**FOCAL), name="cam1"), path)
    assert load_camera(path, "cam1").name == "cam1"
    with pytest.raises(InputError, match="no camera 'cam0'; expected one of cam1"):
        load_camera(path, "cam0")


def test_sigmas_may_be_written_by_hand(write: Callable[..., Path]) -> None:
    camera = load_camera(write(FILE + "sigma: {fx: 2.5, k1: 0.01}\n"))
    sigmas = camera.parameter_sigmas()
    assert sigmas["fx"] == 2.5
    assert sigmas["k1"] == pytest.approx(0.01, rel=1e-15)
    assert sigmas["fy"] == 0.0
    assert camera.name == "calibration"


@dataclass(frozen=True, kw_only=True)
class _Foreign(Pinhole):
    pass


def test_a_lens_from_elsewhere_is_not_written(tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    with pytest.raises(InputError, match=r"^camera: expected a lens of farpoint, got _Foreign"):
        write_camera(Camera(model=_Foreign(**FOCAL)), path)
    assert not path.exists()


FILE = """\
farpoint_camera: 1
model: Pinhole
size: [640, 480]
parameters:
  fx: 500.0
  fy: 500.0
  cx: 320.0
  cy: 240.0
  k1: -0.2
  k2: 0.1
  p1: 0.0
  p2: 0.0
"""


@pytest.mark.parametrize(
    ("old", "new", "field", "problem"),
    [
        ("farpoint_camera: 1", "farpoint_camera: 2", "farpoint_camera", "expected 1, got 2"),
        ("farpoint_camera: 1", "farpoint_camera: x", "farpoint_camera", "expected a number"),
        ("model: Pinhole", "model: Pinehole", "model", "expected one of Arctangent"),
        ("model: Pinhole\n", "", "model", "missing"),
        ("size: [640, 480]", "size: [640]", "size", "expected 2 numbers"),
        ("size: [640, 480]", "size: [640, 0.5]", "size", "whole number"),
        ("  fx: 500.0\n", "", "parameters (fx)", "missing"),
        ("fx: 500.0", "fx: -500.0", "parameters (fx)", "positive"),
        ("fx: 500.0", "fx: wide", "parameters.fx", "expected a number"),
        ("fx: 500.0", "fx: .inf", "parameters.fx", "finite"),
        ("  p2: 0.0\n", "", "parameters (distortion)", "coefficients"),
        ("  p2: 0.0\n", "  p2: 0.0\n  k4: 0.1\n", "parameters (k3)", "missing"),
        ("fx: 500.0", "fx: 500.0\n  f: 3", "parameters (f)", "no parameter of Pinhole"),
        ("size:", "readout_s: -0.1\nsize:", "readout_s (readout_s)", "negative"),
        (
            "size:",
            "readout_s: 0.1\nreadout_sigma_s: 0\nsize:",
            "readout_sigma_s (readout_sigma_s)",
            "positive",
        ),
        ("size:", "readout_s: quick\nsize:", "readout_s", "a number"),
        ("size:", "uncertainty: {focal: -1}\nsize:", "uncertainty (focal)", "positive"),
        ("size:", "uncertainty: {fokal: 1}\nsize:", "uncertainty.fokal", "expected only"),
        ("size:", "uncertainty: some\nsize:", "uncertainty", "group"),
        ("size:", "sigma: {f: 1}\nsize:", "sigma (sigmas)", "unknown parameter 'f'"),
        ("size:", "sigma: {fx: -1}\nsize:", "sigma (fx)", "negative"),
        ("size:", "covariance: {fx: [1]}\nsize:", "covariance", "expected rows fx, fy"),
    ],
)
def test_faults_name_the_file_and_the_field(
    write: Callable[..., Path], old: str, new: str, field: str, problem: str
) -> None:
    assert old in FILE
    path = write(FILE.replace(old, new))
    with pytest.raises(InputError) as caught:
        load_camera(path)
    assert caught.value.file == str(path)
    assert caught.value.field == field
    assert problem in caught.value.problem
    assert len(str(caught.value).splitlines()) == 1


def test_a_covariance_that_is_none(write: Callable[..., Path]) -> None:
    names = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")
    rows = [f"  {name}: {[float(name == other) for other in names]}" for name in names]
    good = write(FILE + "covariance:\n" + "\n".join(rows))
    assert set(load_camera(good).parameter_sigmas().values()) == {1.0}
    for old, new in (("  fx: [1.0,", "  fx: [-1.0,"), ("  fx: [1.0, 0.0", "  fx: [1.0, 7.0")):
        path = write(good.read_text().replace(old, new), "other")
        with pytest.raises(InputError) as caught:
            load_camera(path)
        assert caught.value.field == "covariance (covariance)"
    path = write(good.read_text().replace("  fx: [1.0, ", "  fx: ["), "other")
    with pytest.raises(InputError, match=r"covariance.fx: expected 8 numbers, got 7"):
        load_camera(path)
