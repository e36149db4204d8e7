"""The certificate of a frame's lasso as a diagnostic status."""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.lasso.recovery import theorem1_literal, theorem1_projected
from lassokin_ros.core.lasso.solver import KKT_TOLERANCE
from msg_adapters.output_messages.builders import OK, WARN, StatusLine


def certificate_status(estimate: Estimate, failure_probability: float, name: str, hardware_id: str) -> StatusLine:
    """Return KKT residuals, duality gap, support, reprojection error and Theorem 1's margins of the last lasso.

    Theorem 1 is evaluated at the support and signs of the solution: it shows whether the lasso would recover them if
    they were the truth. failure_probability: see JointUncertainty; name: of the node, and of the person if there are
    several; hardware_id: the camera frame.
    """
    problem, solution = estimate.problem, estimate.solution
    assert problem is not None and solution is not None
    certificate = solution.certificate
    support = solution.support
    signs = np.sign(solution.omega[support])
    literal = theorem1_literal(problem, solution.x, support, signs)
    projected = theorem1_projected(problem, support, signs)
    certified = solution.certified
    values = {
        "kkt1 [alpha]": f"{certificate.kkt1:.6g}",
        "kkt2 [alpha]": f"{certificate.kkt2:.6g}",
        "kkt3 [alpha]": f"{certificate.kkt3:.6g}",
        "duality gap": f"{certificate.duality_gap:.6g}",
        "relative duality gap": f"{certificate.relative_gap:.6g}",
        "support size": f"{certificate.support_size}",
        "certified": str(certified).lower(),
        "reprojection error [px]": f"{estimate.reprojection_px:.6g}",
        "theorem 1, condition 1 (< 1)": f"{projected.condition1:.6g}",
        "theorem 1, condition 2 (> 0) [rad]": f"{projected.condition2:.6g}",
        "theorem 1, condition 3 (= 0)": f"{projected.condition3:.6g}",
        "theorem 1 literal, condition 1 (< 1)": f"{literal.condition1:.6g}",
        "theorem 1 literal, condition 2 (> 0) [rad]": f"{literal.condition2:.6g}",
        "theorem 1 literal, condition 3 (= 0)": f"{literal.condition3:.6g}",
        "initialised": str(estimate.initialised).lower(),
        "start's confidence": f"{estimate.confidence:.6g}",
        "likely wrong": f"{failure_probability:.6g}",
    }
    level, message = (OK, "certified") if certified else (WARN, "not certified")
    return StatusLine(level, f"{name}: certificate", f"{message} to {KKT_TOLERANCE:g} of alpha", hardware_id, values)
