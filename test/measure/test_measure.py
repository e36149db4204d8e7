"""`lassokin measure`: walks and squats of known cadence, stride, speed and angles; and the command."""

import json
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from motions import NAMES, RATE, SHANK, THIGH, body, hidden, saved, squats, walk

from lassokin_ros.measure.command import main
from lassokin_ros.measure.exercises import measure_squats
from lassokin_ros.measure.gait import measure_gait
from lassokin_ros.measure.poses import MeasureError, Poses
from lassokin_ros.measure.report import as_json, gait_lines


@pytest.mark.parametrize("heading", [0.0, 1.2, np.pi])
def test_a_walk_has_its_cadence_stride_and_speed_whatever_its_direction(heading):
    found = measure_gait(walk(heading=heading))
    assert abs(found.cadence - 108) < 1.5 and abs(found.speed - 1.3) < 0.01
    assert abs(found.stride_s - 120 / 108) < 0.02 and abs(found.stride_m - 1.3 * 120 / 108) < 0.03
    assert 8 <= found.strides <= 10 and found.doubtful == 0
    assert abs(found.knee_range["left"] - 50) < 1 and abs(found.knee_range["right"] - 50) < 1
    assert found.knees["left"].shape[1] == 101 and found.knees["left"].max() <= 55.01
    left, right = found.strikes["left"], found.strikes["right"]
    assert np.allclose(np.diff(left), 120 / 108, atol=0.03) and np.allclose(np.diff(right), 120 / 108, atol=0.03)
    assert np.abs((right[0] - left[0]) % (120 / 108) - 60 / 108) < 0.05


@pytest.mark.parametrize("cadence", [60.0, 108.0, 160.0, 240.0, 276.0])
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_slow_walks_and_fast_runs_have_their_cadence(cadence, noise):
    poses = walk(cadence=cadence, seconds=8.0)
    shaken = poses.positions + noise * np.random.default_rng(0).normal(size=poses.positions.shape)
    found = measure_gait(replace(poses, positions=shaken))
    assert abs(found.cadence / cadence - 1) < 0.03 and abs(found.stride_s * cadence / 120 - 1) < 0.03


@pytest.mark.parametrize("gap_s", [0.3, 1.0, 1.2, 2.0])
def test_no_stride_goes_over_a_gap(gap_s):
    poses = walk(seconds=8.0)
    seen = (poses.seconds < 3.2) | (poses.seconds > 3.2 + gap_s)
    found = measure_gait(Poses(poses.seconds[seen], NAMES, poses.positions[seen], poses.likely_wrong[seen]))
    pairs = [pair for strikes in found.strikes.values() for pair in zip(strikes, strikes[1:])]
    assert found.strides == sum(not first < 3.2 < last for first, last in pairs) == len(pairs) - 2
    assert abs(found.cadence - 108) < 2 and abs(found.speed - 1.3) < 0.02


@pytest.mark.parametrize("gap_s, begin_s", [(0.5, 3.0), (0.8, 3.28), (2.0, 3.09)])
def test_a_foot_that_swings_while_frames_are_missing_does_not_strike_there(gap_s, begin_s):
    poses = walk(seconds=9.0)
    seen = (poses.seconds < begin_s) | (poses.seconds > begin_s + gap_s)
    found = measure_gait(Poses(poses.seconds[seen], NAMES, poses.positions[seen], poses.likely_wrong[seen]))
    for strikes in found.strikes.values():
        strides = strikes / (120 / 108)
        assert np.abs((strides - strides[0] + 0.5) % 1 - 0.5).max() < 0.05
    assert abs(found.cadence - 108) < 1


def test_on_a_treadmill_the_stride_has_a_time_and_no_length():
    found = measure_gait(walk(speed=0.0, cadence=120.0))
    assert found.stride_m < 0.01 and abs(found.cadence - 120) < 2


def test_one_knee_that_bends_less_is_seen():
    t = np.arange(300) / RATE
    phase = 2 * np.pi * 0.9 * t[:, None] + np.array([0.0, np.pi])
    knees = 5 + np.array([50.0, 20.0]) * (0.5 - 0.5 * np.cos(phase + 2.0))
    found = measure_gait(body(t, 24 * np.cos(phase), knees, 0.0, 1.2)).knee_range
    assert abs(found["left"] - 50) < 1 and abs(found["right"] - 20) < 1


def test_a_person_who_stands_or_shuffles_has_no_stride():
    for swing in (0.0, 3.0):
        with pytest.raises(MeasureError, match="no stride was found"):
            measure_gait(walk(swing=swing, knee=5.0))
    with pytest.raises(MeasureError, match="no joint 'left_ankle'"):
        measure_gait(replace(walk(), names=tuple(name.replace("left_ankle", "left_paw") for name in NAMES)))


def test_each_squat_has_its_depth_and_angles():
    found = measure_squats(squats())
    assert [round(one.knees[0]) for one in found] == [100, 60, 90] and all(abs(np.diff(one.knees)) < 1 for one in found)
    assert np.allclose([one.bottom for one in found], [1.5, 4.5, 7.5], atol=0.03)
    assert all(abs(one.end - one.start - 1.4) < 0.15 for one in found)
    assert np.allclose([one.lean for one in found], [40, 24, 36], atol=1)
    assert np.allclose([one.hips for one in found], [50 + 40, 30 + 24, 45 + 36], atol=2)  # against the trunk
    sink = (THIGH + SHANK) * (1 - np.cos(np.radians([50, 30, 45])))
    assert np.allclose([one.depth for one in found], sink, atol=0.005)


def test_a_squat_that_is_held_is_one_squat():
    t = np.arange(600) / RATE
    bend = np.zeros(len(t))
    for bottom in (3.0, 8.0):  # s; held for 2 s
        away = np.clip(np.abs(t - bottom) - 1.0, 0, 1)
        bend = np.maximum(bend, 90 * (0.5 + 0.5 * np.cos(np.pi * away)))
    bends = np.stack([bend, bend], axis=1)
    first, second = measure_squats(body(t, bends / 2, bends))
    assert first.end < 5.1 and second.start > 5.9 and abs(first.end - first.start - 3.6) < 0.1


def test_small_bends_are_no_squats_and_marked_frames_are_counted():
    with pytest.raises(MeasureError, match="no squat was found: the knees bend by less than 40 degrees"):
        measure_squats(squats((30.0, 25.0)))
    for joint in ("left_knee", "right_shoulder", "neck"):
        names = tuple(name.replace(joint, "other") for name in NAMES)
        with pytest.raises(MeasureError, match=f"the motion has no joint '{joint}'"):
            measure_squats(replace(squats(), names=names))
    poses = squats((90.0, 90.0))
    marked = poses.seconds > 3.0
    assert [round(one.doubtful) for one in measure_squats(replace(poses, likely_wrong=marked))] == [0, 1]


def test_the_command_prints_a_table_and_writes_plot_and_figures(tmp_path, capsys):
    file = saved(tmp_path / "walk.npz", ("", walk()), tilt=0.4)
    plot, figures = tmp_path / "gait.svg", tmp_path / "gait.json"
    assert main(["gait", file, "--plot", str(plot), "--json", str(figures)]) == 0
    said = capsys.readouterr().out
    assert "cadence         108 steps/min" in said and "speed           1.30 m/s" in said
    assert "knee range      left 50 deg, right 50 deg" in said and "likely wrong" not in said
    drawn = ElementTree.fromstring(plot.read_text(encoding="utf-8"))
    strides = json.loads(figures.read_text())["strides"]
    assert len(drawn.findall(".//{*}polyline")) == strides + 2
    assert main(["gait", file, "--plot", str(plot)]) == 2 and "exists already" in capsys.readouterr().err
    down = saved(tmp_path / "down.npz", ("", replace(squats(), likely_wrong=np.ones(450, dtype=bool))))
    assert main(["squat", down, "--plot", str(plot), "--json", str(figures), "--force"]) == 0
    said = capsys.readouterr().out.splitlines()
    assert len(said) == 5 and said[1].split()[:3] == ["1", "1.5", "s"] and "100 deg" in said[1]
    assert said[-1] == "100% of these frames are marked as likely wrong"
    assert len(json.loads(figures.read_text())) == 3
    assert len(ElementTree.fromstring(plot.read_text()).findall(".//{*}circle")) == 6


def test_no_file_replaces_the_motion_or_another_file(tmp_path, capsys):
    file, other = saved(tmp_path / "walk.npz", ("", walk())), str(tmp_path / "y")
    before = (tmp_path / "walk.npz").read_bytes()
    assert main(["gait", file, "--json", f"{tmp_path}/../{tmp_path.name}/walk.npz", "--force"]) == 2
    assert "walk.npz' is also the motion, which is read" in capsys.readouterr().err
    assert main(["gait", file, "--plot", other, "--json", other]) == 2
    assert "--plot and --json both name" in capsys.readouterr().err
    assert (tmp_path / "walk.npz").read_bytes() == before and len(list(tmp_path.iterdir())) == 1


def test_a_smoothed_motion_has_a_word_about_the_knees(tmp_path, capsys):
    file = saved(tmp_path / "walk.npz", ("", walk()))
    with np.load(file) as arrays:
        np.savez(tmp_path / "smooth.npz", **arrays, smoothing=np.array(0.03))
    assert main(["gait", str(tmp_path / "smooth.npz")]) == 0
    assert "the knee range is too small; for an unsmoothed one export it with" in capsys.readouterr().out
    assert main(["gait", file]) == 0 and "too small" not in capsys.readouterr().out


def test_what_one_foot_alone_cannot_tell_is_a_dash():
    gait = replace(measure_gait(walk()), cadence=np.nan, knee_range={"left": 51.0, "right": np.nan})
    lines = gait_lines(gait)
    assert "cadence         - steps/min" in lines and "knee range      left 51 deg, right - deg" in lines
    assert as_json(gait)["cadence"] is None


def test_one_person_of_several_is_measured(tmp_path, capsys):
    file = saved(tmp_path / "two.npz", ("p1", walk(cadence=90.0)), ("p2", walk(cadence=120.0)))
    assert main(["gait", file]) == 2 and "choose one with --person: p1, p2" in capsys.readouterr().err
    assert main(["gait", file, "--person", "p2"]) == 0 and "120 steps/min" in capsys.readouterr().out
    assert main(["gait", file, "--person", "p3"]) == 2 and "holds p1, p2" in capsys.readouterr().err
    late = replace(squats(), seconds=squats().seconds + 3.0)  # times count from the begin of the recording for all
    assert main(["squat", saved(tmp_path / "two.npz", ("p1", squats()), ("p2", late)), "--person", "p2"]) == 0
    assert capsys.readouterr().out.splitlines()[1].split()[:3] == ["1", "4.5", "s"]


def test_a_file_that_is_no_export_is_one_line(tmp_path, capsys):
    (tmp_path / "text.npz").write_text("no arrays")
    np.savez(tmp_path / "half.npz", joint_positions=np.zeros(3))
    np.save(tmp_path / "array.npy", np.zeros(3))
    short = saved(tmp_path / "short.npz", ("", walk(seconds=0.04)))
    twice = np.concatenate([walk(seconds=2.0).seconds] * 2)
    looped = saved(tmp_path / "looped.npz", ("", replace(walk(seconds=4.0), seconds=twice)))
    for file, text in (
        (tmp_path / "none.npz", "cannot be read"),
        (tmp_path / "text.npz", "is no .npz; expected one that --export wrote"),
        (tmp_path / "array.npy", "expected one that --export wrote"),
        (tmp_path / "half.npz", "has no stamp_ns, person"),
        (short, "has 2 frames; expected a recording of some seconds"),
        (looped, "jump back at frame 100, as in a looped recording"),
    ):
        assert main(["gait", str(file)]) == 2
        said = capsys.readouterr().err
        assert said.startswith("lassokin measure: ") and text in said and said.count("\n") == 1


def test_a_piece_has_the_observed_joints_of_its_frames():
    poses = hidden(walk(), "left_knee", seen=lambda seconds: seconds < 3.5)
    known = poses.seconds >= 3.0
    (piece,) = poses.pieces(known)
    assert np.array_equal(piece.observed, poses.observed[known]) and len(piece.shown("left")) == known.sum()


@pytest.mark.parametrize("joint", ["right_knee", "right_ankle"])
def test_a_leg_that_no_keypoint_shows_has_no_stride_and_no_knee(tmp_path, capsys, joint):
    file = saved(tmp_path / "walk.npz", ("", hidden(walk(), joint)))
    assert main(["gait", file]) == 0
    said = capsys.readouterr().out
    assert "knee range      left 50 deg, right - deg" in said and "cadence         - steps/min" in said
    assert "do not show the whole right leg in 100% of the frames" in said
    both = saved(tmp_path / "both.npz", ("", hidden(walk(), "left_ankle", "right_ankle")))
    assert main(["gait", both]) == 2 and "whole left leg in 100%" in capsys.readouterr().err


def test_a_leg_that_is_hidden_for_a_part_is_not_measured_there():
    strides = measure_gait(walk(seconds=8.0)).strides
    flicker = measure_gait(hidden(walk(seconds=8.0), "right_ankle", seen=lambda t: (t * RATE).round() % 5 > 1))
    assert flicker.strides == strides
    found = measure_gait(hidden(walk(seconds=8.0), "right_ankle", seen=lambda t: (t < 4) | (t > 5)))
    assert found.strides == strides - 2 and not ((found.strikes["right"] > 4.2) & (found.strikes["right"] < 4.8)).any()


def test_a_squat_has_no_knee_that_no_keypoint_shows(tmp_path, capsys):
    (one, *_) = measure_squats(hidden(squats(), "right_knee"))
    assert round(one.knees[0]) == 100 and np.isnan(one.knees[1]) and abs(one.hips - 90) < 2
    file, plot = saved(tmp_path / "down.npz", ("", hidden(squats(), "right_ankle"))), tmp_path / "squat.svg"
    assert main(["squat", file, "--plot", str(plot)]) == 0 and "100 deg       - deg" in capsys.readouterr().out
    assert len(ElementTree.fromstring(plot.read_text()).findall(".//{*}circle")) == 3
    with pytest.raises(MeasureError, match="of neither leg in half of the frames"):
        measure_squats(hidden(squats(), "left_ankle", "right_ankle"))


@pytest.mark.parametrize("until_s", [1.0, 2.0, 6.0])
def test_a_squat_is_measured_by_the_leg_that_is_shown(until_s):
    whole = measure_squats(squats())
    found = measure_squats(hidden(squats(), "left_ankle", seen=lambda t: t > until_s))
    for one, same in zip(found, whole, strict=True):
        assert np.isnan(one.knees[0]) == (one.bottom < until_s) and abs(one.knees[1] - same.knees[1]) < 0.1
        assert np.allclose([one.start, one.end, one.depth, one.hips], [same.start, same.end, same.depth, same.hips])


@pytest.mark.parametrize("degrees", [20.0, 30.0, 40.0])
def test_a_squat_that_begins_or_ends_in_a_gap_with_bent_knees_has_no_time(degrees):
    poses = squats((100.0, 100.0))
    begin_s = 0.75 + 1.5 / np.pi * np.arcsin(degrees / 100.0)  # of the frames; the first squat begins at 0.75 s
    for seen in poses.seconds > begin_s, poses.seconds < 6.0 - begin_s:
        found = measure_squats(Poses(poses.seconds[seen], NAMES, poses.positions[seen], poses.likely_wrong[seen]))
        assert sum(np.isnan([one.start, one.end]).sum() for one in found) == 1 == len(found) - 1
        assert all(abs(one.depth - measure_squats(poses)[0].depth) < 0.01 for one in found)


def test_no_squat_goes_over_a_gap(tmp_path, capsys):
    poses = squats()
    seen = (poses.seconds < 3.9) | (poses.seconds > 4.6)  # the way down and the bottom of the second one
    cut = Poses(poses.seconds[seen], NAMES, poses.positions[seen], poses.likely_wrong[seen])
    assert [round(one.knees[0]) for one in measure_squats(cut)] == [100, 90]
    late = replace(poses, seconds=poses.seconds + np.where(poses.seconds > 4.5, 20.0, 0.0))  # a pause at the bottom
    assert [round(one.bottom, 1) for one in measure_squats(late)] == [1.5, 27.5]
    assert main(["squat", saved(tmp_path / "late.npz", ("", late))]) == 0
    assert "a gap of 20.0 s between frames: nothing is measured across" in capsys.readouterr().out


def test_a_squat_that_the_recording_cuts_has_the_depth_of_its_whole_side(tmp_path, capsys):
    poses = squats((100.0,))
    for part in (poses.seconds > 0.95, poses.seconds < 2.05):
        (one,) = measure_squats(Poses(poses.seconds[part], NAMES, poses.positions[part], poses.likely_wrong[part]))
        assert np.isnan(one.start) != np.isnan(one.end) and round(one.bottom, 1) == 1.5
        assert abs(one.depth - measure_squats(poses)[0].depth) < 0.01
    down = Poses(poses.seconds[48:], NAMES, poses.positions[48:], poses.likely_wrong[48:])
    assert main(["squat", saved(tmp_path / "down.npz", ("", down)), "--json", str(tmp_path / "down.json")]) == 0
    assert (
        "1.5 s    - s" in capsys.readouterr().out
        and json.loads((tmp_path / "down.json").read_text())[0]["start"] is None
    )
