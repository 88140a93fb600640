"""What the benchmarks of random traffic share: one scenario on a straight road, rendered or modelled."""

from typing import Any

import numpy as np

from sim_harness.scenarios.scenario import LeadSensor, Scenario, Sight

SHAPES = {"car": 0.7, "van": 0.15, "truck": 0.15}
"""Shape of a vehicle -> its share."""


def random_shape(rng: np.random.Generator) -> str:
    """One of SHAPES by its share."""
    return str(rng.choice(list(SHAPES), p=list(SHAPES.values())))


def drawn_scenario(
    name: str, description: str, *, rendered: bool, start_mps: float, **fields: Any
) -> Scenario:
    """A scenario that starts on the move, with further ``fields``.

    ``rendered``: images and the camera's detector; else the true lane and the modelled detector.
    """
    return Scenario.model_validate(
        {
            "name": name,
            "description": description,
            "tags": ["traffic"],
            "road": "straight",
            "start": {"speed_mps": start_mps},
            "sight": Sight.CAMERA if rendered else Sight.TRUTH,
            "lead_sensor": LeadSensor.CAMERA if rendered else LeadSensor.MODELLED,
            **fields,
        }
    )
