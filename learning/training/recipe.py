"""The recipe of a training: ``config/driving_train.yaml``, overridden by a file of the user, for one network."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field
from ruamel.yaml.comments import CommentedMap

from learning.models.catalogue import MODELS, model
from trepid.config import CONFIG_DIR, InputError, Settings, fault_line, overlay, parse, read
from trepid.spelling import did_you_mean
from trepid.types import NonNegative, Positive, PositiveShare, Share

DEFAULT = "driving_train.yaml"
Count = Annotated[int, Field(ge=1)]
Factor = Annotated[float, Field(ge=1)]


class Augmentation(Settings):
    """Section ``augmentation``: a share of the frames for each change, and its bounds."""

    flip: Share
    brightness: Share
    gain: Factor
    gamma: Factor
    colour: Share
    offset_grey: NonNegative
    shadow: Share
    blur: Share
    blur_px: NonNegative
    noise: Share
    noise_grey: NonNegative
    erase: Share
    erase_size: Share
    shift: Share
    shift_share: Share
    rain: Share
    snow: Share
    fog: Share
    flicker: Share
    viewpoint: Share
    viewpoint_m: NonNegative
    viewpoint_rad: NonNegative
    viewpoint_ahead_m: Positive


class Stage(Settings):
    """A part of a training with one learning rate."""

    name: str
    part: Literal["all", "top"]
    epochs: Count
    learning_rate: Positive
    schedule: Literal["cosine", "constant"]
    patience: Count


class Recipe(Settings):
    """All numbers of a training."""

    seed: Annotated[int, Field(ge=0, lt=2**63)]
    threads: Count
    batch: Count
    optimiser: Literal["sgd", "nag", "adagrad", "adadelta", "rmsprop", "adam", "nadam", "adamw"]
    momentum: Share
    weight_decay: NonNegative
    stages: Annotated[tuple[Stage, ...], Field(min_length=1)]
    warm_up: Share
    average: Annotated[float, Field(ge=0, lt=1)]
    head: Literal["regression", "gaussian", "laplace", "categorical"] | None = None
    loss: Literal["mse", "mae", "huber"]
    label_delay_s: float | Literal["measured"]
    label_smoothing_s: NonNegative
    beta: Share
    unit: Literal["spread", "lock", "rad"]
    height_px: Count | None = None
    width_px: Count | None = None
    dropout: Annotated[float, Field(ge=0, lt=1)] | None = None
    histogram: Literal["none", "equalise", "match"]
    speed: bool
    speed_weight: Positive
    flip_bias: Share
    initialisation: Literal["network", "glorot", "he"]
    weights: Path | None = None
    pretrain_epochs: Annotated[int, Field(ge=0)]
    pretrain_rate: Positive
    balance: Share
    balance_bins: Annotated[int, Field(ge=2)]
    frames_share: PositiveShare
    window: Count
    stride: Count
    mixed_precision: Literal["gpu", "always", "never"]
    checkpoint_s: NonNegative
    augmentation: Augmentation


def load_recipe(name: str, given: Path | None, *, overrides: Mapping[str, str] | None = None) -> Recipe:
    """The recipe of the network ``name``. Later ones override: the defaults, theirs for the network, the file
    ``given``, its for the network, ``overrides``. Raises InputError with file:line:column.
    """
    chosen = model(name)
    data = _with_model(read(CONFIG_DIR / DEFAULT), CONFIG_DIR / DEFAULT, name)
    if data.get("head") is None:
        data["head"] = chosen.head
    if given is not None:
        overlay(data, _with_model(read(given), given, name), given)
    return parse(data, Recipe, source=CONFIG_DIR / DEFAULT, overrides=overrides)


def _with_model(data: CommentedMap, source: Path, name: str) -> CommentedMap:
    """``data`` overridden by its own section for the network ``name``. Raises InputError for an unknown name."""
    sections = data.get("models") or CommentedMap()
    for other, section in sections.items():
        if other not in MODELS:
            what = f"no such network; {did_you_mean(other, MODELS)}"
            raise InputError(fault_line(["models", other], what, data, source))
        for field in section or ():
            if field not in Recipe.model_fields:
                what = f"no such field; {did_you_mean(field, Recipe.model_fields)}"
                raise InputError(fault_line(["models", other, field], what, data, source))
    data.pop("models", None)
    overlay(data, sections.get(name) or CommentedMap(), source)
    return data
