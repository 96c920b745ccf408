"""Mutants of trajectories and tables: read, or refused in one line that names the file."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from farpoint.aiding import MetricOptions
from farpoint.errors import InputError
from farpoint.fusion import read_euroc_imu
from farpoint.sinks.motions import read_motions
from farpoint.trajectory.files import Trajectory, read_trajectory, write_kitti, write_tum
from fuzz import fuzz_count, mutant

MOTIONS = (
    "timestamp0,timestamp1,frame0,frame1,status,qx,qy,qz,qw,dx,dy,dz,scale,scale_sigma,tracks,far,"
    "near,outliers,noise_px,"
    + ",".join(f"cov_{i}{j}" for i in range(5) for j in range(i, 5))
    + "\n"
    + "0.0,0.1,0,1,OK,0,0,0,1,0,0,1,1.0,0.1,90,40,40,10,0.2,"
    + ",".join("1e-6" if i == j else "0" for i in range(5) for j in range(i, 5))
    + "\n"
) * 1
KINDS = ("tum", "kitti", "euroc", "motions", "speeds", "degrees", "metres", "imu")


def samples(tmp_path: Path) -> dict[str, tuple[str, Callable[[Path], object]]]:
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[:, 2, 3] = np.arange(6)
    path = tmp_path / "sample"
    trajectory = Trajectory(timestamps=np.arange(6) / 10, world_from_body=poses)
    write_tum(path, trajectory)
    tum = path.read_text()
    write_kitti(path, trajectory)
    euroc = "#timestamp [ns],p_x,p_y,p_z,q_w,q_x,q_y,q_z\n" + "".join(
        f"{1403636579763555584 + k},0,0,{k},1,0,0,0\n" for k in range(6)
    )
    return {
        "tum": (tum, read_trajectory),
        "kitti": (path.read_text(), read_trajectory),
        "euroc": (euroc, read_trajectory),
        "motions": (MOTIONS, read_motions),
        "speeds": (
            "rpm,timestamp,speed\n" + "".join(f"7,{k / 10},{k}.5\n" for k in range(6)),
            lambda path: MetricOptions(speed=path).measurements(),
        ),
        "degrees": (
            "timestamp,latitude,longitude,altitude\n"
            + "".join(f"{k / 10},48.{k},11.{k},500.0\n" for k in range(6)),
            lambda path: MetricOptions(gnss=path).measurements(),
        ),
        "metres": (
            "timestamp,x,y,z\n" + "".join(f"{k / 10},{k}.5,1,2\n" for k in range(6)),
            lambda path: MetricOptions(gnss=path).measurements(),
        ),
        "imu": (
            "#timestamp [ns],w_x,w_y,w_z,a_x,a_y,a_z\n"
            + "".join(f"{1403636579763555584 + 5 * k},0.1,0,0,0,9.8,{k}\n" for k in range(6)),
            read_euroc_imu,
        ),
    }


@pytest.mark.parametrize("kind", KINDS)
def test_mutants_are_read_or_refused_in_one_line(tmp_path: Path, kind: str):
    rng = random.Random(kind)
    sample, read = samples(tmp_path)[kind]
    read_from(tmp_path / "whole", sample.encode(), read)
    for _ in range(fuzz_count(60)):
        data = mutant(sample, rng)
        said = read_from(tmp_path / "mutant", data, read)
        assert said.isprintable(), data
        assert said == "read" or "mutant" in said, data


def read_from(path: Path, data: bytes, read: Callable[[Path], object]) -> str:
    path.write_bytes(data)
    try:
        read(path)
    except InputError as error:
        return str(error)
    return "read"
