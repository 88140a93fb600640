"""The world of another package that a scenario names instead of a road."""

from typing import Annotated

from pydantic import AfterValidator, Field

from trepid import plugins
from trepid.config import Settings
from trepid.spelling import did_you_mean

_OF_ROAD = (
    *(
        "road",
        "segments",
        "marks",
        "humps",
        "junctions",
        "walls",
        "elevation",
        "lane_width_m",
        "appearance",
        "start",
    ),
    *("plant", "disturbances", "traffic", "road_users"),
)
"""Fields of a scenario that describe the simulator's own world."""
_SENSORS = ("lead_sensor", "road_user_sensor")


def _is_known(model: str) -> str:
    known = plugins.names(plugins.Group.WORLDS, {})
    if model not in known:
        hint = did_you_mean(model, known) if known else "no package here adds one (docs/plugins.md)"
        raise ValueError(f"unknown world {model!r}; {hint}")
    return model


class WorldChoice(Settings):
    """A world by the name of its entry point, and its options."""

    model: Annotated[str, AfterValidator(_is_known)]
    options: dict[str, bool | float | str] = Field(default_factory=dict)  # keyword arguments of the world

    def problem_beside(self, scenario: Settings) -> tuple[tuple[str], str] | None:
        """The first field of ``scenario`` that this world has no use for, and the message; None without any."""
        for name in _OF_ROAD:
            if name in scenario.model_fields_set and getattr(scenario, name):
                return (name,), f"belongs to the simulated road; the world {self.model!r} has its own"
        for name in _SENSORS:
            if getattr(scenario, name) not in (None, "camera"):
                return (name,), f"the world {self.model!r} has no such sensor; camera looks into its pictures"
        return None
