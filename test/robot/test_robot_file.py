"""The files of robots: what is refused, in which words; and the shipped ones against URDFs of others."""

import importlib.util
import os
from pathlib import Path

import pytest
import toy_robot

from lassokin_ros.robot.robot_file import PLACES, SHIPPED, RobotError, load_robot, parse_robot

GOOD = toy_robot.as_yaml(toy_robot.robot())
URDFS = {"g1": "g1_29dof.urdf", "h1": "h1.urdf", "h1_2": "h1_2_handless.urdf"}


def urdf_of(name):
    """The URDF of a shipped robot, which is not shipped; skips if it is not there."""
    if name in URDFS:
        path = Path(os.environ.get("LASSOKIN_DATA", "")) / "robots" / URDFS[name]
        if not os.environ.get("LASSOKIN_DATA") or not path.is_file():
            pytest.skip(f"needs {URDFS[name]} in the folder robots of LASSOKIN_DATA")
        return path.read_text()
    if importlib.util.find_spec("example_robot_data") is None:
        pytest.skip("needs the package example-robot-data: pip install example-robot-data")
    import example_robot_data

    return Path(example_robot_data.load("talos").urdf).read_text()


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_robot_fits_to_its_urdf_and_stands(name):
    pytest.importorskip("pink")
    from lassokin_ros.robot.model import RobotModel

    model = RobotModel(urdf_of(name), load_robot(name), free=True)
    places = model.places(model.rest)
    assert min(places[f"{side}_ankle"][2] for side in ("left", "right")) == pytest.approx(model.robot.sole)
    assert places["base"][2] > 0.6 and places["torso"][2] >= places["base"][2] and not model.remarks()
    assert set(model.names) <= set(model.all_names)


def test_a_file_has_14_places_and_may_have_offsets_and_settings():
    text = GOOD.replace("left_wrist: left_hand_link", "left_wrist: {link: left_hand_link, offset: [0, 0.1, 0]}")
    robot = parse_robot(text + "lock: [waist]\nlimits: {left_elbow: [-1, 0]}\nspeed: 3\n", "toy.yaml")
    assert tuple(robot.links) == PLACES and robot.links["left_wrist"] == "left_hand_link" and robot.name == "toy"
    assert robot.offsets == {"left_wrist": (0.0, 0.1, 0.0)} and robot.lock == ("waist",) and robot.speed == 3.0
    assert robot.limits == {"left_elbow": (-1.0, 0.0)} and robot.rest["left_knee"] == 0.2


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (GOOD.replace("left_elbow: left_elbow_link\n", ""), "has no left_elbow; expected the name of a link"),
        (GOOD + "soles: 0.1\n", "did you mean 'sole'"),
        (GOOD + "left_toe: a\n", "has the key 'left_toe'"),
        (GOOD.replace("base: pelvis", "base: [pelvis]"), "expected the name of a link, or {link: NAME"),
        (GOOD.replace("base: pelvis", "base: {link: pelvis, offset: [0, 0]}"), "expected 3 finite numbers"),
        (GOOD + "lock: waist\n", "expected a list of names of joints"),
        (GOOD + "limits: {waist: [1, 1]}\n", "lock joints that stay"),
        (GOOD + "speed: .nan\n", "expected a finite number"),
        (GOOD + "acceleration: 0\n", "expected more than 0"),
        (GOOD + "radii: {arm: 0.1}\n", "radii has the key 'arm', which is none of: trunk, forearm"),
        (GOOD + "radii: {trunk: wide}\n", "radii of trunk is 'wide'; expected a finite number"),
        ("[]", "expected a mapping"),
    ],
)
def test_a_file_that_is_wrong_is_refused_in_one_line(text, words):
    with pytest.raises(RobotError) as refused:
        parse_robot(text, "toy.yaml")
    assert words in str(refused.value) and "toy.yaml" in str(refused.value)


def test_an_unknown_name_lists_the_shipped_robots():
    with pytest.raises(RobotError, match="g1, h1, h1_2, talos"):
        load_robot("g2")
