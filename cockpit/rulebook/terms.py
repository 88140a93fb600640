"""Why each input is an indicator of risk: the reasons for the inputs of ``config/fear.yaml``, for the docs page."""

_UNLIKE = (
    "a network reports high confidence even on images unlike its training data; its jumps show that earlier"
)

WHY = {
    "frame_age": "the path is that of an earlier image: at 8 m/s every 0.1 s is 0.8 m without sight",
    "estimator_age": "a hung process sends nothing, and Zenoh reports it only after seconds",
    "state_age": "neither the path memory nor the prediction works without speed and yaw rate",
    "lane_confidence": "calibrated: 1 - confidence is the probability of a steering error above 2°",
    "second_confidence": "a single estimate cannot be checked; two independent estimators rarely make the same "
    "error (Fridman, Arguing Machines)",
    "sight": "a tracker keeps a high confidence for a while after the road is lost; this input does not",
    "cv_confidence": "the estimator finds no lines or edges: worn, covered or missing markings",
    "cnn_confidence": "the network itself reports an image unlike its training data",
    "cv_jitter": "a road does not jump, so a jump is an error of the estimate (two candidate lines, false edges)",
    "cnn_jitter": f"a measure of uncertainty and of distribution shift: {_UNLIKE}",
    "cnn_path_jitter": "on roads like those of its training data the network is steady; on trodden snow its "
    "estimate wanders at high confidence, and a jitter over a short time is often low",
    "angle_confidence": "as of every estimator; an angle has no lane by which it could be checked",
    "angle_jitter": "a road does not jump, so an angle that jumps is wrong in at least some frames",
    "single_source": "one estimator is enough for a moment; the longer, the more probable an unnoticed error",
    "disagreement": "in lateral acceleration, so that the same angle counts more at speed; predicts 90 % of "
    "difficult disengagements (Fridman, Arguing Machines)",
    "separation": "two different positions across the lane: at least one of them is wrong",
    "lane_width_error": "another width than that of lanes indicates a shoulder, two lanes or a tar seam",
    "lane_width": "the margin for errors on a bridge, at road works, on a narrow road; bridges are not detected",
    "unmarked": "roads without markings have ragged edges, no standard width and no centre line",
    "edge_doubt": "trodden snow shows false edges in places; a road without lines shows its edges all along",
    "brightness": "dark images contain no road",
    "contrast": "fog, a fogged lens or a wall leave no features",
    "over_exposed": "white pixels contain no road: low sun, tunnel exit",
    "under_exposed": "black pixels contain no road",
    "sharpness": "out of focus, or a drop on the lens: edges and lines are lost",
    "frozen": "the image is old; also for two alternating images or a loop",
    "spots": "dirt hides lines, and its outlines look like edges",
    "speed": "energy and stopping distance grow with it; every other risk weighs more",
    "lateral_demand": "above 3 m/s² comfort ends (ISO 11270), on wet or snowy roads grip",
    "lateral_error": "less margin to the lane edge",
    "crossing": "time to line crossing at the present heading",
    "saturated": "the limiter cuts the steering demand, so the vehicle leaves the path",
    "lead_confidence": "no vehicle to follow when the road is lost",
    "time_gap": "the vehicle ahead may brake harder than the reaction time allows",
    "lead_distance": "traffic hides the road beyond it",
}
