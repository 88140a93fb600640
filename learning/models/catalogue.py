"""The networks of ``trepid train --model``, by name; building one imports torch, the list does not."""

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from trepid.config import InputError
from trepid.spelling import did_you_mean

if TYPE_CHECKING:
    from learning.models.parts.heads import HeadName
    from learning.models.parts.network import SteeringNetwork


class Model(NamedTuple):
    """A network: the function that builds it, and what the list says of it."""

    module: str  # below learning.models
    function: str
    height: int
    width: int
    head: "HeadName"
    parameters: int  # of the network with this size and head
    source: str
    recurrent: bool = False


MODELS: dict[str, Model] = {
    "steer": Model("steer", "steer", 60, 80, "gaussian", 169_626, "Trepid"),
    "steer-motion": Model("steer", "motion", 60, 80, "gaussian", 171_846, "Trepid", recurrent=True),
    "steer-lstm": Model("steer", "lstm", 60, 80, "gaussian", 182_238, "Trepid", recurrent=True),
    "pilotnet": Model(
        "papers", "pilotnet", 100, 200, "regression", 252_219, "Bojarski et al. 2016, DAVE-2; N01"
    ),
    "chen-huang": Model(
        "papers", "chen_huang", 160, 320, "regression", 7_662_805, "Chen and Huang 2017; N07"
    ),
    "rausch": Model("papers", "rausch", 80, 160, "regression", 730_461, "Rausch et al. 2017; N08"),
    "jain": Model("papers", "jain", 8, 16, "categorical", 5_316, "Jain 2018; N10"),
    "donkey-linear": Model(
        "papers", "donkey_linear", 120, 160, "regression", 816_977, "donkeycar, KerasLinear"
    ),
    "donkey-categorical": Model(
        "papers", "donkey_categorical", 120, 160, "categorical", 267_291, "donkeycar, KerasCategorical"
    ),
    "cnn-lstm": Model(
        "papers",
        "cnn_lstm",
        60,
        80,
        "regression",
        287_159,
        "Haavaldsen et al. 2019; N05, N09",
        recurrent=True,
    ),
    "inception-v3": Model(
        "deep_steer", "inception_v3", 240, 320, "regression", 23_884_769, "Deep Steer, fig. 8; N13"
    ),
    "vgg16": Model("deep_steer", "vgg16", 240, 320, "regression", 15_241_025, "Deep Steer; N13"),
    "vgg19": Model("deep_steer", "vgg19", 240, 320, "regression", 20_550_721, "Deep Steer; N13"),
    "inception-rnn-as-printed": Model(
        "deep_steer",
        "rnn_as_printed",
        240,
        320,
        "regression",
        24_031_457,
        "Deep Steer, fig. 22: length 1; N16",
    ),
    "inception-rnn": Model(
        "deep_steer",
        "rnn",
        240,
        320,
        "regression",
        24_031_457,
        "Deep Steer, fig. 22, true sequence; N16",
        recurrent=True,
    ),
    "efficientnet-lite0": Model(
        "efficientnet", "efficientnet_lite0", 112, 144, "regression", 3_372_289, "Tan and Le 2019, Lite0"
    ),
}


def model(name: str) -> Model:
    """Raises InputError for an unknown name."""
    if name not in MODELS:
        raise InputError(
            f"no model {name!r}; {did_you_mean(name, MODELS)}; `trepid train --model list` prints all"
        )
    return MODELS[name]


def packaged_weights(name: str) -> Path | None:
    """File with weights of the trunk of the network ``name`` in an installed package; None without one."""
    module = import_module(f"learning.models.{model(name).module}")
    found: Path | None = module.packaged() if hasattr(module, "packaged") else None
    return found


def build(
    name: str, *, height: int | None = None, width: int | None = None, head: "HeadName | None" = None
) -> "SteeringNetwork":
    """The untrained network ``name``; without arguments of its usual size and head. Raises InputError."""
    from learning.models.parts.heads import HEADS
    from learning.models.parts.network import Size

    chosen = model(name)
    function = getattr(import_module(f"learning.models.{chosen.module}"), chosen.function)
    network: SteeringNetwork = function(
        Size(height or chosen.height, width or chosen.width), HEADS[head or chosen.head]()
    )
    return network
