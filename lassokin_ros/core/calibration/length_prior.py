"""Prior distribution of the log-lengths: a mixture of Gaussians, one for each origin that the given lengths may have.

Given lengths are measured, or good guesses, or those of another person. The built-in proportions are not a measurement.
With them there are three cases: the person has about these lengths, or other ones, or lengths like those of the people
of the motion capture (priors/lengths.yaml, written by training/lengths.py), whose joints are other points of the body.
The keypoints determine the probability of each case.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from lassokin_ros.core.body.proportions import Proportions
from lassokin_ros.core.body.skeleton import has_built_in_proportions
from lassokin_ros.core.yaml_files import shipped_mapping

MEASURED, GUESSED, ANOTHER = 0.003, 0.05, 0.12
"""Standard deviation of a log-length about the given one if the given lengths are measured, good guesses, or those of
another person. A measured skeleton thus stays unchanged until the images clearly contradict it."""
ODDS = (0.3, 0.6, 0.1)
"""Prior probability of each case. Treating a guess as measured costs more than the opposite error."""
BUILT_IN_ODDS = (0.3, 0.1, 0.4, 0.2)
"""Prior probability that a person has the built-in proportions, others, or those of people of the motion capture."""


@dataclass(frozen=True, eq=False)
class LengthModel:
    """A Gaussian of the log-lengths, which have no unit.

    mean: (p,); precision: (p, p); odds: prior probability of this case. measured: whether the given lengths are right.
    """

    mean: np.ndarray
    precision: np.ndarray
    odds: float
    measured: bool = False


@cache
def _population(file="priors/lengths.yaml") -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """(names, mean (k,), covariance (k, k)) of people's log-lengths about the built-in proportions."""
    data = shipped_mapping("lassokin_ros.core.evidence", file)
    rows = data["covariance"]
    lower = np.array([row + [0.0] * (len(rows) - len(row)) for row in rows])
    return tuple(data["names"]), np.array(data["mean"]), lower + np.tril(lower, -1).T


def length_models(proportions: Proportions) -> list[LengthModel]:
    """The cases for the skeleton of some proportions, with (p,) log-lengths in the order of `proportions.names`."""
    count = proportions.count

    def about_given(spread: float, odds: float, measured: bool = False) -> LengthModel:
        return LengthModel(np.zeros(count), np.eye(count) / spread**2, odds, measured)

    if not has_built_in_proportions(proportions.given):
        guessed = [about_given(spread, odds) for spread, odds in zip((GUESSED, ANOTHER), ODDS[1:])]
        return [about_given(MEASURED, ODDS[0], measured=True), *guessed]
    built_in = [about_given(spread, odds) for spread, odds in zip((GUESSED, ANOTHER), BUILT_IN_ODDS)]
    for file, odds in (("priors/lengths.yaml", BUILT_IN_ODDS[2]), ("priors/cmu_lengths.yaml", BUILT_IN_ODDS[3])):
        names, mean, covariance = _population(file)
        index = [names.index(name) if name in names else -1 for name in proportions.names]
        known = np.flatnonzero(np.array(index) >= 0)
        chosen = [index[i] for i in known]
        own_mean, own = np.zeros(count), np.eye(count) * GUESSED**2
        own_mean[known], own[np.ix_(known, known)] = mean[chosen], covariance[np.ix_(chosen, chosen)]
        built_in.append(LengthModel(own_mean, np.linalg.inv(own), odds))
    return built_in


@dataclass(frozen=True, eq=False)
class LengthPosterior:
    """odds: (m,) of the cases; means: (m, p) and covariances: (m, p, p) of the log-lengths in each of them."""

    odds: np.ndarray
    means: np.ndarray
    covariances: np.ndarray

    def spread(self, about: np.ndarray) -> np.ndarray:
        """(p,) standard deviation of the mixture about a value."""
        within, between = np.diagonal(self.covariances, axis1=1, axis2=2), (self.means - about) ** 2
        return np.asarray(np.sqrt(self.odds @ (within + between)))


def initial_spread(models: Sequence[LengthModel]) -> np.ndarray:
    """(p,) standard deviation of the log-lengths about the given ones before any measurement."""
    count = len(models[0].mean)
    if any(model.measured for model in models):
        return np.full(count, GUESSED)
    odds, means = np.array([model.odds for model in models]), np.array([model.mean for model in models])
    return LengthPosterior(odds, means, np.linalg.inv([model.precision for model in models])).spread(np.zeros(count))


def posterior(models: Sequence[LengthModel], H: np.ndarray, g: np.ndarray, common: np.ndarray) -> LengthPosterior:
    """Cases and lengths after measurements.

    H: (p, p) and g: (p,) normal equations of the measurements, about zero. common: (p, p) further information about the
    differences from each case's mean, such as that of the stature. The odds follow from the marginal likelihoods.
    """
    evidence, means, covariances = [], [], []
    for model in models:
        prior = common + model.precision
        covariance = np.linalg.inv(H + prior)
        pull = prior @ model.mean
        mean = covariance @ (g + pull)
        volume = np.linalg.slogdet(prior)[1] + np.linalg.slogdet(covariance)[1]
        evidence.append(0.5 * ((g + pull) @ mean - pull @ model.mean + volume) + np.log(model.odds))
        means.append(mean)
        covariances.append(covariance)
    likely = np.exp(np.array(evidence) - max(evidence))
    return LengthPosterior(likely / likely.sum(), np.array(means), np.array(covariances))
