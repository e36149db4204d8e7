"""The commands `lassokin robot check` and `lassokin retarget`, with a toy robot and a motion of ten postures."""

import pickle

import numpy as np
import pytest
import toy_robot

pytest.importorskip("pink", reason="needs the extra robot: pip install lassokin_ros[robot]")

from lassokin_ros import joints  # noqa: E402
from lassokin_ros.robot import check, retarget  # noqa: E402
from lassokin_ros.robot.person import ANKLES  # noqa: E402

FPS, SECONDS = 20, 3.0


@pytest.fixture
def files(tmp_path):
    """Paths of a URDF, a robot's file, and a motion: from arms down to bent elbows, then unseen for a second."""
    urdf, robot, motion = tmp_path / "toy.urdf", tmp_path / "toy.yaml", tmp_path / "walk.npz"
    urdf.write_text(toy_robot.urdf())
    robot.write_text(toy_robot.as_yaml(toy_robot.robot()))
    people, count = check.people(), round(SECONDS * FPS)
    shares = np.clip(np.linspace(0, 2, count), 0, 1)[:, None, None]
    places = (1 - shares) * people["arms down"].places + shares * people["elbows bent"].places
    camera = np.diag([-1.0, -1.0, 1.0])  # to x right, y down of the person's y up
    contacts = np.zeros((count, 24), dtype=bool)
    contacts[:, ANKLES] = True
    wrong = np.arange(count) >= count - FPS
    np.savez(
        motion,
        stamp_ns=np.arange(count) * 1_000_000_000 // FPS,
        start_ns=np.array(0),
        person=np.repeat([""], count),
        people=np.array([""]),
        joint_names=np.array(joints.NAMES),
        joint_positions=places @ camera.T,
        joint_observed=np.ones((count, 24), dtype=bool),
        joint_contacts=contacts,
        likely_wrong=wrong,
        level=np.eye(3),
    )
    return urdf, robot, motion


def test_check_says_what_fits_and_draws_robot_and_person(files, tmp_path, capsys):
    urdf, robot, _ = files
    picture = tmp_path / "toy.svg"
    assert check.main(["check", str(urdf), str(robot), "--picture", str(picture)]) == 0
    said = capsys.readouterr().out
    assert "toy: 21 joints: " in said and "elbows bent: bones off by 0 degrees" in said
    drawn = picture.read_text()
    assert drawn.count("<polyline") == 2 * 5 * len(check.POSTURES) and ">person<" in drawn and ">toy<" in drawn
    assert check.main(["check", str(urdf), str(robot), "--picture", str(picture)]) == 2
    assert "exists already" in capsys.readouterr().err


def test_check_of_another_robots_file_is_one_line(files, tmp_path, capsys):
    assert check.main(["check", str(files[0]), "g1", "--picture", str(tmp_path / "a.svg")]) == 2
    said = capsys.readouterr().err
    assert "torso: the URDF has no link 'torso_link'" in said and len(said.splitlines()) == 1


def test_retarget_writes_a_table_arrays_and_the_keys_of_gmr(files, tmp_path, capsys):
    urdf, robot, motion = files
    outputs = [tmp_path / f"toy{suffix}" for suffix in (".csv", ".npz", ".pkl")]
    chosen = [part for path in outputs for part in ("-o", str(path))]
    arguments = [str(motion), "--urdf", str(urdf), "--robot", str(robot), *chosen]
    assert retarget.main(arguments) == 0
    said = capsys.readouterr()
    assert "joints" in said.out and "the robot holds in" in said.out and "60/60 frames" in said.err
    with np.load(outputs[1]) as data:
        arrays = dict(data)
    names = arrays["joint_names"].tolist()
    assert len(names) == 21 and arrays["rate"] == 50 and len(arrays["seconds"]) == round(SECONDS * 50) - 2
    elbow = arrays["positions"][:, names.index("left_elbow")]
    bent = np.searchsorted(arrays["seconds"], 1.8)
    assert elbow[0] > -0.3 and elbow[bent] < -1.3 and not arrays["following"][-1] and arrays["following"][bent]
    still = np.flatnonzero(~arrays["following"])
    assert np.ptp(elbow[still[5]:]) == 0  # it holds
    table = np.loadtxt(outputs[0], delimiter=",", skiprows=1)
    assert outputs[0].read_text().splitlines()[0].split(",")[9:] == names
    assert np.allclose(table[:, 9:], arrays["positions"], atol=1e-4)
    with outputs[2].open("rb") as file:
        keys = pickle.load(file)
    assert {"fps", "root_pos", "root_rot", "dof_pos", "local_body_pos", "link_body_list"} <= set(keys)
    assert keys["fps"] == 50 and np.array_equal(keys["dof_pos"], arrays["positions"])
    assert np.allclose(np.linalg.norm(keys["root_rot"], axis=1), 1) and keys["root_pos"][0, 2] > 0.7


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"-o": "toy.bvh"}, "expected a name that ends in .csv, .npz, .pkl"),
        ({"--rate": "1"}, "expected 10 to 1000 Hz"),
        ({"--urdf": "none.urdf"}, "none.urdf cannot be read"),
        ({"--robot": "none.yaml"}, "there is no robot file 'none.yaml'"),
    ],
)
def test_retarget_refuses_in_one_line(files, tmp_path, monkeypatch, capsys, changed, words):
    monkeypatch.chdir(tmp_path)
    given = {"--urdf": str(files[0]), "--robot": str(files[1]), "-o": "toy.csv", **changed}
    assert retarget.main([str(files[2]), *(part for pair in given.items() for part in pair)]) == 2
    said = capsys.readouterr().err
    assert words in said and len(said.splitlines()) == 1 and not (tmp_path / "toy.csv").exists()
