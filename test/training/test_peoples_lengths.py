"""The proposal for the built-in body: lengths of known bodies, the mean, the covariance, and the file."""

from importlib import resources
from pathlib import Path

import numpy as np
import pytest
import yaml

from benchmarks.common.report import data_folder
from benchmarks.data.body_lengths import LENGTHS, rms_difference, skeleton_lengths
from lassokin_ros.core.body.skeleton import Skeleton
from training.lengths import main as write_captured_lengths
from training.people import (
    PERMITTED,
    PUBLISHED,
    Person,
    about_published,
    for_the_model,
    main,
    mean_person,
    model_names,
    part_lengths,
    people_covariance,
    write_body,
)

DATA = data_folder()
needs_data = pytest.mark.skipif(
    not (DATA / "corpus").is_dir() or not (DATA / "detections").is_dir(), reason=f"no data in {DATA}: set LASSOKIN_DATA"
)
HIPS = LENGTHS.index("hip width")


def test_lengths_of_a_skeleton_are_those_of_its_joints():
    skeleton = Skeleton.load("anthropometric", 1.8)
    lengths = dict(zip(LENGTHS, skeleton_lengths(skeleton)))
    place = {name: skeleton.rest_positions[i] for i, name in enumerate(skeleton.joint_names)}
    assert lengths["thigh"] == pytest.approx(np.linalg.norm(place["left_hip"] - place["left_knee"]))
    assert lengths["hip width"] == pytest.approx(2 * place["left_hip"][0])
    assert lengths["trunk"] == pytest.approx(place["left_shoulder"][1] - place["left_hip"][1], rel=0.01)


def test_log_lengths_do_not_depend_on_size():
    people = np.array(PUBLISHED) * np.exp(0.1 * np.random.default_rng(0).normal(size=len(LENGTHS)))
    assert np.allclose(about_published(1.1 * people), about_published(1.9 * people))
    assert np.allclose(about_published(1.6 * np.array(PUBLISHED)), 0)


def test_a_difference_is_that_of_the_shape():
    body = np.array(PUBLISHED)
    wider = body * np.where(np.arange(len(body)) == HIPS, np.exp(0.2), 1.0)
    assert rms_difference(1.3 * body, body) == pytest.approx(0) == rms_difference(body, body)
    assert rms_difference(1.3 * wider, body) == pytest.approx(0.2 / np.sqrt(len(body)))
    upper = np.where(np.arange(len(body)) < 4, np.nan, body)
    assert rms_difference(upper, body) == pytest.approx(0) and np.isnan(rms_difference(np.nan * body, body))


def person(source, **logs):
    return Person(str(logs), source, np.array([logs.get(name.replace(" ", "_"), 0.0) for name in LENGTHS]))


def test_recorded_people_give_the_mean_and_captures_half_of_the_hips():
    recorded = [person("recording", shank=-0.1, hip_width=0.4), person("recording", shank=0.0, hip_width=0.2)]
    captured = [person("CMU", shank=0.3, hip_width=0.0)] * 3 + [person("UI-PRMD", hip_width=0.2)]
    mean = mean_person(recorded, captured)
    assert mean[LENGTHS.index("shank")] == pytest.approx(-0.05)
    assert mean[HIPS] == pytest.approx(0.5 * 0.3 + 0.5 * 0.1)  # both collections count alike


def test_the_covariance_is_about_each_sources_own_mean():
    random = np.random.default_rng(3)
    logs = random.normal(size=(400, len(LENGTHS))) * 0.05
    people = [
        Person(f"{i}", "CMU" if i % 2 else "UI-PRMD", log + (0.5 if i % 2 else -0.5)) for i, log in enumerate(logs)
    ]
    covariance = people_covariance(people)
    assert np.allclose(np.sqrt(np.diag(covariance)), np.hypot(0.05, 0.02), rtol=0.15)
    assert np.linalg.eigvalsh(covariance).min() > 0


def test_parts_of_the_trunk_have_its_mean_and_a_covariance_that_can_be_inverted():
    mean, covariance = for_the_model(np.arange(7) / 100, 0.01 * np.eye(7))
    names = model_names()
    assert [mean[names.index(name)] for name in ("trunk", "shoulder height", "hip drop")] == [0.02] * 3
    assert mean[names.index("head")] == 0 and np.linalg.eigvalsh(covariance).min() > 1e-4


def test_a_skeleton_file_gets_the_lengths_and_keeps_its_stature(tmp_path):
    shipped = resources.files("lassokin_ros.core.body") / "skeletons" / "anthropometric.yaml"
    file = tmp_path / "body.yaml"
    file.write_text(shipped.read_text(encoding="utf-8"), encoding="utf-8")
    before, wanted = Skeleton.load(str(file), 1.0), np.array([-0.05, 0.02, 0.04, 0.2, -0.05, 0.06, -0.03])
    write_body(file, wanted)
    after = Skeleton.load(str(file), 1.0)
    logs = about_published(skeleton_lengths(after)) - about_published(np.array(PUBLISHED) * np.exp(wanted))
    assert np.abs(logs).max() < 0.01

    def tall(body):
        return body.rest_positions[body.index("head"), 1] - body.rest_positions[body.index("left_ankle"), 1]

    assert tall(after) == pytest.approx(tall(before), abs=0.0015)
    comments = [text.read_text(encoding="utf-8").count("#") for text in (shipped, file)]
    assert comments[0] == comments[1] and part_lengths(after)["hip width"] == pytest.approx(
        skeleton_lengths(after)[HIPS]
    )


@needs_data
def test_the_prior_is_about_the_proposed_body(tmp_path):
    file = tmp_path / "lengths.yaml"
    assert main(["--data", str(DATA), "--prior", str(file)]) == 0
    shipped = resources.files("lassokin_ros.core.evidence") / "priors" / "people_lengths.yaml"
    assert file.read_bytes() == shipped.read_bytes()
    data = yaml.safe_load(file.read_text(encoding="utf-8"))
    assert not any(data["mean"]) and tuple(data["names"]) == model_names()
    lower = np.array([row + [0.0] * (len(data["names"]) - len(row)) for row in data["covariance"]])
    assert np.linalg.eigvalsh(lower + np.tril(lower, -1).T).min() > 1e-4


@needs_data
def test_the_file_of_the_proposal_follows_from_the_data(tmp_path):
    file = tmp_path / "people.yaml"
    assert main(["--data", str(DATA), "--output", str(file)]) == 0
    kept = Path(__file__).resolve().parents[2] / "training" / "people.yaml"
    assert file.read_bytes() == kept.read_bytes()
    assert all(name in file.read_text(encoding="utf-8") for name in PERMITTED)


@needs_data
def test_the_shipped_prior_of_captured_people_follows_from_the_data(tmp_path, monkeypatch):
    file = tmp_path / "lengths.yaml"
    monkeypatch.setattr("sys.argv", ["lengths", "--data", str(DATA), "--output", str(file)])
    assert write_captured_lengths() == 0
    shipped = resources.files("lassokin_ros.core.evidence") / "priors" / "capture_lengths.yaml"
    assert file.read_bytes() == shipped.read_bytes()


def test_the_built_in_body_has_the_lengths_of_the_proposal():
    data = yaml.safe_load(
        (Path(__file__).resolve().parents[2] / "training" / "people.yaml").read_text(encoding="utf-8")
    )
    proposed = np.array([data["mean"][data["names"].index(name)] for name in LENGTHS])
    logs = about_published(skeleton_lengths(Skeleton.load("anthropometric", 1.0)))
    assert np.abs(logs - about_published(np.array(PUBLISHED) * np.exp(proposed))).max() < 0.008
