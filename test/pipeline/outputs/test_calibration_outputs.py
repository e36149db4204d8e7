"""Calibrated lengths in the URDF, the diagnostics and a file, live and in a replay."""

import os
from dataclasses import replace

import numpy as np
import pytest
from cases import body
from description_check import DescribedBody

from lassokin_ros.core.body.proportions import Proportions
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import SkeletonError
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.learned.bone_lengths import UPDATE, Calibration
from lassokin_ros.pipeline.outputs.saved_files import save_all, skeleton_text, write_text

NOW_NS = 1_700_000_000_123_456_789
PROMISE_M = 1e-3
ANKLES = [body().skeleton.index(f"{side}_ankle") for side in ("left", "right")]
APART = "left and right of the skeleton differ by 9.5 % on average"


def learned(seconds=5.0, seed=3):
    """A calibration with learned lengths."""
    kinematics = body()
    calibration = Calibration(FrameModel(kinematics, PoseDistribution.load(kinematics.skeleton)))
    calibration.lengths = np.random.default_rng(seed).normal(size=calibration.proportions.count) * 0.05
    calibration.kept_motion = seconds
    return calibration


def wrong_skeleton_file(folder, spread=0.08, seed=3):
    """The built-in skeleton with other proportions, as a file."""
    right = Skeleton.load("anthropometric", 1.75)
    proportions = Proportions(body())
    lengths = np.random.default_rng(seed).normal(size=proportions.count) * spread
    return write_text(folder / "wrong.yaml", skeleton_text(right.with_offsets(proportions.offsets(lengths))))


def uneven_skeleton_file(folder):
    """The built-in skeleton with longer left limbs, as a file."""
    right = Skeleton.load("anthropometric", 1.75)
    scales = [1.1 if name.startswith("left_") else 1.0 for name in right.joint_names]
    return write_text(folder / "uneven.yaml", skeleton_text(right.with_bone_scales(scales)))


# The file ------------------------------------------------------------------------------------------------------------


def test_a_saved_skeleton_is_loaded_again_with_its_lengths(tmp_path):
    calibration = learned()
    (path,) = save_all({"": calibration}, tmp_path / "new" / "me.yaml", NOW_NS)
    saved, known = Skeleton.load(str(path), 1.75), calibration.skeleton
    assert np.abs(saved.offsets - known.offsets).max() < 1e-15
    assert np.abs(saved.offsets - Skeleton.load("anthropometric", 1.75).offsets).max() > 0.01
    assert (saved.name, saved.joint_names, saved.axes) == (known.name, known.joint_names, known.axes)
    assert saved.parents.tolist() == known.parents.tolist()
    comments = "".join(line for line in path.read_text().splitlines(True) if line.startswith("#"))
    assert "2023-11-14 22:13:20 UTC" in comments and "height of 1.75 m" in comments and "5 s of motion" in comments
    assert "still being learned" in comments and "thigh" in comments
    assert [file.name for file in path.parent.iterdir()] == ["me.yaml"]


def test_a_name_in_any_script_and_with_special_characters_is_read_back(tmp_path):
    """JSON writes a character beyond 16 bits as two halves."""
    skeleton = replace(Skeleton.load("anthropometric", 1.75), name='a"\njoints: [] J\u00f6 \U0001f9cd')
    path = write_text(tmp_path / "me.yaml", skeleton_text(skeleton))
    assert Skeleton.load(str(path), 1.75).name == skeleton.name
    path.write_text(path.read_text().replace("\\uddcd", ""))
    with pytest.raises(SkeletonError, match="me.yaml is no valid YAML"):
        Skeleton.load(str(path), 1.75)


def test_each_calibrated_person_has_a_file(tmp_path):
    people = {"p1": learned(), "p4": learned(0.0), "p9": learned(seed=4)}
    written = save_all(people, tmp_path / "they.yaml", NOW_NS)
    assert [path.name for path in written] == ["they_p1.yaml", "they_p9.yaml"]
    loaded = [Skeleton.load(str(path), 1.75).offsets for path in written]
    assert np.abs(loaded[0] - loaded[1]).max() > 0.005


@pytest.mark.parametrize("people", [{}, {"": 0.0}, {"p1": 0.5, "p2": 0.0}], ids=["nobody", "one", "two"])
def test_saving_without_calibration_is_refused(tmp_path, people):
    with pytest.raises(SkeletonError, match="nothing has been calibrated"):
        save_all({person: learned(moved) for person, moved in people.items()}, tmp_path / "me.yaml", NOW_NS)
    assert not list(tmp_path.iterdir())


def test_an_unwritable_file_is_refused_and_the_old_one_is_kept(tmp_path, monkeypatch):
    calibration, old = learned(), tmp_path / "me.yaml"
    old.write_text("old")
    (tmp_path / "folder").mkdir()
    for path in (old / "below_a_file.yaml", tmp_path / "folder", type(old)("")):
        with pytest.raises(SkeletonError, match="cannot be written|is a folder"):
            save_all({"": calibration}, path, NOW_NS)

    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(SkeletonError, match="No space left"):
        save_all({"": calibration}, old, NOW_NS)
    assert old.read_text() == "old" and sorted(os.listdir(tmp_path)) == ["folder", "me.yaml"]


def test_a_tilde_is_the_home_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    (path,) = save_all({"": learned()}, type(tmp_path)("~/.ros/me.yaml"), NOW_NS)
    assert path == tmp_path / ".ros" / "me.yaml" and path.is_file()


# The URDF ------------------------------------------------------------------------------------------------------------


def test_the_joints_of_a_replay_agree_with_the_newest_urdf(tmp_path):
    pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")
    from recordings import RATE, read, write_recording

    from lassokin_ros.cli.replay import main

    frames = 240
    recording = write_recording(tmp_path / "walk", frames)
    settings = ["-p", f"skeleton:={wrong_skeleton_file(tmp_path)}", "-p", "calibrate:=true"]
    assert main([str(recording), "-o", str(tmp_path / "once"), *settings]) == 0
    names = "robot_description", "joint_states", "joints"
    streams = {topic: read(tmp_path / "once", f"/tracker/{topic}") for topic in names}
    descriptions = [(time_ns, DescribedBody(m.data)) for time_ns, m in streams["robot_description"]]
    assert 4 < len(descriptions) <= 8 + frames / RATE
    apart = np.diff([time_ns for time_ns, _ in descriptions])  # often at first, then once per second
    assert apart.min() > 0.9e9 * UPDATE[0] and apart[-2:].min() > 0.9e9 * UPDATE[-1]
    errors, first = [], descriptions[0][1]
    for (time_ns, state), (_, joints) in zip(streams["joint_states"], streams["joints"]):
        newest = [d for published, d in descriptions if published <= time_ns][-1]
        errors.append((newest.error(state, joints), first.error(state, joints)))
    assert len(errors) > 0.95 * frames
    assert max(error for error, _ in errors) < PROMISE_M
    assert errors[-1][1] > 5 * PROMISE_M  # the lengths have changed by much more


def test_replay_saves_the_learned_skeleton(tmp_path, capsys):
    pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")
    from recordings import read, write_recording

    from lassokin_ros.cli.replay import main
    from lassokin_ros.pipeline.outputs.urdf import urdf

    # The end is between two updates: the lengths learned from the last frame are saved, but not published.
    recording, saved = write_recording(tmp_path / "walk", 140), tmp_path / "me.yaml"
    wrong = wrong_skeleton_file(tmp_path)
    given = [str(recording), "--save-skeleton", str(saved), "-p", f"skeleton:={wrong}", "--force"]
    assert main([*given, "-p", "calibrate:=false", "-o", str(tmp_path / "out")]) == 2
    assert "calibrate:=true" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    calibrated = [*given, "-p", "calibrate:=true", "-o", str(tmp_path / "out")]
    assert main(calibrated) == 0
    assert capsys.readouterr().out.splitlines()[-1].split() == ["skeleton", str(saved)]
    text = saved.read_text()
    assert "2023-11-14 22:13:24 UTC" in text  # the recording's time
    last = read(tmp_path / "out", "/tracker/robot_description")[-1][1].data
    states, joints = (read(tmp_path / "out", topic)[-1][1] for topic in ("/tracker/joint_states", "/tracker/joints"))
    described = DescribedBody(urdf(Skeleton.load(str(saved), 1.75), "camera_optical_frame"))
    assert described.error(states, joints) < PROMISE_M and DescribedBody(last).error(states, joints) < PROMISE_M
    short = write_recording(tmp_path / "short", 15)
    brief = [str(short), *calibrated[1:], "-o", str(tmp_path / "brief"), "--report", str(tmp_path / "brief.html")]
    assert main([*brief, "--export", str(tmp_path / "brief.csv")]) == 2
    assert "nothing has been calibrated" in capsys.readouterr().err and saved.read_text() == text
    assert not list(tmp_path.glob("*brief*"))  # nor the recording
    assert main([str(short), *calibrated]) == 2 and "recording" in capsys.readouterr().err


UNFIT = {
    "there": (["me.yaml"], "'me.yaml' exists already; choose another name or add --force"),
    "somebody's": (["they.yaml", "-p", "max_people:=2"], "'they_p4.yaml' exists already; choose another name or add"),
    "a folder": (["folder.yml", "--force"], "'folder.yml' is a folder; expected the name of a file"),
}


@pytest.mark.parametrize("case", sorted(UNFIT))
def test_an_invalid_skeleton_path_is_reported_before_processing(tmp_path, monkeypatch, capsys, case):
    pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")
    from recordings import write_recording

    from lassokin_ros.cli.replay import main

    arguments, expected = UNFIT[case]
    monkeypatch.chdir(tmp_path)
    write_recording(tmp_path / "walk", 3)
    (tmp_path / "folder.yml").mkdir()
    for name in ("me.yaml", "they_p4.yaml", "they_pose.yaml"):
        (tmp_path / name).write_text("mine")
    before = sorted(os.listdir())
    assert main(["walk", "--save-skeleton", *arguments]) == 2
    assert capsys.readouterr().err.startswith(f"lassokin replay: {expected}")
    assert sorted(os.listdir()) == before and (tmp_path / "me.yaml").read_text() == "mine"


def test_replay_reports_that_it_averaged_an_asymmetric_skeleton(tmp_path, capsys):
    pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")
    from recordings import read, write_recording

    from lassokin_ros.cli.replay import main

    given = [str(write_recording(tmp_path / "walk", 10)), "--force", "-o", str(tmp_path / "out")]
    given += ["-p", f"skeleton:={uneven_skeleton_file(tmp_path)}"]
    for calibrate in (True, False):
        assert main([*given, "-p", f"calibrate:={str(calibrate).lower()}"]) == 0
        assert (APART in capsys.readouterr().out) == calibrate
        poses = [pose.position for pose in read(tmp_path / "out", "/tracker/joints")[-1][1].poses]
        places = np.array([[p.x, p.y, p.z] for p in poses])
        shanks = np.linalg.norm(places[body().skeleton.parents[ANKLES]] - places[ANKLES], axis=1)
        assert shanks[0] / shanks[1] == pytest.approx(1.0 if calibrate else 1.1)


def test_the_running_node_publishes_saves_and_reports_learned_lengths(tmp_path):
    pytest.importorskip("rclpy")
    from live import NodeProcess, Peer, values_of
    from messages import FRAME, pixels_of_motion
    from std_srvs.srv import Trigger

    from lassokin_ros.pipeline.outputs import topics
    from lassokin_ros.pipeline.outputs.urdf import urdf

    namespace, saved = "/calibrating", tmp_path / ".ros" / "calibrating_tracker_skeleton.yaml"
    pixels = pixels_of_motion(200, 25.0)
    settings = {"skeleton": wrong_skeleton_file(tmp_path), "calibrate": "true"}
    options = [word for name, value in settings.items() for word in ("-p", f"{name}:={value}")]
    home = {**os.environ, "HOME": str(tmp_path)}
    with NodeProcess(namespace, *options, env=home) as node, Peer(namespace) as peer:
        peer.listen(topics.ROBOT_DESCRIPTION)
        states, joints = peer.got[topics.JOINT_STATES], peer.got[topics.JOINTS]
        texts = peer.got[topics.ROBOT_DESCRIPTION]
        peer.start(pixels[0])
        answer = peer.call(Trigger, "save_skeleton", Trigger.Request())
        assert not answer.success and "nothing has been calibrated" in answer.message and not saved.exists()
        peer.spin_until(lambda: texts and FRAME in texts[-1].data, what="the description in the camera's frame")
        states.clear(), joints.clear()
        del texts[:-1]
        for i, xy in enumerate(pixels):
            peer.send_camera()
            peer.send(peer.start_ns + i * 40_000_000, xy)
            peer.spin_until(lambda: min(len(states), len(joints)) > i, what="the answer")  # noqa: B023
        values = values_of(peer.next_diagnostics())
        assert values["calibration"] == "learning" and float(values["calibration: motion seen [s]"]) > 2
        assert any(abs(float(v)) > 1 for key, v in values.items() if key.startswith("calibration: ") and "%" in key)
        assert 3 < len(texts) <= 16  # often at first, then once per second
        bodies, current = [DescribedBody(text.data) for text in texts], 0
        for state, poses in zip(states, joints):  # each fits a description, in their order
            fits = [k for k in range(current, len(bodies)) if bodies[k].error(state, poses) < PROMISE_M]
            assert fits, "no description reproduces this frame's joints"
            current = fits[0]
        assert fits[-1] == len(bodies) - 1  # two updates in short succession may be equally good
        answer = peer.call(Trigger, "save_skeleton", Trigger.Request())
        assert answer.success and str(saved) in answer.message
        peer.send(peer.start_ns + len(pixels) * 40_000_000, pixels[-1])  # tracked with the saved skeleton
        peer.spin_until(lambda: len(joints) == len(states) == len(pixels) + 1, what="the last answer")
        described = DescribedBody(urdf(Skeleton.load(str(saved), 1.75), FRAME))
        assert described.error(states[-1], joints[-1]) < 1e-6
        saved.unlink()
        saved.mkdir()
        answer = peer.call(Trigger, "save_skeleton", Trigger.Request())
        assert not answer.success and "is a folder" in answer.message
        peer.call(Trigger, "reset", Trigger.Request())
        answer = peer.call(Trigger, "save_skeleton", Trigger.Request())
        assert not answer.success and "nothing has been calibrated" in answer.message
    assert "Traceback" not in node.said
