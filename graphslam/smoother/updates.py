"""GTSAM's two ways to take in one node after the other: all poses kept, or those of a window.

Both are told to eliminate by QR, and both hold a reference to the linearisation point: without it
GTSAM copies all variables into every call of a Python factor.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any, Protocol

import gtsam
import numpy as np

from graphslam.geometry import Array
from graphslam.models import MODELS
from graphslam.models.base import PartlyLinear
from graphslam.smoother.factors import landmark_key, pose_key


class Step:
    """What one node adds.

    Attributes:
        node: its number.
        graph: factors.
        values: new variables, at a first guess.
        landmarks: numbers of the new landmarks.
    """

    def __init__(self, node: int) -> None:
        self.node = node
        self.graph, self.values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        self.landmarks: list[int] = []

    def add_pose(self, pose: Array) -> None:
        """Adds the node's pose (3,), floor frame."""
        self.values.insert(pose_key(self.node), gtsam.Pose2(*pose.tolist()))

    def add_landmark(self, landmark: int, params: Array) -> None:
        """Adds a landmark (l,), floor frame."""
        self.values.insert(landmark_key(landmark), np.array(params, float))
        self.landmarks.append(landmark)


class Updates(Protocol):
    """Takes in one node after the other.

    Attributes:
        method: name of what comes out.
        causal: whether each pose is told at its own time.
        solver: GTSAM's, to be asked for estimates and marginal covariances.
    """

    method: str
    causal: bool
    solver: Any

    def take(self, step: Step) -> None:
        """Updates all variables with what a node adds."""
        ...

    def told(self, node: int, last: bool) -> Iterable[int]:
        """Returns the nodes whose poses are told once ``node`` is taken in."""
        ...

    def holds(self, node: int) -> bool:
        """Returns whether the pose of an earlier node is a variable still."""
        ...

    def linear(self) -> gtsam.GaussianFactorGraph:
        """Returns all factors, linearised at the estimate; what was marginalised included."""
        ...

    def path(self, told: Array) -> Array:
        """Returns the best poses (N, 3) at the end, given those that were told, floor frame."""
        ...


class Whole:
    """iSAM2 over all poses."""

    method, causal = "isam2", True

    def __init__(self, relinearise: float, kinds: Collection[str]) -> None:
        self.solver: Any = gtsam.ISAM2(_parameters(relinearise, kinds))
        self._held = self.solver.getLinearizationPoint()

    def take(self, step: Step) -> None:
        self.solver.update(step.graph, step.values)

    def told(self, node: int, last: bool) -> Iterable[int]:
        return (node,)

    def holds(self, node: int) -> bool:
        return True

    def linear(self) -> gtsam.GaussianFactorGraph:
        factors: gtsam.NonlinearFactorGraph = self.solver.getFactorsUnsafe()
        return factors.linearize(self.solver.calculateEstimate())

    def path(self, told: Array) -> Array:
        return np.array(gtsam.utilities.extractPose2(self.solver.calculateEstimate()))


class Window:
    """GTSAM's fixed-lag smoother: a pose that is older than the lag is marginalised.

    Landmarks get the newest time with every node, so they never are.
    """

    method, causal = "fixed-lag", False

    def __init__(self, t: Array, lag_s: float, relinearise: float, kinds: Collection[str]) -> None:
        parameters = _parameters(relinearise, kinds)
        self.solver: Any = gtsam.IncrementalFixedLagSmoother(lag_s, parameters)
        self._held = self.solver.getLinearizationPoint()
        self._t, self._lag, self._first = t - t[0], lag_s, 0
        self._landmarks: list[int] = []

    def take(self, step: Step) -> None:
        now = float(self._t[step.node])
        self._landmarks += map(landmark_key, step.landmarks)
        stamps: dict[Any, Any] = dict.fromkeys([*self._landmarks, pose_key(step.node)], now)
        self.solver.update(step.graph, step.values, stamps)

    def told(self, node: int, last: bool) -> Iterable[int]:
        """Returns the poses that the next node will put out of the window; at the end all."""
        end = len(self._t) if last else self._oldest(node + 1)
        leaving = range(self._first, min(end, node + 1))
        self._first = max(self._first, leaving.stop)
        return leaving

    def holds(self, node: int) -> bool:
        return node >= self._first

    def linear(self) -> gtsam.GaussianFactorGraph:
        factors: gtsam.NonlinearFactorGraph = self.solver.getFactors()
        return factors.linearize(self.solver.calculateEstimate())

    def path(self, told: Array) -> Array:
        return told

    def _oldest(self, node: int) -> int:
        """Returns the first node that is in the window of ``node``, as GTSAM counts."""
        return int(np.searchsorted(self._t, self._t[node] - self._lag, side="left"))


def thresholds(relinearise: float, kinds: Collection[str]) -> dict[str, Array]:
    """Returns from which change on each entry of a pose and of a landmark is linearised anew.

    Not for what a residual is linear in: rho of a line far from the origin moves by centimetres
    with a thousandth of alpha, and no Jacobian changes. Empty where landmarks of several lengths
    are variables, which GTSAM's table, by the first letter of their keys, cannot tell apart.

    Args:
        relinearise: threshold of everything else, m or rad.
        kinds: of the landmarks that are variables.
    """
    models = [MODELS[kind] for kind in sorted(kinds)]
    if len({model.dim_landmark for model in models}) != 1:
        return {}
    landmark = np.full(models[0].dim_landmark, np.inf)
    for model in models:
        linear = model.linear_in if isinstance(model, PartlyLinear) else ()
        bent = np.setdiff1d(np.arange(len(landmark)), linear)
        landmark[bent] = relinearise
    return {"x": np.full(3, relinearise), "l": landmark}


def _parameters(relinearise: float, kinds: Collection[str]) -> gtsam.ISAM2Params:
    parameters = gtsam.ISAM2Params()
    parameters.setFactorization("QR")
    table = gtsam.ISAM2ThresholdMap()
    for letter, least in thresholds(relinearise, kinds).items():
        table.insert((letter, least))
    parameters.setRelinearizeThreshold(relinearise if table.empty() else table)
    parameters.relinearizeSkip = 1
    parameters.findUnusedFactorSlots = True
    return parameters
