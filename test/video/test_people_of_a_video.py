"""`track --person`: who is who in a file's images, and whose motion is written."""

import json
import re

import numpy as np
import pytest
from conftest import FRAMES
from scripted import person, standing, two

from benchmarks.common.report import data_folder
from lassokin_ros.detector.backend import Detected
from lassokin_ros.pipeline.session import Session
from lassokin_ros.video.command import main
from lassokin_ros.video.people import PersonError, choose, people_in, settings_for

pytest.importorskip("cv2")

RECORDED = data_folder() / "detections" / "wildflower_everybody_openpose.npz"


def run(video, tmp_path, *options):
    """Return the arrays of the export: {person: (stamps in s, x of the pelvis in m)}."""
    file = tmp_path / "motion.npz"
    assert main([str(video), "--fov", "60", "--force", "--export", str(file), *options]) == 0
    with np.load(file) as data:
        seconds, x = data["stamp_ns"] * 1e-9, data["translation"][:, 0]
        return {name: (seconds[data["person"] == name], x[data["person"] == name]) for name in data["people"]}


@pytest.mark.parametrize("who, side", [(None, 1), ("2", -1)])
def test_one_of_two_people_is_tracked_all_the_time(who, side, use, long_video, tmp_path, capsys):
    use(two, True)
    page = tmp_path / "page.html"
    chosen = ["--person", who] if who else []
    ((seconds, x),) = run(long_video, tmp_path, *chosen, "--height", "1.8", "--report", str(page)).values()
    assert len(seconds) == (38 if side > 0 else FRAMES) and (np.sign(x) == side).all()
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("people ")]
    said = f"2 people in the images, number {1 if side > 0 else 2} is tracked"
    assert said in line and "1: 0.0 to 2.5 s, 181 px in size, at first right; 2: 0.0 to 3.9 s" in line
    assert f'<li class="note">{said} (<code>--person</code>)' in page.read_text(encoding="utf-8")


def shanks(file):
    """{person: (f,) m, length of the left shank in each frame}."""
    with np.load(file) as data:
        knee, ankle = (list(data["joint_names"]).index(f"left_{joint}") for joint in ("knee", "ankle"))
        bone = np.linalg.norm(data["joint_positions"][:, ankle] - data["joint_positions"][:, knee], axis=1)
        return {person: bone[data["person"] == person] for person in data["people"]}


def short_legged(seconds):
    """Two people from 0.3 s on, but for some images. The small person's shanks are 30 % shorter."""
    if seconds < 0.3 or 2.5 <= seconds < 2.8:
        return []
    found = two(seconds)
    small = min(found, key=lambda one: np.ptp(one.pixels[:, 1]))
    small.pixels[[15, 16], 1] -= 0.3 * (small.pixels[[15, 16], 1] - small.pixels[[13, 14], 1])
    return found


def test_all_people_have_their_files_and_lengths(use, long_video, tmp_path, monkeypatch, capsys):
    """In a pass of its own each person has the same lengths in all frames, learned from that person alone.

    And each is tracked backward, too. Images without anybody do not count as tracked, but are on the page's axis.
    """
    use(short_legged, True)
    given, use_backward = [], Session.use_backward
    monkeypatch.setattr(Session, "use_backward", lambda *both: (given.append(both[1]), use_backward(*both)))
    (tmp_path / "m_p3.bvh").write_text("of an earlier run", encoding="utf-8")
    (tmp_path / "m_pose.bvh").write_text("of nobody", encoding="utf-8")
    page = tmp_path / "page.html"
    found = run(long_video, tmp_path, "--person", "all", "--export", str(tmp_path / "m.bvh"), "--report", str(page))
    assert {file.name for file in tmp_path.glob("*.bvh")} == {"m_p1.bvh", "m_p2.bvh", "m_pose.bvh"}
    stamps, said = set(np.concatenate([seconds for seconds, _ in found.values()])), capsys.readouterr().out
    assert f"{FRAMES} in, {len(stamps)} tracked" in said and len(stamps) < FRAMES - 3
    assert "numbers 1 and 2 are tracked" in said
    (frames,) = given
    for number, (person_id, (seconds, x)) in enumerate(sorted(found.items()), 1):
        assert len(frames[number]) >= len(seconds) > 20, person_id
        roots = np.array([one.state.translation[0] for one in frames[number].values()])
        assert abs(np.median(roots) - np.median(x)) < 0.3, person_id
    assert set(found) == {"p1", "p2"} and (found["p1"][1] > 0).all() and (found["p2"][1] < 0).all()
    text = page.read_text(encoding="utf-8")
    data = json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', text).group(1))
    assert abs(data["duration"] - 59 / 15) < 0.01 and f"<td>{FRAMES} in 3.9 s, 15.0 Hz</td>" in text
    assert all(one["time"][0] > 0.29 for one in data["people"]) and len(data["people"]) == 2
    whole = shanks(tmp_path / "motion.npz")
    assert set(run(long_video, tmp_path, "--person", "all", "--causal")) == {"p1", "p2"}
    causal = shanks(tmp_path / "motion.npz")
    assert whole["p2"][0] < 0.93 * whole["p1"][0]
    assert causal["p1"][0].round(6) == causal["p2"][0].round(6)  # a camera's people begin with the same lengths
    assert all(np.ptp(whole[one]) < 0.6 * np.ptp(causal[one]) for one in whole)


def test_a_camera_follows_the_nearest_person(use, long_video, tmp_path, capsys):
    use(two, True)
    ((_, x),) = run(long_video, tmp_path, "--causal").values()
    assert (x[:35] > 0).all()
    assert main([str(long_video), "--causal", "--person", "2"]) == 2
    assert "people are numbered in files only" in capsys.readouterr().err


def test_the_page_counts_the_images_with_too_many_people(use, images, tmp_path):
    use(lambda seconds: [person(x, 0.5) for x in (60 + 10 * seconds, 160, 260)], True)
    options = ["--causal", "--person", "all", "-p", "max_people:=2", "--report", str(tmp_path / "page.html")]
    assert main([str(images), "--fov", "60", "--height", "1.8", *options]) == 0
    assert "images contain more people than max_people 2" in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_a_person_that_cannot_be_chosen_is_one_line(images, tmp_path, use, capsys):
    for detector, who, text in [
        ((standing,), "nearest", "finds one person"),
        ((two, True), "tallest", "expected nearest, largest, all or a number from 1"),
        ((two, True), "0", "or a number from 1"),
        ((two, True), "3", "there are 2 people in the images; expected 1 to 2"),
    ]:
        use(*detector)
        assert main([str(images), "--fov", "60", "--person", who, "--export", str(tmp_path / "m.csv")]) == 2
        said = capsys.readouterr()
        assert text in said.err and len(said.err.splitlines()) == 1 and said.out == ""
    assert not list(tmp_path.glob("m.*"))


def test_the_nearest_person_may_be_seen_shortly():
    far, near = [(i / 10, [person(100, 0.5)]) for i in range(100)], {50 + i: person(250, 1.2) for i in range(12)}
    images = [(at, [*found, near[i]] if i in near else found) for i, (at, found) in enumerate(far)]
    people = people_in(images)
    assert [len(one.seconds) for one in people] == [100, 12]
    assert choose("largest", people, 4) == [0] and choose("nearest", people, 4) == [1]
    assert choose("all", people, 1) == [0] and choose("2", people, 4) == [1] and choose("nearest", [], 4) == []
    assert len(people_in(images[:55])) == 1  # half a second is too short
    assert settings_for("all", live=True) == ["max_people:=4"] and settings_for("largest", live=False) == []
    with pytest.raises(PersonError, match="expected 1 to 2"):
        choose("3", people, 4)


def test_missing_points_do_not_say_where_a_person_is():
    one = person(250, 1.2)
    one.pixels[:12], one.confidence[:12] = 0.0, 0.0
    (found,) = people_in([(i / 10, [one]) for i in range(20)])
    assert found.words(320).endswith("at first right")


@pytest.mark.skipif(not RECORDED.is_file(), reason=f"there is no {RECORDED}")
def test_people_in_a_room_keep_their_numbers():
    """Four recordings of up to six people; everybody's detections and who is who are in the file."""
    with np.load(RECORDED) as data:
        keypoints, index = data["kp2d_all"].astype(float), data["person_index"]
    pure = []
    for camera in range(len(keypoints)):
        images, owner = [], {}
        for f, people in enumerate(keypoints[camera]):
            found = []
            for row, points in enumerate(people):
                if (points[:, 2] > 0).any():
                    found.append(Detected(points[:, :2], points[:, 2]))
                    owner[id(found[-1])] = np.flatnonzero(index[:, camera, f] == row)
            images.append((f / 10, found))
        for one in people_in(images):
            known = [owner[id(detected)][0] for detected in one.detected if len(owner[id(detected)])]
            if len(one.seconds) > 0.5 * len(images):
                pure.append(np.bincount(known).max() / len(known))
    assert len(pure) == 13 and np.sum(np.array(pure) >= 0.96) == 11, pure
