"""What g2o's text files say about poses and lines, and where that differs from our terms.

As g2o's own source has it (types/slam2d and types/slam2d_addons), one element a line:

    VERTEX_SE2 id x y theta
    VERTEX_LINE2D id theta rho p1 p2            p1, p2: vertices of its end points, -1 for none
    FIX id ...
    EDGE_PRIOR_SE2 id x y theta I11 I12 I13 I22 I23 I33
    EDGE_SE2 i j x y theta I11 I12 I13 I22 I23 I33
    EDGE_SE2_LINE2D i line theta rho I_tt I_tr I_rr

Information is the upper triangle, by rows. A line's ``theta`` is our alpha, and comes first. The
residual of EDGE_SE2_LINE2D is prediction - measurement with ``theta`` modulo a full turn: without
the twin, so that a measurement has to be named by the twin that its line is predicted as. The
residuals of EDGE_SE2 and EDGE_PRIOR_SE2 are ours, turned into the frame of the *measured* pose:
the same cost, if the information is turned likewise.

Lines that begin with ``#`` are comments to g2o. Ours that begin with ``#@`` say of the element in
the next line what g2o has no place for: ``#@ t 1.25`` when a pose was, ``#@ seen -0.2 0.5`` over
which stretch a line was seen.
"""

from __future__ import annotations

import numpy as np

from graphslam.geometry import Array, rotate_covariance

VERTEX_POSE, VERTEX_LINE = "VERTEX_SE2", "VERTEX_LINE2D"
EDGE_PRIOR, EDGE_POSE, EDGE_LINE = "EDGE_PRIOR_SE2", "EDGE_SE2", "EDGE_SE2_LINE2D"
FIX = "FIX"
NOTE, NOTE_TIME, NOTE_SEEN = "#@", "t", "seen"


def pose_information(cov: Array, measured: Array) -> Array:
    """Returns what g2o calls the information (K, 3, 3) of measured poses.

    Args:
        cov: (K, 3, 3) covariances in the frame that the poses are given in.
        measured: (K, 3) measured poses, or increments.
    """
    return np.linalg.inv(rotate_covariance(cov, -measured[:, 2]))


def pose_covariance(information: Array, measured: Array) -> Array:
    """Returns the inverse of `pose_information`: covariances (K, 3, 3) in the outer frame."""
    cov = rotate_covariance(np.linalg.inv(information), measured[:, 2])
    return 0.5 * (cov + np.swapaxes(cov, 1, 2))


def swapped(values: Array) -> Array:
    """Returns ``(rho, alpha)`` (K, 2) as ``(theta, rho)``, or matrices (K, 2, 2) in that order."""
    return values[:, ::-1, ::-1] if values.ndim == 3 else values[:, ::-1]
