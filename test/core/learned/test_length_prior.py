"""The prior of the lengths: its cases, and the posterior compared with Gaussian marginal likelihoods."""

import numpy as np
import pytest
from cases import body, scaled_forearms
from scipy.stats import multivariate_normal

from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.proportions import Proportions
from lassokin_ros.core.body.skeleton import Skeleton, has_built_in_proportions
from lassokin_ros.core.learned.bone_lengths import (
    GUESSED,
    MEASURED,
    LengthModel,
    initial_deviation,
    length_models,
    posterior,
)


def proportions_of(skeleton, layout="coco17"):
    return Proportions(Kinematics(skeleton, Layout.load(layout, skeleton)))


def test_built_in_proportions_are_recognised_at_every_height():
    for height in (0.8, 1.4, 2.1):
        assert has_built_in_proportions(Skeleton.load("anthropometric", height))
        assert has_built_in_proportions(Skeleton.load("anthropometric", 1.7).scaled(height / 1.7))
    assert not has_built_in_proportions(scaled_forearms(Skeleton.load("anthropometric", 1.7), 1.01))


def test_only_given_lengths_can_be_measured():
    built_in = Skeleton.load("anthropometric", 1.75)
    models = length_models(proportions_of(built_in))
    assert not any(model.measured for model in models) and [model.odds for model in models] == [0.3, 0.1, 0.4, 0.2]
    models = length_models(proportions_of(scaled_forearms(built_in, 0.9)))
    assert [model.measured for model in models] == [True, False, False]
    assert [model.odds for model in models] == [0.3, 0.6, 0.1]
    assert np.allclose(models[0].precision, np.eye(len(models[0].mean)) / MEASURED**2)


@pytest.mark.parametrize("layout", ["coco17", "body25", "mediapipe33", "smpl24"])
def test_the_population_is_about_the_built_in_body_and_differs_most_in_widths(layout):
    proportions = proportions_of(Skeleton.load("anthropometric", 1.75), layout)
    *_, model, captured = length_models(proportions)
    assert min(np.linalg.eigvalsh(case.precision).min() for case in (model, captured)) > 0 and not model.mean.any()
    mean = dict(zip(proportions.names, captured.mean))
    assert mean["forearm"] < -0.2 and all(mean[name] == 0 for name in ("foot", "hand") if name in mean)
    spread = dict(zip(proportions.names, np.sqrt(np.diag(np.linalg.inv(model.precision)))))
    assert spread["hip width"] > 0.1 > spread["shoulder width"] > spread["thigh"] > 0.03


def test_the_posterior_is_that_of_a_mixture_of_gaussians():
    """One measurement y of all lengths with covariance R: the marginal likelihood of a case is N(y; mean, cov + R)."""
    random = np.random.default_rng(1)
    models = []
    for odds in (0.5, 0.2, 0.3):
        root = random.normal(size=(4, 4))
        models.append(LengthModel(random.normal(size=4), np.linalg.inv(root @ root.T + np.eye(4)), odds))
    root = random.normal(size=(4, 4))
    R, y = root @ root.T + 0.5 * np.eye(4), random.normal(size=4)
    row = random.normal(size=4)
    common = np.outer(row, row)
    found = posterior(models, np.linalg.inv(R), np.linalg.solve(R, y), common)
    covariances = [np.linalg.inv(model.precision + common) for model in models]
    likely = np.array([m.odds * multivariate_normal(m.mean, C + R).pdf(y) for m, C in zip(models, covariances)])
    assert np.allclose(found.odds, likely / likely.sum(), rtol=1e-9)
    for model, C, mean, covariance in zip(models, covariances, found.means, found.covariances):
        gain = C @ np.linalg.inv(C + R)
        assert np.allclose(mean, model.mean + gain @ (y - model.mean))
        assert np.allclose(covariance, C - gain @ C)


def test_the_deviation_is_the_standard_deviation_of_samples():
    random = np.random.default_rng(2)
    models = length_models(proportions_of(Skeleton.load("anthropometric", 1.75)))
    which = random.choice(len(models), 20000, p=[model.odds for model in models])
    samples = np.concatenate([
        random.multivariate_normal(model.mean, np.linalg.inv(model.precision), int((which == case).sum()))
        for case, model in enumerate(models)
    ])  # fmt: skip
    assert np.allclose(np.sqrt((samples**2).mean(0)), initial_deviation(models), rtol=0.03)


def test_the_deviation_of_given_lengths_is_that_of_a_guess():
    models = length_models(proportions_of(scaled_forearms(Skeleton.load("anthropometric", 1.75), 0.9)))
    assert np.all(initial_deviation(models) == GUESSED)


def test_an_exact_measurement_decides_for_a_population():
    proportions = Proportions(body())
    models = length_models(proportions)
    exact = 1e6 * np.eye(proportions.count)
    wide = np.where(np.array(proportions.names) == "hip width", 0.3, 0.0)
    for case, lengths in ((2, wide), (3, models[3].mean)):
        assert posterior(models, exact, exact @ lengths, np.zeros_like(exact)).odds[case] > 0.99
    found = posterior(models, exact, 0 * wide, np.zeros_like(exact))
    assert found.odds[0] > 0.5 and found.odds[1] < 0.01
