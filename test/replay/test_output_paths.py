"""Output paths of `replay`: inputs are never overwritten, two outputs never have one path, other files are kept."""

from pathlib import Path

import pytest

pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")

from recordings import contents, write_recording  # noqa: E402

from lassokin_ros.cli.replay import main  # noqa: E402

SKELETON = ["-p", "calibrate:=true", "--save-skeleton"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The current folder: a recording `in`, an older output `out`, a link to the recording."""
    monkeypatch.chdir(tmp_path)
    write_recording(Path("in"), 3)
    write_recording(Path("out"), 3)
    Path("link").symlink_to("in")
    return tmp_path


OVER_THE_INPUT = {
    "itself": (["in", "-o", "in"], "the output 'in' is the input recording 'in'"),
    "by another name": (["in", "-o", "out/../in"], "the output 'out/../in' is the input recording 'in'"),
    "by a link": (["link", "-o", "in"], "the output 'in' is the input recording 'link'"),
    "around a file": (["in/recording.mcap", "-o", "in"], "the output 'in' contains the input recording "),
    "inside": (["in", "-o", "in/new"], "the output 'in/new' is inside the input recording 'in'"),
    "report": (["in", "--report", "in/recording.mcap"], "--report 'in/recording.mcap' is inside the input recording"),
    "report of a file": (
        ["in/recording.mcap", "--report", "link/recording.mcap"],
        "--report 'link/recording.mcap' is the input recording 'in/recording.mcap'",
    ),
    "export": (["in", "--export", ".csv", "--export", "in/a.csv"], "--export 'in/a.csv' is inside the input recording"),
    "skeleton": (["in", *SKELETON, "in/metadata.yaml"], "--save-skeleton 'in/metadata.yaml' is inside the input"),
}
ONE_PLACE = {
    "export and report": (
        ["in", "--export", "h.csv", "--report", "out/../h.csv"],
        "--report and --export both name 'h.csv'; choose another name for one of them",
    ),
    "report and skeleton": (["in", "--report", "h.yaml", *SKELETON, "h.yaml"], "--report and --save-skeleton both"),
    "output and report": (["in", "-o", "h", "--report", "h"], "the output and --report both name 'h'"),
    "within the output": (
        ["in", "-o", "out", "--export", "out/h.csv"],
        "--export 'out/h.csv' is inside the output 'out'; choose another path",
    ),
}
SETTINGS = {
    "parameters": (
        ["in", "--params-file", "p.yaml", *SKELETON, "link/../p.yaml"],
        "--save-skeleton 'link/../p.yaml' is",
    ),
    "lens": (["in", "--camera-info", "p.yaml:cam1", "--report", "p.yaml"], "--report 'p.yaml' is also --camera-info, "),
}
ARCHIVE = {
    "inside an input": (["in", "out", "-o", "in/new"], "the output '{}/in/new/in_tracked' is inside the input"),
    "another's input": (["in", "in_tracked"], "the output '{}/in_tracked' is the input recording '{}/in_tr"),
    "pages": (["in", "out", "-o", "new", "--report", "in"], "--report '{}/in/in.html' is inside the input recording"),
}
EVERY = {**OVER_THE_INPUT, **ONE_PLACE, **SETTINGS, **ARCHIVE}


@pytest.mark.parametrize("case", sorted(EVERY))
def test_an_output_path_that_collides_is_refused_with_force_too(folder, capsys, case):
    arguments, expected = EVERY[case]
    if case == "another's input":  # without --force, only that recording is refused, as always
        write_recording(Path("in_tracked"), 3)
    Path("p.yaml").write_text("{}", encoding="utf-8")
    before, entries = contents(folder), sorted(folder.rglob("*"))
    for more in ([], ["--force"])[case == "another's input" :]:
        assert main([*arguments, *more]) == 2
        said = capsys.readouterr()
        assert said.err.startswith(f"lassokin replay: {expected.replace('{}', str(folder))}"), said.err
        assert said.err.count("\n") == 1 and said.out == ""
    assert contents(folder) == before and sorted(folder.rglob("*")) == entries


@pytest.mark.skipif(not Path("/sys").is_dir(), reason="nobody, not even root, can create a file in /sys of Linux")
@pytest.mark.parametrize("option", ["--export /sys/x.csv", "--report /sys/x.html"])
def test_a_place_without_room_for_a_file_is_refused_before_the_first_pass(folder, option, monkeypatch, capsys):
    monkeypatch.setattr("lassokin_ros.replay.replay.learn", None)
    entries = sorted(folder.rglob("*"))
    assert main(["in", "--two-pass", "-p", "calibrate:=true", *option.split()]) == 2
    assert capsys.readouterr().err.startswith(f"lassokin replay: '{option.split()[1]}' cannot be written: ")
    assert sorted(folder.rglob("*")) == entries


def test_paths_next_to_the_input_are_accepted(folder):
    """A file in the folder of a single-file recording, the same export twice, a folder with a similar name."""
    Path("in/recording.mcap").rename("walk.mcap")
    wanted = ["-o", "walk", "--export", "walk.csv", "--export", "walk.csv", "--report", "walk.html"]
    for more in ([], ["--force"]):
        assert main(["walk.mcap", *wanted, *more]) == 0
    assert {"walk.csv", "walk.html", "walk", "walk.mcap"} <= {file.name for file in folder.iterdir()}


def test_a_name_that_is_too_long_is_one_line(folder, capsys):
    assert main([300 * "x"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("lassokin replay: the name 'xxx") and said.endswith("x' is too long for a file\n")
