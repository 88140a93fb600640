"""The lanes that one frame supports: between lines or edges, near a predicted lane or anywhere."""

from dataclasses import replace
from functools import cached_property

import numpy as np

from perception.lane.detection.edges import RoadImage
from perception.lane.detection.fitter import LaneFitter, on_middles
from perception.lane.detection.vote import VoteSettings, vote_lane
from perception.lane.model.evidence import NO_SUPPORT, LaneFit
from perception.lane.model.geometry import PITCH, LaneState, RoadPoints, level_points
from perception.lane.model.prior import straight_prior
from perception.lane.settings import LaneCvSettings
from perception.lane.view import ViewTables
from trepid.types import Array, Floats, Image


class FrameSearch:
    """Fits lanes to one frame. Points of lines and road likelihood are computed once, when first needed.

    A search over all shapes also fits a straight lane, which wins unless the points favour the bent one.
    """

    def __init__(self, image: Image, view: ViewTables, settings: LaneCvSettings) -> None:
        self._image, self._view, self._settings = image, view, settings
        self._line_fitter = LaneFitter(view.grid, settings.fit, settings.evidence)
        self._edge_fitter = LaneFitter(view.edges.grid, settings.edge_fit, settings.evidence)

    def lines_anywhere(self) -> LaneFit:
        """The best lane between lines over all shapes of the prior."""
        return self.lines_like(self.shape_anywhere())

    def shape_anywhere(self) -> LaneState | None:
        """The first half of :meth:`lines_anywhere`: the shape with the most votes; None without enough of them."""
        vote, prior = self._settings.vote, self._settings.prior
        return self._vote_shape(prior.lane, (vote.cold, vote.refine))

    def lines_like(self, shape: LaneState | None, remembered: LaneState | None = None) -> LaneFit:
        """The second half of :meth:`lines_anywhere`: the lane between the lines near ``shape``.

        ``remembered``: the lane that the lines are known to continue, instead of the prior of all lanes.
        """
        prior = self._settings.prior
        if shape is None:
            return _nothing(prior.lane)
        if remembered is not None:
            return self._between_lines(remembered, shape.mean)
        return self._between_lines(prior.lane, shape.mean, straight_prior(prior.lane, prior))

    def lines_near(self, predicted: LaneState) -> LaneFit:
        """The best lane between lines among shapes around ``predicted``."""
        shape = self._vote_shape(predicted, (self._settings.vote.tracked,))
        return _nothing(predicted) if shape is None else self._between_lines(predicted, shape.mean)

    def lines_at(self, predicted: LaneState) -> LaneFit:
        """The lane between the lines of ``predicted``, without a search; shorter pieces of line count as seen."""
        return self._between_lines(predicted, predicted.mean, foreseen=True)

    def edges_anywhere(self) -> LaneFit:
        """The road whose edges enclose the most road likelihood: among all shapes, then near the best one."""
        return self._road_anywhere

    @cached_property
    def _road_anywhere(self) -> LaneFit:
        finder, prior = self._view.edges, self._settings.prior
        sums, steps = self._road_sums, finder.steps(self._road_image)
        start = finder.search(sums, steps, prior.road)
        sums = finder.sums(self._road_image, lane=start)
        start = finder.search(sums, steps, prior.road, near=start)
        return self._between_edges(sums, prior.road, start, straight_prior(prior.road, prior))

    def edges_at(self, predicted: LaneState) -> LaneFit:
        """The road between the edges of ``predicted``, without a search."""
        return self._between_edges(self._road_sums, predicted, predicted.mean)

    def line_within(self, lane: LaneState) -> float:
        """Support of the strongest line inside ``lane``, which then is two lanes; 0 without one."""
        return self._line_fitter.line_within(self._points, lane.mean)

    @cached_property
    def _points(self) -> RoadPoints:
        return self._view.markings.points(self._image)

    @cached_property
    def _road_image(self) -> RoadImage:
        return self._view.edges.prepare(self._image)

    @cached_property
    def _road_sums(self) -> Floats:
        return self._view.edges.sums(self._road_image)

    def _vote_shape(self, prior: LaneState, stages: tuple[VoteSettings, ...]) -> LaneState | None:
        """``prior`` at the shape with the most votes in the last of ``stages``, each around the one before."""
        vote, grid = self._settings.vote, self._view.grid
        x_m, y_m = level_points(self._points, prior.mean[PITCH], grid.camera)
        flat = self._points._replace(x_m=x_m, y_m=y_m)
        start, support = prior.mean, 0.0
        for stage in stages:
            start, support = vote_lane(
                flat, start, prior, stage, bands=len(grid.ahead_m), prior_weight=vote.prior_weight
            )
        return replace(prior, mean=start) if support >= vote.min_support else None

    def _between_lines(
        self, prior: LaneState, start: Array, straight: LaneState | None = None, *, foreseen: bool = False
    ) -> LaneFit:
        """The lane fitted to the points near the boundaries of ``start``."""
        fitter, count = self._line_fitter, len(self._points.x_m)
        near, side = fitter.assign_sides(self._points, start)
        fitted = fitter.solve(near, side, prior, start, straight)
        middles = on_middles(near, side, fitted.residual_m)
        if middles is not near:
            near = middles
            fitted = fitter.solve(near, side, prior, fitted.state.mean, straight)
        lane = fitter.with_evidence(fitted, near, side, count=count, foreseen=foreseen)
        if lane.boundaries_seen != 1:
            return lane
        # Points near the missing line are no line, so they must not change the width.
        own = np.flatnonzero(side == (1.0 if lane.left.seen else -1.0))
        near, side = near.part(own), side[own]
        fitted = fitter.solve(near, side, prior, fitted.state.mean, straight)
        return fitter.with_evidence(fitted, near, side, count=count, foreseen=foreseen)

    def _between_edges(
        self, sums: Floats, prior: LaneState, start: Array, straight: LaneState | None = None
    ) -> LaneFit:
        """The road fitted to the edges near those of ``start``, as a lane as wide as the road."""
        finder, fitter = self._view.edges, self._edge_fitter
        points, side = finder.points(sums, start)
        fitted = fitter.solve(points, side, prior, start, straight)
        road = fitter.with_evidence(fitted, points, side, count=len(points.x_m))
        return replace(road, by_edges=True, apart=finder.apart(sums, road.state.mean))


def _nothing(prior: LaneState) -> LaneFit:
    return LaneFit(state=prior, left=NO_SUPPORT, right=NO_SUPPORT, residual=0.0)
