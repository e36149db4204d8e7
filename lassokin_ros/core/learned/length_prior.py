"""Prior distribution of the log-lengths: a mixture of Gaussians, one for each origin that the given lengths may have.

Given lengths are measured, or good guesses, or those of another person. With the built-in proportions there are four
cases: the person has about these lengths, or other ones, or lengths that differ from them as those of people do
(priors/people_lengths.yaml, written by training/people.py), or as those of motion capture (priors/capture_lengths.yaml,
written by training/lengths.py), whose joints are other points of the body than those that detectors mark. The keypoints
determine the probability of each case.
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
"""Standard deviation of a log-length about the given one in these cases."""
ODDS = (0.3, 0.6, 0.1)
"""Prior probability of each case. Treating a guess as measured costs more than the opposite error."""
BUILT_IN_ODDS = (0.3, 0.1, 0.4, 0.2)
"""Prior probability that a person has the built-in proportions, others, or those of one of the `POPULATIONS`."""
POPULATIONS = ("priors/people_lengths.yaml", "priors/capture_lengths.yaml")
"""Files of people's lengths: as detectors see them, and between the joints of motion capture."""


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
def population(file: str) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """(names, mean (k,), covariance (k, k)) of people's log-lengths about the built-in proportions."""
    data = shipped_mapping("lassokin_ros.core.evidence", file)
    rows = data["covariance"]
    lower = np.array([row + [0.0] * (len(rows) - len(row)) for row in rows])
    return tuple(data["names"]), np.array(data["mean"]), lower + np.tril(lower, -1).T


def length_models(proportions: Proportions) -> list[LengthModel]:
    """The cases for the skeleton of some proportions, with (p,) log-lengths in the order of `proportions.names`."""
    count = proportions.count

    def about_given(deviation: float, odds: float, measured: bool = False) -> LengthModel:
        return LengthModel(np.zeros(count), np.eye(count) / deviation**2, odds, measured)

    if not has_built_in_proportions(proportions.given):
        guessed = [about_given(deviation, odds) for deviation, odds in zip((GUESSED, ANOTHER), ODDS[1:])]
        return [about_given(MEASURED, ODDS[0], measured=True), *guessed]
    built_in = [about_given(deviation, odds) for deviation, odds in zip((GUESSED, ANOTHER), BUILT_IN_ODDS)]
    populations = zip(POPULATIONS, BUILT_IN_ODDS[2:], strict=True)
    return [*built_in, *(_about_population(proportions, file, odds) for file, odds in populations)]


def _about_population(proportions: Proportions, file: str, odds: float) -> LengthModel:
    """The case of a person like those of a shipped population. Other lengths are good guesses."""
    names, mean, covariance = population(file)
    index = [names.index(name) if name in names else -1 for name in proportions.names]
    known = np.flatnonzero(np.array(index) >= 0)
    chosen = [index[i] for i in known]
    own_mean, own = np.zeros(proportions.count), np.eye(proportions.count) * GUESSED**2
    own_mean[known], own[np.ix_(known, known)] = mean[chosen], covariance[np.ix_(chosen, chosen)]
    return LengthModel(own_mean, np.linalg.inv(own), odds)


@dataclass(frozen=True, eq=False)
class LengthPosterior:
    """odds: (m,) of the cases; means: (m, p) and covariances: (m, p, p) of the log-lengths in each of them."""

    odds: np.ndarray
    means: np.ndarray
    covariances: np.ndarray

    def deviation(self, about: np.ndarray) -> np.ndarray:
        """(p,) standard deviation of the mixture about a value."""
        within, between = np.diagonal(self.covariances, axis1=1, axis2=2), (self.means - about) ** 2
        return np.asarray(np.sqrt(self.odds @ (within + between)))


def initial_deviation(models: Sequence[LengthModel]) -> np.ndarray:
    """(p,) standard deviation of the log-lengths about the given ones before any measurement."""
    count = len(models[0].mean)
    if any(model.measured for model in models):
        return np.full(count, GUESSED)
    odds, means = np.array([model.odds for model in models]), np.array([model.mean for model in models])
    return LengthPosterior(odds, means, np.linalg.inv([model.precision for model in models])).deviation(np.zeros(count))


def posterior(models: Sequence[LengthModel], H: np.ndarray, g: np.ndarray, common: np.ndarray) -> LengthPosterior:
    """Cases and lengths after measurements.

    H: (p, p) and g: (p,) normal equations of the measurements, about zero. common: (p, p) further information about the
    differences from each case's mean, such as that of the stature. The odds follow from the marginal likelihoods.
    """
    about = np.array([model.mean for model in models])
    prior = common + np.array([model.precision for model in models])
    covariances = np.linalg.inv(H + prior)
    pulls = (prior @ about[..., None])[..., 0]
    means = (covariances @ (g + pulls)[..., None])[..., 0]
    volume = np.linalg.slogdet(prior)[1] + np.linalg.slogdet(covariances)[1]
    evidence = 0.5 * (((g + pulls) * means).sum(-1) - (pulls * about).sum(-1) + volume)
    likely = np.array([model.odds for model in models]) * np.exp(evidence - evidence.max())
    return LengthPosterior(likely / likely.sum(), means, covariances)
