"""Why each term is feared: the reasons behind the inputs of ``config/fear.yaml``, for ``docs/fear_terms.md``."""

_UNLIKE = "a network is surest where it learned least; its jumps show it before its confidence does"

WHY = {
    "frame_age": "the road is driven as it was: at 8 m/s every 0.1 s is 0.8 m of blind driving",
    "estimator_age": "a process that hangs sends nothing, and Zenoh reports it only after seconds",
    "state_age": "without speed and yaw rate neither memory nor prediction holds",
    "lane_confidence": "calibrated: 1 minus it is the chance that the steering is more than 2° wrong",
    "second_confidence": "a lone witness cannot be checked; two seers rarely err alike (Fridman, Arguing Machines)",
    "sight": "a tracker stays sure for a while after the road has gone; this one does not",
    "cv_confidence": "the estimator that measures finds nothing to measure: worn, covered or missing lines",
    "cnn_confidence": "the network says itself that it has not learned this",
    "cv_jitter": "a road does not jump: what jumps is the estimate (tracker between two lines, false edges)",
    "cnn_jitter": f"its uncertainty and shift: {_UNLIKE}",
    "cnn_unrest": "on roads that it knows the network is steady; on trodden snow it wanders, sure of itself, and a "
    "short jitter is calm again and again",
    "angle_confidence": "as of every estimator; an angle has no lane by which it could be checked",
    "angle_jitter": "a road does not jump, so an angle that does is wrong at least in some frames",
    "single_source": "for moments one estimator will do; the longer, the likelier an error that nobody sees",
    "disagreement": "in lateral acceleration, so that the same angle counts more at speed; foretells 90 % of hard "
    "disengagements (Fridman, Arguing Machines)",
    "separation": "two places across the lane: one of them is beside the lane",
    "lane_width_error": "lanes have widths: another one is a shoulder, two lanes or a tar seam",
    "lane_width": "the room for errors on a bridge, beside road works, on a narrow road; a bridge as such is not "
    "recognised",
    "unmarked": "unstructured roads have ragged edges, no norm and no centre line (inventory F03)",
    "edge_doubt": "trodden snow shows edges of its own by patches; a road without lines shows its edges all along",
    "brightness": "nothing is seen in the dark (inventory F08: average pixels)",
    "contrast": "fog, a fogged lens, a wall: nothing to hold on to",
    "over_exposed": "white pixels carry no road: low sun, tunnel exit (inventory F03)",
    "under_exposed": "black pixels carry no road",
    "sharpness": "out of focus, a drop on the lens: edges and lines are gone",
    "frozen": "a picture of the past, driven into the future; also by turns or in a loop",
    "spots": "dirt hides lines, and its edges look like edges",
    "speed": "energy and distance grow with it; every other fear counts more",
    "lateral_demand": "beyond 3 m/s² comfort ends (ISO 11270), on wet or snowy roads grip",
    "lateral_error": "who is off the centre has less room to err",
    "crossing": "the last warning: at this heading a wheel will be over the line so soon",
    "saturated": "the limiter does not let the car do what the path needs, so it goes elsewhere",
    "lead_confidence": "without a leader there is nobody to follow when the road is lost",
    "time_gap": "its brakes are better than our reaction",
    "lead_distance": "traffic hides the road beyond it, its bends included (inventory F03)",
}
