"""When another hypothesis replaces the tracked pose: all criteria in one place.

In each frame with new keypoints, `Tracker` compares the tracked state with one of these hypotheses:

- with the depth network: the network's pose, fitted to the frames (`network_hypothesis`), by `NETWORK_MARGIN`,
  unless it is far less balanced (`BALANCE_MARGIN`);
- without it: alternative bodies (`body_hypotheses`), by `BODY_MARGIN`, and if none replaces the state, the mirrored
  limbs (`limb_hypotheses`), by `LIMB_MARGIN`;
- with the network, `FIT_AFTER` s or more after the last keypoints: fits of the last state and of the network's pose to
  this frame; it starts from the one of lower cost (`Tracker._fit_after_long_step`);
- if the cost stays high: a newly initialised state (`reinitialisation`), by `REINITIALISATION_SHARE`.

Costs are negative log-likelihoods: the image, all other evidence and, for body hypotheses, motion. Except after
a long step, the replacement takes effect in the next frame. Each published answer is that of its own certified lasso.
"""

from __future__ import annotations

BODY_MARGIN = 2.0
"""Difference in mean cost by which an alternative body must be better."""
LIMB_MARGIN = 0.6
"""Difference in mean cost by which a mirrored limb must be better; less than for a whole body."""
NETWORK_MARGIN = 2.0
"""Difference in cost by which the fitted pose of the network must be better."""
BALANCE_MARGIN = 0.2
"""m: the fitted pose of the network does not replace the tracked one if its centre of mass is farther from the feet by
more than this. The network may take a squat, which its training data hardly has, for a lean: 0.33 m in the demo, by
which the rule was found. On the people of validation, it is less than 0.06 m in 29 of 30 replacements."""
FIT_AFTER = 0.15
"""s since the last new keypoints from which the frame starts from a fit. At lower rates, a state found for one frame is
too old for the next one."""
REINITIALISATION_SHARE = 0.5
"""A newly initialised state replaces the tracked one if its cost is below this share of the tracked state's cost."""


def body_replaces(advantage: float) -> bool:
    """Whether an alternative body with this mean advantage in cost replaces the tracked one. False for NaN."""
    return bool(advantage > BODY_MARGIN)


def limb_replaces(advantage: float) -> bool:
    """Whether a mirrored limb with this mean advantage in cost replaces the tracked one. False for NaN."""
    return bool(advantage > LIMB_MARGIN)


def network_replaces(tracked: float, fitted: float) -> bool:
    """Whether the network's fitted pose replaces the tracked one, by their costs. False for NaN."""
    return bool(fitted < tracked - NETWORK_MARGIN)


def is_less_balanced(tracked: float, fitted: float) -> bool:
    """True if the fitted pose of the network is less balanced; the tracked pose is then kept.

    Its centre of mass is more than `BALANCE_MARGIN` farther from the feet than that of the tracked pose. Arguments: m.
    """
    return bool(fitted > tracked + BALANCE_MARGIN)


def reinitialisation_replaces(tracked: float, found: float) -> bool:
    """Whether a newly initialised state replaces the tracked one, by their costs. False for NaN."""
    return bool(found < REINITIALISATION_SHARE * tracked)
