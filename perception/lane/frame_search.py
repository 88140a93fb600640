"""The lanes that one frame supports: between lines or edges, near a predicted lane or anywhere."""

from functools import cached_property

from perception.lane.detection.edges import RoadImage
from perception.lane.detection.search import find_lane, find_road, follow_road
from perception.lane.detection.vote import VoteSettings
from perception.lane.model.evidence import LaneFit
from perception.lane.model.geometry import LaneState, RoadPoints
from perception.lane.model.prior import straightened
from perception.lane.settings import LaneCvSettings
from perception.lane.view import View
from trepid.types import Floats, Image


class FrameSearch:
    """Fits lanes to one frame. Points of lines and road likelihood are computed once, when first needed."""

    def __init__(self, image: Image, view: View, settings: LaneCvSettings) -> None:
        self._image, self._view, self._settings = image, view, settings

    def lines_anywhere(self) -> LaneFit:
        """The best lane between lines over all shapes of the prior."""
        vote, prior = self._settings.vote, self._settings.prior
        lane = prior.lane
        return self._lines(lane, (vote.cold, vote.refine), straight=straightened(lane, prior))

    def lines_near(self, predicted: LaneState) -> LaneFit:
        """The best lane between lines among shapes around ``predicted``."""
        return self._lines(predicted, (self._settings.vote.tracked,))

    def lines_at(self, predicted: LaneState) -> LaneFit:
        """The lane between the lines of ``predicted``, without a search."""
        return self._lines(predicted, ())

    def edges_anywhere(self) -> LaneFit:
        """The best road between edges over all shapes of the prior."""
        settings = self._settings
        road = settings.prior.road
        return find_road(
            self._view.edges,
            self._road_image,
            road,
            straight=straightened(road, settings.prior),
            fit=settings.edge_fit,
            evidence=settings.evidence,
        )

    def edges_at(self, predicted: LaneState) -> LaneFit:
        """The road between the edges of ``predicted``, without a search."""
        settings = self._settings
        return follow_road(
            self._view.edges,
            self._road_sums,
            predicted,
            fit=settings.edge_fit,
            evidence=settings.evidence,
        )

    @cached_property
    def _points(self) -> RoadPoints:
        return self._view.markings.points(self._image)

    @cached_property
    def _road_image(self) -> RoadImage:
        return self._view.edges.prepared(self._image)

    @cached_property
    def _road_sums(self) -> Floats:
        return self._view.edges.sums(self._road_image)

    def _lines(
        self, prior: LaneState, stages: tuple[VoteSettings, ...], *, straight: LaneState | None = None
    ) -> LaneFit:
        return find_lane(
            self._points,
            prior,
            stages,
            self._view.grid,
            fit=self._settings.fit,
            evidence=self._settings.evidence,
            prior_weight=self._settings.vote.prior_weight,
            min_support=self._settings.vote.min_support,
            straight=straight,
        )
