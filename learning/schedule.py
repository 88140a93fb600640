"""Learning-rate schedule of both trainings."""

import math


def warm_up_cosine(done: float, *, warm_up: float) -> float:
    """Factor of the learning rate at the share ``done`` of all steps: a linear rise, then half a cosine to zero."""
    if done < warm_up:
        return done / warm_up
    return (1 + math.cos(math.pi * (done - warm_up) / (1 - warm_up))) / 2
