"""`replay` over an archive on one machine: the outputs of single replays, also if a process or a recording fails."""

import os
import shutil
import sys
from pathlib import Path

import pytest

pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")

from archives import outcomes, replayed, write_archive  # noqa: E402
from recordings import contents, write_recording  # noqa: E402

from lassokin_ros.archive.archive import tasks_of  # noqa: E402
from lassokin_ros.archive.runners import on_cluster  # noqa: E402
from lassokin_ros.archive.tasks import ArchiveError  # noqa: E402
from lassokin_ros.archive.tasks import _made as made_of  # noqa: E402
from lassokin_ros.cli.replay import (
    main,  # noqa: E402
    parser,  # noqa: E402
)
from lassokin_ros.pipeline.parameter_files import offline_settings  # noqa: E402
from lassokin_ros.replay.record import origin_of, record_of  # noqa: E402

BAGS = {"day1/walk": 30, "day1/wave": 20, "squat.v2": 25}


pytestmark = pytest.mark.usefixtures("tasks_here")


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    return write_archive(tmp_path_factory.mktemp("archive") / "bags")


@pytest.fixture(scope="module")
def one_by_one(archive, tmp_path_factory):
    folder = tmp_path_factory.mktemp("one_by_one")
    for name in BAGS:
        output = folder / f"{name}_tracked"
        output.parent.mkdir(exist_ok=True)
        assert main([str(archive / name), "--output", str(output)]) == 0
    return folder


def test_an_archive_gives_the_bytes_of_single_replays(archive, one_by_one, tmp_path, capsys):
    code, said = replayed(capsys, archive, "--output", tmp_path / "new" / "out")
    assert code == 2
    results = outcomes(said)
    assert {name: results.pop(name) for name in BAGS} == dict.fromkeys(BAGS, "tracked")
    assert list(results) == ["torn"] and "torn.mcap cannot be read as a rosbag2 recording" in results["torn"]
    assert said.endswith("4 recordings: 3 tracked, 0 done before, 1 failed\n")
    for name, frames in BAGS.items():
        (line,) = [line.split() for line in said.splitlines() if line.startswith(name)]
        assert line[1:4] == [str(frames), str(frames), "0"] and 1 < float(line[4]) < 6 and float(line[5]) > 0
    assert contents(tmp_path / "new" / "out") == contents(one_by_one)


def test_finished_recordings_are_not_replayed_again(archive, one_by_one, tmp_path, capsys):
    arguments = [archive / "day1", archive / "squat.v2", "--output", tmp_path, "--jobs", 1]
    assert replayed(capsys, *arguments)[0] == 0
    done = contents(tmp_path)
    written = {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*") if file.is_file()}
    shutil.rmtree(tmp_path / "wave_tracked")
    code, said = replayed(capsys, *arguments)
    assert code == 0
    assert outcomes(said) == {"walk": "done before", "wave": "tracked", "squat.v2": "done before"}
    assert contents(tmp_path) == done
    again = {file for file, time in written.items() if file.stat().st_mtime_ns != time}
    assert {file.parent.name for file in again} == {"wave_tracked"}
    for row in ("walk   ", "wave   "):
        (line,) = [line.split() for line in said.splitlines() if line.startswith(row)]
        assert line[1] == line[2] == str(BAGS[f"day1/{row.strip()}"])


def test_an_output_of_other_settings_or_input_does_not_count_as_finished(tmp_path, capsys):
    (tmp_path / "in").mkdir()
    write_recording(tmp_path / "in" / "a", 12)
    arguments = [tmp_path / "in", "--output", tmp_path / "out", "--jobs", 1]
    assert replayed(capsys, *arguments)[0] == 0
    before = contents(tmp_path / "out")
    file = tmp_path / "same.yaml"
    file.write_text("tracker:\n  ros__parameters:\n    height: 0.0\n")
    assert outcomes(replayed(capsys, *arguments, "--params-file", file)[1]) == {"a": "done before"}
    code, said = replayed(capsys, *arguments, "-p", "height:=1.9")
    assert code == 2 and "exists, from another input, version or settings; add --force" in outcomes(said)["a"]
    assert contents(tmp_path / "out") == before
    recording = next((tmp_path / "in" / "a").glob("*.mcap"))
    recording.write_bytes(write_recording(tmp_path / "other", 13).joinpath("recording.mcap").read_bytes())
    assert replayed(capsys, *arguments)[0] == 2
    code, said = replayed(capsys, *arguments, "--force")
    assert code == 0 and contents(tmp_path / "out") != before
    assert record_of(tmp_path / "out" / "a_tracked").figures.frames_in == 13


def test_exports_and_reports_are_written_per_recording(archive, one_by_one, tmp_path, capsys):
    arguments = [archive / "day1", "--output", tmp_path / "out", "--jobs", 1]
    assert replayed(capsys, *arguments)[0] == 0
    arguments += ["--export", ".csv", "--export", ".amass.npz", "--report", tmp_path / "pages"]
    for outcome in ("tracked", "done before"):
        code, said = replayed(capsys, *arguments)
        assert code == 0 and outcomes(said) == {"walk": outcome, "wave": outcome}
    for name in ("walk", "wave"):
        there = contents(tmp_path / "out" / f"{name}_tracked")
        assert len((there.pop("motion.csv")).splitlines()) == BAGS[f"day1/{name}"] + 1
        assert there.pop("motion.amass.npz").startswith(b"PK")
        assert there == contents(one_by_one / "day1" / f"{name}_tracked")
        assert (tmp_path / "pages" / f"{name}.html").read_text().startswith("<!")
    code, said = replayed(capsys, *arguments[:-6], "--export", ".npz")
    assert code == 0 and outcomes(said) == {"walk": "tracked", "wave": "tracked"}
    kept = {"motion.csv", "motion.npz", "motion.amass.npz", "metadata.yaml"}
    assert kept < set(contents(tmp_path / "out" / "walk_tracked"))


def test_files_outside_the_output_are_replaced_with_force_alone(tmp_path, capsys):
    (tmp_path / "in").mkdir()
    write_recording(tmp_path / "in" / "walk", 40)
    page, skeleton = tmp_path / "pages" / "walk.html", tmp_path / "lengths" / "walk.yaml"
    arguments = [tmp_path / "in", "--output", tmp_path / "out", "--jobs", 1, "-p", "calibrate:=true"]
    arguments += ["--report", page.parent, "--save-skeleton", skeleton.parent]
    assert replayed(capsys, *arguments)[0] == 0
    page.write_text("own words")
    skeleton.write_text("own lengths")
    code, said = replayed(capsys, *arguments, "--export", ".csv")
    assert code == 0 and outcomes(said) == {"walk": "tracked"}
    assert (tmp_path / "out" / "walk_tracked" / "motion.csv").exists()
    assert page.read_text() == "own words" and skeleton.read_text() == "own lengths"
    page.unlink()
    assert replayed(capsys, *arguments)[0] == 0
    assert page.read_text().startswith("<!") and skeleton.read_text() == "own lengths"
    assert replayed(capsys, *arguments, "--force")[0] == 0
    assert skeleton.read_text().startswith("# Calibrated")


def tasks(*arguments):
    """The tasks of a command by their names."""
    return {task.name: task for task in tasks_of(parser().parse_args(list(map(str, arguments))))}


def test_the_files_of_another_recording_do_not_count(tmp_path):
    """The names look as if one recording were a person of the other one. A dot in a name does not hide a file."""
    for name in ("walk", "walk_p2", "walk.v2"):
        (tmp_path / "bags" / name).mkdir(parents=True)
        (tmp_path / "bags" / name / "metadata.yaml").touch()
    wanted = ["--output", tmp_path / "out", "--report", tmp_path / "pages", "--save-skeleton", tmp_path / "lengths"]
    found = tasks(tmp_path / "bags", *wanted, "-p", "max_people:=2", "--export", ".csv")
    for file in ("pages/walk_p2.html", "pages/walk.v2.html", "lengths/walk_p2_p1.yaml", "lengths/walk.v2_p1.yaml"):
        (tmp_path / file).touch()
    made = {name: [*made_of(task.options).values()] for name, task in found.items()}
    assert made == {"walk": [False] * 3, "walk.v2": [True, True, False], "walk_p2": [True, True, False]}


def test_links_to_folders_elsewhere_are_followed_once(tmp_path):
    """Dots are part of the name of a folder."""
    for folder in ("disk/day/far.1", "bags/near", "bags/near.2"):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "metadata.yaml").touch()
    links = {"a_link": tmp_path / "disk", "b_again": tmp_path / "disk", "near_link": tmp_path / "bags" / "near"}
    links |= {"loop": tmp_path / "bags", "up": tmp_path}
    for name, target in links.items():
        (tmp_path / "bags" / name).symlink_to(target)
    found = tasks(tmp_path / "bags", "--output", tmp_path / "out")
    assert set(found) == {"near", "near.2", "a_link/day/far.1"}
    assert found["near.2"].options.output == tmp_path / "out" / "near.2_tracked"
    (tmp_path / "one.1.mcap").touch()
    assert list(tasks(tmp_path / "one.1.mcap", "--output", tmp_path / "b")) == ["one.1"]


def test_a_page_that_is_requested_later_is_written_also_if_nobody_was_tracked(tmp_path, capsys):
    (tmp_path / "bags").mkdir()
    write_recording(tmp_path / "bags" / "few", 4)
    arguments = [tmp_path / "bags", "--output", tmp_path / "out", "--jobs", 1, "-p", "min_confidence:=1.0"]
    arguments += ["-p", "min_landmarks:=17", "--export", ".csv"]
    page = ["--report", tmp_path / "pages"]
    for more, outcome in (([], "tracked"), ([], "done before"), (page, "tracked"), (page, "done before")):
        assert outcomes(replayed(capsys, *arguments, *more)[1]) == {"few": outcome}
    assert record_of(tmp_path / "out" / "few_tracked").figures.frames_out == 0
    assert (tmp_path / "pages" / "few.html").exists()


def test_another_body_in_a_file_of_the_home_folder_is_another_setting(tmp_path, monkeypatch):
    write_recording(tmp_path / "walk", frames=2)
    monkeypatch.setenv("HOME", str(tmp_path))
    body = tmp_path / "body.yaml"
    options = parser().parse_args([str(tmp_path / "walk"), "--scheduler", "x", "-p", "skeleton:=~/body.yaml"])
    origins = []
    for text in ("one", "other"):
        body.write_text(text, encoding="utf-8")
        (task,) = tasks_of(options)
        options.bag = options.bags[0]
        origins += [origin_of(task.options), origin_of(options)]
    assert origins[0] == origins[1] != origins[2] == origins[3]


def test_workers_get_the_full_paths_of_skeleton_and_landmarks(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_recording(tmp_path / "walk", 5)
    for name in ("my body.yaml", "points.yaml"):
        Path(name).write_text("")
    Path("settings.yaml").write_text("tracker: {ros__parameters: {landmarks: points.yaml}}")
    given = ["walk", "--scheduler", "x", "-p", "skeleton:=my body.yaml", "--params-file", "settings.yaml"]
    (task,) = tasks_of(parser().parse_args(given))
    settings, _ = offline_settings(task.options.params_file, task.options.p)
    assert settings.skeleton == str(tmp_path / "my body.yaml") and settings.landmarks == str(tmp_path / "points.yaml")


def test_outputs_in_the_archive_are_not_replayed(tmp_path, capsys, monkeypatch):
    write_recording(tmp_path / "a", 12)
    monkeypatch.chdir(tmp_path)
    for outcome in ("tracked", "done before"):
        code, said = replayed(capsys, ".", "--jobs", 1)
        assert code == 0 and outcomes(said) == {"a": outcome}
    assert sorted(os.listdir()) == ["a", "a_tracked"]


@pytest.mark.parametrize(
    "arguments, expected",
    [
        (["x/a", "y/a"], "would both be written to"),
        (["x", "y/a", "-o", "x/a"], "cannot hold several outputs"),
        (["x", "--export", "all.csv"], "names one file for many recordings; give the suffix alone"),
        (
            ["x", "--save-skeleton", "x.yaml", "-p", "calibrate:=true"],
            "names one file for many recordings; name a folder",
        ),
        (["x", "-p", "hight:=2"], "there is no parameter 'hight'; did you mean 'height'?"),
    ],
)
def test_errors_that_concern_all_recordings_are_reported_first(tmp_path, monkeypatch, capsys, arguments, expected):
    monkeypatch.chdir(tmp_path)
    for folder in ("x", "y"):
        Path(folder).mkdir()
        write_recording(Path(folder) / "a", 3)
    assert main(arguments) == 2
    said = capsys.readouterr()
    assert said.out == "" and said.err.count("\n") == 1 and expected in said.err
    assert sorted(os.listdir()) == ["x", "y"] and os.listdir("x") == ["a"]


def test_a_cluster_without_dask_names_the_extra_of_the_repository(monkeypatch):
    """The package is not on PyPI."""
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ArchiveError, match=r"needs dask.distributed; install it with: pip install '\.\[cluster\]'$"):
        on_cluster("tcp://127.0.0.1:1")
