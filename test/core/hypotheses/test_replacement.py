"""The criteria by which a hypothesis replaces the tracked pose: at the margins, and for costs that are not finite."""

import numpy as np
import pytest

from lassokin_ros.core.hypotheses.replacement import (
    BALANCE_MARGIN,
    BODY_MARGIN,
    LIMB_MARGIN,
    NETWORK_MARGIN,
    REINITIALISATION_SHARE,
    body_replaces,
    is_less_balanced,
    limb_replaces,
    network_replaces,
    reinitialisation_replaces,
)


@pytest.mark.parametrize(("replaces", "margin"), [(body_replaces, BODY_MARGIN), (limb_replaces, LIMB_MARGIN)])
def test_a_hypothesis_replaces_beyond_its_margin_only(replaces, margin):
    assert replaces(1.01 * margin) and not replaces(margin) and not replaces(0.0)


def test_the_networks_pose_replaces_if_it_costs_less_by_the_margin():
    assert network_replaces(30.0, 29.99 - NETWORK_MARGIN)
    assert not network_replaces(30.0, 30.01 - NETWORK_MARGIN)


def test_the_networks_pose_may_be_a_little_less_balanced():
    assert is_less_balanced(0.1, 0.101 + BALANCE_MARGIN) and not is_less_balanced(0.1, 0.099 + BALANCE_MARGIN)
    assert not is_less_balanced(0.5, 0.1)


def test_a_new_state_replaces_if_it_costs_less_than_the_share():
    assert reinitialisation_replaces(100.0, 99.0 * REINITIALISATION_SHARE)
    assert not reinitialisation_replaces(100.0, 101.0 * REINITIALISATION_SHARE)


def test_nothing_replaces_by_a_cost_of_nan():
    assert not body_replaces(np.nan) and not limb_replaces(np.nan)
    assert not network_replaces(np.nan, 1.0) and not network_replaces(1.0, np.nan)
    assert not reinitialisation_replaces(np.nan, 1.0) and not reinitialisation_replaces(1.0, np.nan)
