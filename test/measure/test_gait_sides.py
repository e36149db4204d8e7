"""The two sides of a gait: differences, what is left out, passes together, what the figures rest on; the page."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from motions import NAMES, RATE, body, saved, walk

from benchmarks.common.report import data_folder
from benchmarks.data.mocap import SMPL_NAME, load_clip
from benchmarks.gait import contacts, cut
from lassokin_ros.measure.command import main
from lassokin_ros.measure.gait import LENGTH, STANCE, TIME, Sides, measure_gait
from lassokin_ros.measure.gait_events import walk_of
from lassokin_ros.measure.poses import MeasureError, Poses, poses_of, read_poses
from lassokin_ros.measure.report import asymmetry_text, gait_lines, sides_text, trust_lines
from lassokin_ros.replay.motion import ASSUMED

STRIDE_S = 120 / 108


def limp(late_s, seconds=8.0, heading=1.57, speed=1.3):
    """A walk whose right foot strikes later by some s than half a stride after the left one."""
    t = np.arange(round(seconds * RATE)) / RATE
    phase = 2 * np.pi / STRIDE_S * (t[:, None] - [0.0, late_s]) + np.array([0.0, np.pi])
    return body(t, 24 * np.cos(phase), 5 + 50 * (0.5 - 0.5 * np.cos(phase + 2.0)), 0.0, speed, heading)


def test_a_foot_that_is_late_has_the_longer_step():
    found = measure_gait(limp(0.05)).sides[TIME]
    assert found.mean[1] - found.mean[0] == pytest.approx(0.1, abs=0.01) and found.differs and found.asymmetry < 0
    assert "right larger by 18% +- " in asymmetry_text(found)
    even = measure_gait(limp(0.0)).sides
    assert "no asymmetry seen (below " in sides_text(TIME, even[TIME]) and not even[TIME].differs
    assert all(abs(one.mean[0] - one.mean[1]) < 0.01 for one in even.values())
    assert even[LENGTH].mean[0] == pytest.approx(0.65, abs=0.07) and 0.3 < even[STANCE].mean[0] < 0.6


def test_the_cadence_agrees_with_the_stride_where_a_strike_is_missed():
    poses = walk(seconds=9.0)
    still = poses.positions.copy()
    ankle, during = NAMES.index("left_ankle"), (poses.seconds > 4.1) & (poses.seconds < 4.9)
    still[during, ankle] = 0.5 * (still[during][:, NAMES.index("left_hip")] + still[during, ankle])
    found = measure_gait(replace(poses, positions=still))
    assert abs(found.cadence * found.stride_s - 120) < 1e-9 and abs(found.stride_s - STRIDE_S) < 0.03


def test_steps_in_marked_spans_are_left_out():
    poses = walk(seconds=9.0)
    marked = replace(poses, likely_wrong=(poses.seconds > 4.0) & (poses.seconds < 5.0))
    whole, found = measure_gait(poses), measure_gait(marked)
    times = np.array([at for side in ("left", "right") for at, _, _ in found.steps[TIME][side]])
    assert found.left_out["marked as likely wrong"] in (3, 4) and len(times) < sum(whole.sides[TIME].count)
    assert not ((times > 4.0) & (times < 5.0)).any() and found.strides < whole.strides
    with pytest.raises(MeasureError, match="left out: marked as likely wrong"):
        measure_gait(replace(poses, likely_wrong=np.ones(len(poses.seconds), dtype=bool)))


def test_steps_of_a_turn_are_left_out():
    poses = walk(seconds=9.0)
    angle = np.clip((poses.seconds - 4.0) / 1.0, 0, 1) * np.pi
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    middle = poses.positions[:, :1]
    x, z = ((poses.positions - middle)[..., k] for k in (0, 2))
    turned = poses.positions - middle
    turned[..., 0], turned[..., 2] = c * x + s * z, c * z - s * x
    away = np.cumsum(np.gradient(middle[:, 0], axis=0) * np.cos(angle)[:, None], axis=0)
    found = measure_gait(replace(poses, positions=turned + away[:, None]))
    assert found.left_out.get("turning", 0) >= 1


def test_passes_count_together():
    there, back = limp(0.04, heading=1.57), limp(0.04, heading=-1.57)
    one, two = measure_gait(there), measure_gait(there, back)
    assert two.strides == 2 * one.strides and sum(two.sides[TIME].count) == 2 * sum(one.sides[TIME].count)
    assert two.sides[TIME].asymmetry == pytest.approx(one.sides[TIME].asymmetry, abs=0.01)


def test_more_steps_make_a_smaller_limit_until_common_errors_remain():
    short, middle, long = (measure_gait(limp(0.0, seconds)).sides[TIME] for seconds in (3.5, 7.0, 14.0))
    assert short.spread > 1.2 * middle.spread and long.spread > 0.75 * middle.spread


def test_slow_motion_an_assumed_lens_and_an_assumed_height_are_said():
    poses = walk(seconds=8.0, heading=1.57)
    assert trust_lines(measure_gait(poses), [poses]) == ["seen from about 45 degrees"]
    slow = replace(poses, seconds=2 * poses.seconds, lens=ASSUMED, height=ASSUMED)
    lines = "\n".join(trust_lines(measure_gait(slow), [slow]))
    assert "slow motion (about 2.1 times)" in lines
    assert "the lens is assumed" in lines and "the height is assumed" in lines
    far = walk(seconds=8.0, speed=0.5)
    along = measure_gait(replace(far, positions=far.positions + [0.0, 0.0, 10.0]))
    assert along.view == "along" and along.sides[LENGTH].count == (0, 0)
    assert "step length     left -, right -; sides not compared" in gait_lines(along)


def test_few_steps_do_not_compare():
    few = Sides((0.5, 0.5), (0.05, 0.05), (1, 1), 0.1)
    assert asymmetry_text(few) == "too few steps to compare the sides"


def test_a_video_is_tracked_with_the_options_of_track(tmp_path, capsys, monkeypatch):
    asked = []

    def track(words):
        asked.extend(words)
        saved(Path(words[words.index("--export") + 1]), ("", walk()))
        print("walk.mp4\nwritten         somewhere")
        return 0

    monkeypatch.setattr("lassokin_ros.video.command.main", track)
    page = tmp_path / "page.html"
    assert main(["gait", "walk.mp4", "--height", "1.7", "--fov", "25", "--page", str(page)]) == 0
    said = capsys.readouterr()
    assert asked[0] == "walk.mp4" and asked[asked.index("--height") + 1] == "1.7" and "smoothing_lag:=0.0" in asked
    assert said.out.startswith("strides") and said.err == "walk.mp4\n"
    text = page.read_text(encoding="utf-8")
    assert "Left and right" in text and text.count("<svg") >= 3 and "<script" not in text
    monkeypatch.setattr("lassokin_ros.video.command.main", lambda words: 2)
    assert main(["gait", "walk.mp4"]) == 2
    monkeypatch.setattr("lassokin_ros.video.command.main", lambda words: 0)
    with pytest.raises(MeasureError, match="nobody was tracked"):
        poses_of("walk.mp4", None, [])


def test_options_that_do_not_go_together_are_refused(tmp_path, capsys):
    file = saved(tmp_path / "walk.npz", ("", walk()))
    (tmp_path / "walk.csv").write_text("stamp [s],person\n")
    for words, text in (
        (["gait", file, "--height", "1.7"], "is tracked already; expected no --height"),
        (["squat", file, file], "several motions and --page are for gait"),
        (["gait", file, "--page", str(tmp_path / "page.txt")], "expected a name that ends in .html"),
        (["gait", file, "--plot", str(tmp_path / "gait.png")], "expected a name that ends in .svg"),
        (["gait", str(tmp_path / "walk.csv")], "lassokin track: "),  # another export
    ):
        assert main(words) == 2 and text in capsys.readouterr().err
    assert main(["gait", file, file, "--json", str(tmp_path / "g.json")]) == 0
    assert json.loads((tmp_path / "g.json").read_text())["sides"]["step time"]["count"][0] > 6


def test_lens_height_and_cameras_are_read(tmp_path):
    file = saved(tmp_path / "walk.npz", ("", walk()))
    with np.load(file) as arrays:
        np.savez(file, **arrays, lens="assumed", height_from="given", camera_names=np.array(["a", "b"]))
    poses = read_poses(Path(file), None)
    assert (poses.lens, poses.height, poses.cameras) == ("assumed", "given", 2)
    assert measure_gait(poses).view == "several cameras"


@pytest.mark.skipif(not (data_folder() / "mocap").is_dir(), reason="no motion capture: set LASSOKIN_DATA")
def test_captured_contacts_are_found():
    clip = cut(load_clip(data_folder() / "mocap" / "07_05.npz"), None)
    names = [name for name in SMPL_NAME if name in clip.names]
    places = np.stack([clip.position(name) for name in names], axis=1) * [1.0, -1.0, -1.0]
    seconds = np.arange(len(places)) / clip.fps
    still = np.zeros(len(seconds), dtype=bool)
    walked = walk_of(Poses(seconds, tuple(SMPL_NAME[name] for name in names), places, still))
    for found, true in zip((walked.strikes, walked.offs), contacts(clip)):
        off = [np.abs(found[side] - at).min() for side in true for at in true[side] if 0.3 < at < seconds[-1] - 0.3]
        assert len(off) > 3 and max(off) < 0.08
