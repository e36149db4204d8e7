"""Results of the calibration, as figures for the diagnostics and for a saved file."""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.learned.bone_lengths import Calibration
from lassokin_ros.core.learned.height import HeightEstimator


def length_changes(calibration: Calibration) -> dict[str, float]:
    """Change of each length from the given skeleton, in %."""
    return dict(zip(calibration.proportions.names, (100 * np.expm1(calibration.lengths)).tolist()))


def averaged_sides(difference: float) -> str:
    """Text about the averaging of a given skeleton whose left and right differ by `difference`, of the logarithms."""
    return (
        f"left and right of the skeleton differ by {100 * difference:.1f} % on average, more than in a body: "
        "calibration starts with their mean; set calibrate: false to keep the given lengths"
    )


def calibration_figures(calibration: Calibration, enabled: bool, person: str = "") -> dict[str, str]:
    """Figures for /diagnostics: off, learning or final; motion used, the least certain length, and the change of each
    length.

    enabled: the parameter calibrate; person: the id, empty if one person is followed.
    """
    title = f"{person} calibration" if person else "calibration"
    state = "final" if calibration.frozen else "learning" if enabled else "off"
    values = {title: state}
    if calibration.kept_motion > 0:
        values[f"{title}: motion seen [s]"] = f"{calibration.kept_motion:.2f}"
        values[f"{title}: largest deviation [%]"] = f"{100 * float(np.max(calibration.deviation, initial=0)):.2f}"
        for name, change in length_changes(calibration).items():
            values[f"{title}: {name} [%]"] = f"{change:+.2f}"
    return values


def height_figures(height: HeightEstimator, person: str = "") -> dict[str, str]:
    """Figures for /diagnostics: the measured height and its standard deviation.

    Before the first measured depth, they are the mean and the standard deviation of people's heights.

    person: the id, empty if one person is followed.
    """
    title = f"{person} height" if person else "height"
    return {f"{title} [m]": f"{height.height:.3f}", f"{title}: deviation [m]": f"{height.deviation:.3f}"}


def height_in_words(height: HeightEstimator) -> str:
    """Return the measured height and its standard deviation as text."""
    if not height.measured:
        return f"{height.height:.2f} m, a mean of people: no depth was measured"
    return f"{height.height:.2f} m, measured, standard deviation {height.deviation:.2f} m"
