"""The parts of a fleet: lists, keys, folders, tables."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

import pytest
from cli_kit import CommandLine, assert_refused

from farpoint.cli.fleet import Fleet
from farpoint.cli.lens import LensOptions
from farpoint.errors import InputError
from farpoint.fleet import ListedDrive, list_drives
from farpoint.fleet.folder import clear_unfinished, facts_of, finish_folder, is_finished
from farpoint.fleet.page import outliers_first, write_page
from farpoint.fleet.table import Row, write_tables
from farpoint.fleet.work import Work, do_drive


@pytest.fixture
def farpoint(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> CommandLine:
    return CommandLine(monkeypatch, capsys)


def fleet(**options: object) -> Fleet:
    return Fleet(sources=("x",), lens=LensOptions(fov=70.0), **options)  # type: ignore[arg-type]


def test_a_pattern_names_a_drive_with_each_match(tmp_path: Path):
    for name in ("a10.mp4", "a2.mp4"):
        (tmp_path / name).touch()
    found = [Path(drive.source).name for drive in list_drives([f"{tmp_path}/*.mp4"])]
    assert found == ["a2.mp4", "a10.mp4"]


def test_a_table_gives_each_drive_its_options(tmp_path: Path):
    (tmp_path / "a.mp4").touch()
    (tmp_path / "c.yaml").touch()
    table = tmp_path / "drives.csv"
    table.write_text("source,camera,seed\na.mp4,c.yaml,4\n\ns3://b/x.mp4,,\n")
    first, second = list_drives([str(table)])
    assert first.source == str(tmp_path / "a.mp4")
    assert first.options == {"camera": str(tmp_path / "c.yaml"), "seed": "4"}
    assert second == ListedDrive(source="s3://b/x.mp4", place=f"{table}: line 4")


def test_lines_name_a_source_and_a_camera(tmp_path: Path):
    lines = tmp_path / "drives.txt"
    lines.write_text("# night\nx.mp4 'my cam.yaml'\ny.mp4\nx.mp4 'my cam.yaml'\n")
    found = [(drive.source, drive.options) for drive in list_drives([str(lines)])]
    assert found == [("x.mp4", {"camera": "my cam.yaml"}), ("y.mp4", {})]


@pytest.mark.parametrize(
    ("name", "text", "problem"),
    [
        ("a.csv", "camera\nc.yaml\n", "line 1: missing: expected the column source"),
        ("a.csv", "source,camera\nx\n", "line 2: expected 2 columns, got 1"),
        ("a.csv", "source,camera\n,c\n", "line 2: names no source"),
        ("a.txt", "a b c\n", "line 1: expected a source and a calibration"),
        ("a.txt", "", "names no drive"),
    ],
)
def test_a_list_that_cannot_be_used_is_named(tmp_path: Path, name: str, text: str, problem: str):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=problem):
        list_drives([str(tmp_path / name)])


def test_options_of_a_table_are_those_of_a_run():
    listed = ListedDrive(
        source="x", options={"seed": "4", "overlay": "false", "pose.refine": "false"}, place="t: 2"
    )
    options = fleet()._drive(listed).options
    assert options.odometry.seed == 4
    assert not options.output.overlay
    assert not options.odometry.pose.refine
    assert options.lens.fov == 70.0
    for wrong in ({"sede": "4"}, {"seed": "four"}, {"out": "x"}):
        with pytest.raises(InputError, match="t: 2"):
            fleet()._drive(dataclasses.replace(listed, options=wrong))


def test_a_drive_is_recognised_by_inputs_options_and_version(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    source = tmp_path / "shots"
    source.mkdir()
    (source / "0.png").write_bytes(b"1")
    (tmp_path / "m.png").write_bytes(b"1")
    listed = ListedDrive(source=str(source))

    def key(**options: object) -> str:
        return fleet(mask=tmp_path / "m.png", **options)._drive(listed).key()

    keys = [key()]
    assert key() == keys[0]
    assert key(out=Path("elsewhere")) == keys[0]
    keys.append(key(fps=20.0))
    os.utime(source / "0.png", ns=(1, 1))
    keys.append(key())
    (source / "1.png").write_bytes(b"1")
    keys.append(key())
    (tmp_path / "m.png").write_bytes(b"12")
    keys.append(key())
    monkeypatch.setattr("farpoint.__version__", "99")
    keys.append(key())
    assert len(set(keys)) == 6


def test_the_name_of_a_folder_depends_on_its_drive_alone():
    names = {
        fleet()._drive(listed).name
        for listed in (
            ListedDrive(source="a/shots"),
            ListedDrive(source="b/shots"),
            ListedDrive(source="a/shots", options={"seed": "2"}),
        )
    }
    assert len(names) == 3
    assert all(name.startswith("shots-") for name in names)


def test_a_folder_is_complete_or_not_there(tmp_path: Path):
    folder = tmp_path / "drives" / "a"

    def fill(part: Path, text: str = "1") -> dict[str, str]:
        assert not is_finished(folder, "new")
        part.mkdir()
        (part / "motions.csv").write_text(text)
        return {"worst": text}

    def fail(part: Path) -> dict[str, str]:
        fill(part)
        raise InputError("no")

    with pytest.raises(InputError):
        finish_folder(folder, "key", fail)
    assert list(folder.parent.iterdir()) == []
    finish_folder(folder, "key", fill)
    assert is_finished(folder, "key")
    finish_folder(folder, "key", lambda part: fill(part, "2"))  # another worker was faster
    assert (folder / "motions.csv").read_text() == "1"
    finish_folder(folder, "new", lambda part: fill(part, "3"))
    assert (folder / "motions.csv").read_text() == "3"
    assert facts_of(folder) == {"worst": "3"}
    assert facts_of(tmp_path) == {}
    (folder.parent / ".unfinished-12345678-b").mkdir()
    clear_unfinished(folder.parent)
    assert list(folder.parent.iterdir()) == [folder]


def test_a_worker_does_not_run_what_is_finished(tmp_path: Path):
    drive = fleet()._drive(ListedDrive(source=str(tmp_path / "missing")))
    work = Work(drive=drive, folder=tmp_path / "drives" / "a", key="k")
    assert do_drive(work) == f"{tmp_path}/missing: no such file or folder"
    finish_folder(work.folder, "k", lambda part: part.mkdir() or {})
    assert do_drive(work) is None


ROWS = [
    Row(drive="good", source="g", camera="", state="done", ok=9, halves=1.0, halves_high=1.5),
    Row(drive="odd", source="o", camera="", state="done", ok=9, halves=9.0, halves_high=1.5),
    Row(drive="lost", source="l", camera="", state="failed", error="<no> image"),
]


def test_the_page_has_outliers_first_and_links(tmp_path: Path):
    assert [row.drive for row in outliers_first(ROWS)] == ["lost", "odd", "good"]
    (tmp_path / "drives" / "odd").mkdir(parents=True)
    (tmp_path / "drives" / "odd" / "report.html").touch()
    write_page(tmp_path, ROWS)
    page = (tmp_path / "fleet.html").read_text()
    assert 'href="drives/odd/report.html"' in page
    assert "drives/good/report.html" not in page
    assert "&lt;no&gt; image" in page
    assert '<tr class="doubtful"><td><a' in page
    assert "http" not in page


def test_the_table_is_written_as_parquet_too(tmp_path: Path):
    parquet = pytest.importorskip("pyarrow.parquet")
    write_tables(tmp_path, ROWS, parquet=True)
    found = parquet.read_table(tmp_path / "fleet.parquet").to_pylist()
    assert found == [dataclasses.asdict(row) for row in ROWS]


@pytest.mark.parametrize("library", ["dask", "distributed"])
def test_without_dask_the_extra_is_named(
    farpoint: CommandLine, monkeypatch: pytest.MonkeyPatch, library: str
):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: name != library or None)
    assert_refused(farpoint("fleet", "x", "--fov", "70"), library, "farpoint[dask]")


def test_workers_or_a_scheduler(farpoint: CommandLine, tmp_path: Path):
    outcome = farpoint("fleet", tmp_path, "--workers", "0")
    assert_refused(outcome, "workers", "expected 1 or more")
    outcome = farpoint("fleet", tmp_path, "--workers", "1", "--scheduler", "tcp://127.0.0.1:1")
    assert_refused(outcome, "--workers or --scheduler")
