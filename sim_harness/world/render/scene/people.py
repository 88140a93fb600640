"""People, cyclists and animals: their sizes."""

from dataclasses import dataclass
from enum import StrEnum


class Shape(StrEnum):
    """Size class of a road user."""

    ADULT = "adult"
    CHILD = "child"
    CYCLIST = "cyclist"
    DOG = "dog"
    DEER = "deer"


class Kind(StrEnum):
    """The kinds of road users that a detector distinguishes: ``RoadUsers.kinds``."""

    PERSON = "person"
    CYCLIST = "cyclist"
    ANIMAL = "animal"


@dataclass(frozen=True, slots=True)
class Figure:
    """A road user; the origin is the middle of its ground contact."""

    shape: Shape
    kind: Kind
    length_m: float
    width_m: float
    height_m: float


FIGURES = {
    Shape.ADULT: Figure(Shape.ADULT, Kind.PERSON, 0.60, 0.50, 1.80),
    Shape.CHILD: Figure(Shape.CHILD, Kind.PERSON, 0.45, 0.30, 1.154),
    Shape.CYCLIST: Figure(Shape.CYCLIST, Kind.CYCLIST, 1.89, 0.50, 1.865),
    Shape.DOG: Figure(Shape.DOG, Kind.ANIMAL, 0.90, 0.25, 0.75),
    Shape.DEER: Figure(Shape.DEER, Kind.ANIMAL, 1.20, 0.35, 1.15),
}
"""Heights and widths of the Euro NCAP pedestrian and bicyclist targets (ISO 19206-2 and -4), lengths of a stride
and of a bicycle; a dog like a German shepherd (withers 0.60 to 0.65 m, FCI standard 166); a roe deer.
"""
