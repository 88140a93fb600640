"""Whether a fitted lane or road matches the remembered lane."""

from perception.lane.model.evidence import LaneFit
from perception.lane.model.geometry import PSI, WIDTH, E, LaneState
from perception.lane.model.prediction import TrackSettings


def continues(fit: LaneFit, lane: LaneState, track: TrackSettings) -> bool:
    """Whether offset and heading of ``fit`` are close to those of ``lane``."""
    change = fit.state.mean - lane.mean
    return bool(abs(change[E]) < track.gate_offset_m and abs(change[PSI]) < track.gate_heading_rad)


def encloses(edges: LaneFit, lane: LaneState, neighbour: int, track: TrackSettings) -> bool:
    """Whether both ``edges`` are parallel to ``lane`` and lie just outside it.

    The edge on the side ``neighbour`` (1 left, −1 right, 0 none) lies outside a second lane on that side,
    whose width is known only roughly. At the mouth of a side road an edge is not parallel to the lane.
    """
    change = edges.state.mean - lane.mean
    if edges.boundaries_seen < 2 or abs(change[PSI]) >= track.edge_gate_heading_rad:
        return False
    outside_m = {side: float(change[WIDTH] / 2 - side * change[E]) for side in (1, -1)}
    if neighbour and abs(outside_m.pop(neighbour) - lane.mean[WIDTH]) >= track.edge_gate_width_m:
        return False
    return all(-track.edge_gate_offset_m < gap_m < track.edge_gate_width_m for gap_m in outside_m.values())
