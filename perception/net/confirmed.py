"""Estimator ``cnn`` without a camera file: its lane counts as far as lines and kerbs in the image confirm it.

The network measures lengths in the world of its training: lanes of certain widths, seen from certain heights. In
the image of another camera a lane of another width can look like one of these beside its true place, and the
network gives it the same probability. With the lane of ``cv`` as witness (:mod:`perception.lane.which_lane`), which
measures the boundaries at any height and is right with the probability c, the confidence is

    P = p·c·a

with the probability p of the network and the agreement a of the boundaries of both lanes; it is 0 without a lane of
the witness. The witness processes every frame, so that its lane is that of ``cv``. The camera that it measures
while driving is that of the network too.
"""

from dataclasses import replace

from perception.camera.uncertainty import with_camera_doubt
from perception.lane.agreement import apart
from perception.lane.outline import with_boundaries
from perception.lane.which_lane import WhichLane
from perception.net.steer_net import SteerNet
from trepid.car.vehicle import Vehicle
from trepid.messages import Frame, SteeringEstimate, VehicleState

CONFIRMED, DENIED = 0.1, 0.3  # distance of the boundaries of both lanes, in widths of the lane
UNCONFIRMED = "lines and kerbs in the image do not confirm the lane of the network"


class ConfirmedNet:
    """Estimator ``cnn`` for a self-calibrated camera. Its state is that of the witness."""

    def __init__(self, network: SteerNet, witness: WhichLane, vehicle: Vehicle) -> None:
        """Both for the same camera and ``vehicle``."""
        self._network, self._witness, self._vehicle = network, witness, vehicle
        self._camera = witness.camera

    def step(self, frame: Frame, state: VehicleState | None, *, now_s: float) -> SteeringEstimate:
        """The lane of the network, with the confidence that the image confirms."""
        seen = self._witness.step(frame, state, now_s=now_s)
        if self._witness.camera is not self._camera:
            self._camera = self._witness.camera
            self._network = self._network.through(self._camera)
        found = self._network.step(frame, state, now_s=now_s)
        if found.lateral_offset_m is None:
            return found
        found = with_boundaries(found, self._camera, self._vehicle)
        share = apart(found, seen, frame.image.shape[0])
        confidence = found.confidence * seen.confidence * agreement_degree(share)
        reason = UNCONFIRMED if confidence < found.confidence / 2 else ""
        return with_camera_doubt(replace(found, confidence=confidence, reason=reason), self._witness.belief)


def agreement_degree(share: float | None) -> float:
    """1 up to ``CONFIRMED``, 0 from ``DENIED`` on and without a lane, linear between."""
    return 0.0 if share is None else min(max((DENIED - share) / (DENIED - CONFIRMED), 0.0), 1.0)
