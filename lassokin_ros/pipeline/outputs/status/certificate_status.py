"""The certificate of a frame's lasso as a diagnostic status."""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.lasso.certificate import theorem1_literal, theorem1_projected
from lassokin_ros.core.lasso.solver import KKT_TOLERANCE
from lassokin_ros.pipeline.frame_result import FrameResult
from msg_adapters.output_messages.builders import OK, WARN, StatusLine


def certificate_status(frame: FrameResult, name: str, hardware_id: str) -> StatusLine:
    """Return KKT residuals, duality gap, support, reprojection error, Theorem 1's margins, and the doubt.

    Theorem 1 is evaluated at the support and signs of the solution: it shows whether the lasso would recover them if
    they were the truth. frame: an accepted one; name: of the node, and of the person if there are several; hardware_id:
    the camera frame.
    """
    estimate = frame.estimate
    assert estimate is not None and estimate.increment is not None
    problem, solution = estimate.increment.problem, estimate.increment.solution
    certificate = solution.certificate
    support = solution.support
    signs = np.sign(solution.omega[support])
    literal = theorem1_literal(problem, solution.x, support, signs)
    projected = theorem1_projected(problem, support, signs)
    values = {
        "kkt1 [alpha]": certificate.kkt1,
        "kkt2 [alpha]": certificate.kkt2,
        "kkt3 [alpha]": certificate.kkt3,
        "duality gap": certificate.duality_gap,
        "relative duality gap": certificate.relative_gap,
        "support size": certificate.support_size,
        "certified": str(solution.certified).lower(),
        "reprojection error [px]": estimate.reprojection_px,
        "theorem 1, condition 1 (< 1)": projected.condition1,
        "theorem 1, condition 2 (> 0) [rad]": projected.condition2,
        "theorem 1, condition 3 (= 0)": projected.condition3,
        "theorem 1 literal, condition 1 (< 1)": literal.condition1,
        "theorem 1 literal, condition 2 (> 0) [rad]": literal.condition2,
        "theorem 1 literal, condition 3 (= 0)": literal.condition3,
        "initialised": str(estimate.initialised).lower(),
        "solved by": solution.method,
        "likely wrong": frame.likely_wrong,
        "doubtful": str(bool(frame.doubtful)).lower(),
        "doubtful because": ", ".join(frame.doubtful),
        "doubtful for [s]": frame.doubtful_s,
        "limbs not seen": ", ".join(frame.doubt.unseen),
    }
    level, message = (OK, "certified") if solution.certified else (WARN, "not certified")
    text = {key: value if isinstance(value, str) else f"{value:.6g}" for key, value in values.items()}
    return StatusLine(level, f"{name}: certificate", f"{message} to {KKT_TOLERANCE:g} of alpha", hardware_id, text)
