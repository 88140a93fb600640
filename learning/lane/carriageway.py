"""The branch of the lane network that measures a carriageway without lines from edge to edge.

An image has no scale: in the middle of a road for both ways without a line the network sees one wide lane, as it is
from a lower camera. The width in metres tells them apart. The branch reads the activations after the second
convolution of the finished network, whose other outputs it leaves as they are. It gives the output ``carriageway``
(n, 3): offset of the car from the middle of the carriageway and its width [m], both as seen from the canonical
height, and the probability that it has no lines. `python -m learning.lane.carriageway` renews it in the shipped
weights. Needs torch and onnx (extra ``[train]``).
"""

import io
import math
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

import numpy as np
import onnx
import torch
import typer
from torch import Tensor, nn

from learning.descent import ahead, descend, warm_up_cosine
from learning.drawn_frames import LaneSample, add_other_half, drawn_road, snow_up
from learning.lane.augment import Augmenter
from learning.lane.fit import EVALUATION_BATCH, CarriagewayRecipe, Recipe
from learning.lane.frames import TrainingShot, random_frames
from learning.lane.scores import LabelledFrames
from learning.lane.world import SURE, shipped_network
from learning.rendered import SHIPPED, WeightsFolder, origin, run_alone, say, ship
from learning.unlike import activations, add_output, detach
from perception.net.canonical import MIRRORED, CanonicalView, row_of_lane
from perception.net.session import session_of
from perception.net.steer_net import SteerNet, SteerNetRecord, SteerNetSettings
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.roads.drawn import UNMARKED, MarkingKind
from sim_harness.world.roads.road import Road
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, load
from trepid.messages import Frame
from trepid.types import Floats, Image

OUTPUT, FEATURES, PARAMETERS = "carriageway", "features", "carriageway_parameters"
LAYER = 2  # convolutions of the lane network before the branch
OFFSET, WIDTH = 0, 4  # in the row of a lane
LEAST_SPREAD = 0.05  # where all roads have the same width
ROADS, STATIONS_M = 40, (5.0, 20.0, 35.0, 50.0, 65.0)  # of the scores
HALF_WIDTH_M, LANE_WIDTH_M = (2.8, 3.4), (3.4, 4.6)  # ... their halves, and the roads with one lane
NO_ROAD_M = 1e3, 2e3, 3e3, 4e3  # no road is as wide
LINED = tuple(kind for kind in MarkingKind if kind not in UNMARKED)


@dataclass(frozen=True, slots=True)
class CarriagewayShot(TrainingShot):
    """Frames whose label is the carriageway in place of the lane, NaN where lines divide it."""

    def label_frames(self, frames: list[LaneSample]) -> LabelledFrames:
        """Canonical images and carriageways; "visible" where the image shows whether there are lines."""
        view = CanonicalView(self.camera, self.canonical)
        rows = np.full((len(frames), len(MIRRORED)), np.nan, np.float32)
        for row, frame in zip(rows, frames, strict=True):
            paved = frame.carriageway
            if paved.bare:
                middle = frame.lane._replace(offset_m=frame.lane.offset_m - paved.middle_m)
                row[:] = row_of_lane(
                    view.canonical_lane(middle), paved.width_m / view.scale, self.lookahead_m
                )
        return LabelledFrames(
            np.stack([view.image(frame.image) for frame in frames]),
            rows,
            np.array([frame.visible and frame.carriageway.bare is not None for frame in frames], bool),
        )


class Branch(nn.Module):
    """Three convolutions and two dense layers over the ``features`` (n, channels, rows, columns).

    Its raw row holds ln(width) and offset/width of the carriageway, from their middle in units of their spread, and
    the logit of "without lines". A mirrored image has the mirrored carriageway: the middle of the offset is 0.
    """

    def __init__(
        self, features: tuple[int, int, int], recipe: CarriagewayRecipe, carriageways: Tensor
    ) -> None:
        super().__init__()
        middle = torch.stack([carriageways[:, 0].mean(), torch.zeros(())])
        self.register_buffer("middle", middle)
        self.register_buffer(
            "spread", ((carriageways - middle) ** 2).mean(dim=0).sqrt().clamp(min=LEAST_SPREAD)
        )
        layers: list[nn.Module] = []
        before = features[0]
        for stride in (2, 1, 1):
            layers += [
                nn.Conv2d(before, recipe.channels, 3, stride, bias=False),
                nn.BatchNorm2d(recipe.channels),
                nn.ReLU(),
            ]
            before = recipe.channels
        layers += [nn.Flatten(), nn.Dropout(recipe.dropout), nn.LazyLinear(recipe.hidden), nn.ReLU()]
        self.layers = nn.Sequential(*layers, nn.Linear(recipe.hidden, 3))
        self.size = features
        self.layers(torch.zeros(2, *features))  # sizes the first dense layer

    def forward(self, features: Tensor) -> Tensor:
        """Offset [m], width [m] and probability of "without lines", shape (n, 3)."""
        raw = self.layers(features)
        width_share = raw[:, :2] * self.spread + self.middle
        width_m = width_share[:, 0].exp()
        return torch.stack([width_share[:, 1] * width_m, width_m, torch.sigmoid(raw[:, 2])], dim=1)

    def loss(self, features: Tensor, carriageways: Tensor) -> Tensor:
        """Huber loss of the carriageways, where there are some, plus cross-entropy of "without lines"."""
        raw, bare = self.layers(features), ~torch.isnan(carriageways[:, 0])
        wanted = (carriageways[bare] - self.middle) / self.spread
        measured = nn.functional.smooth_l1_loss(raw[bare, :2], wanted, reduction="sum") / max(
            int(bare.sum()), 1
        )
        return measured + nn.functional.binary_cross_entropy_with_logits(raw[:, 2], bare.float())


def add_carriageway(path: Path, recipe: Recipe, shot: TrainingShot, *, folder: Path, reuse: bool) -> int:
    """Give the network ``path`` the output ``carriageway``; returns the parameters of its branch.

    Raises InputError without the section of the recipe.
    """
    own = recipe.carriageway
    if own is None:
        raise InputError(f"{CONFIG_DIR / 'train.yaml'}: the section carriageway is missing")
    scenery = recipe.scenery.model_copy(update={"bare": own.bare, "both_ways": own.both_ways})
    same = {field.name: getattr(shot, field.name) for field in fields(shot)}
    shot = CarriagewayShot(**same | {"scenery": scenery, "frames_per_road": own.frames_per_road})
    data = random_frames(
        shot, "train", own.frames, seed=recipe.seed + 1, folder=folder / OUTPUT, reuse=reuse, report=say
    )
    branch = _fit(_Trunk(path), recipe, own, data.part(data.visible), shot.canonical)
    _attach(path, branch)
    return sum(parameter.numel() for parameter in branch.parameters())


class _Trunk:
    """The network up to the features of the branch."""

    def __init__(self, path: Path) -> None:
        model = onnx.load(path)
        self._name = _features_of(model)
        ends = [number for number, node in enumerate(model.graph.node) if self._name in node.output]
        del model.graph.node[ends[0] + 1 :], model.graph.output[:]
        add_output(model, self._name, None)
        self._session = session_of(model.SerializeToString())

    def __call__(self, images: Image) -> Tensor:
        """The features of ``images``."""
        return torch.from_numpy(self._session.run([self._name], {"image": images})[0])


def _features_of(model: onnx.ModelProto) -> str:
    """Tensor of the activations after the first LAYER convolutions."""
    return activations(model, "Conv")[LAYER - 1]


def _fit(
    trunk: _Trunk, recipe: Recipe, own: CarriagewayRecipe, data: LabelledFrames, canonical: Camera
) -> Branch:
    """The branch after all epochs: AdamW with a cosine to zero."""
    torch.manual_seed(recipe.seed)
    size = trunk(data.images[:2]).shape
    carriageways = _targets(data.lanes)
    branch = Branch((size[1], size[2], size[3]), own, carriageways[~torch.isnan(carriageways[:, 0])])
    optimiser = torch.optim.AdamW(branch.parameters(), lr=own.learning_rate, weight_decay=recipe.weight_decay)
    steps = own.epochs * math.ceil(len(data) / EVALUATION_BATCH)
    augmenter = Augmenter(own.augmentation, canonical, lookahead_m=recipe.lane_lookahead_m)
    batches = _batches(trunk, augmenter, data, epochs=own.epochs, seed=recipe.seed)
    for step, (features, wanted) in enumerate(ahead(batches)):
        rate = own.learning_rate * warm_up_cosine(step / steps, warm_up=recipe.warm_up)
        with torch.autocast("cpu", torch.bfloat16, enabled=recipe.bfloat16):
            value = branch.loss(features, wanted)
        found = descend(branch, optimiser, value.float(), rate=rate)
        if step % (steps // own.epochs) == 0:
            say(f"carriageway: step {step} of {steps}, loss {found:.3f}")
    return branch.eval()


def _batches(
    trunk: _Trunk, augmenter: Augmenter, data: LabelledFrames, *, epochs: int, seed: int
) -> Iterator[tuple[Tensor, Tensor]]:
    """Features and targets of all frames in every epoch, augmented anew."""
    for epoch in range(epochs):
        rng = np.random.default_rng((seed, 7, epoch))
        order = rng.permutation(len(data))
        for start in range(0, len(order), EVALUATION_BATCH):
            chosen = order[start : start + EVALUATION_BATCH]
            pairs = [augmenter(data.images[i], data.lanes[i], rng) for i in chosen]
            images, rows = (np.stack(column) for column in zip(*pairs, strict=True))
            yield trunk(images), _targets(rows)


def _targets(rows: Floats) -> Tensor:
    """ln(width) and offset/width of rows, shape (n, 2)."""
    return torch.from_numpy(
        np.column_stack([np.log(rows[:, WIDTH]), rows[:, OFFSET] / rows[:, WIDTH]]).astype(np.float32)
    )


def _attach(path: Path, branch: Branch) -> None:
    """Add ``branch`` to the graph of ``path``, in place of an earlier one."""
    model = onnx.load(path)
    detach(model, OUTPUT)
    features = _features_of(model)
    with torch.no_grad(), io.BytesIO() as file:
        sample = torch.zeros(2, *branch.size)
        torch.onnx.export(
            branch,
            (sample,),
            file,
            input_names=[FEATURES],
            output_names=[OUTPUT],
            dynamic_axes={FEATURES: {0: "n"}, OUTPUT: {0: "n"}},
            opset_version=17,
            dynamo=False,
        )
        part = onnx.load_from_string(file.getvalue())
    part = onnx.compose.add_prefix(part, f"{OUTPUT}_")
    renamed = {f"{OUTPUT}_{FEATURES}": features, f"{OUTPUT}_{OUTPUT}": OUTPUT}
    for node in part.graph.node:
        for names in (node.input, node.output):
            names[:] = [renamed.get(name, name) for name in names]
    model.graph.node.extend(part.graph.node)
    model.graph.initializer.extend(part.graph.initializer)
    add_output(model, OUTPUT, ["n", 3])
    onnx.checker.check_model(model)
    onnx.save(model, path)


def middle_scores(weights: Path) -> dict[str, float]:
    """Shares of places on drawn roads in which the estimator is sure, also without the branch, for the default car.

    In the middle of roads for both ways without lines it should be sure nowhere; in the right half, on roads with
    one lane, and between lines under snow as often as without the branch.
    """
    camera, vehicle = load(CONFIG_DIR / "camera.yaml", Camera), load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    settings = load(CONFIG_DIR / "steer_net.yaml", SteerNetSettings)
    nets = {
        name: SteerNet(
            settings.model_copy(update={"weights": str(weights.absolute())} | other), camera, vehicle
        )
        for name, other in (("sure", {}), ("without_branch", {"both_ways_m": NO_ROAD_M}))
    }
    sure = defaultdict(list)
    for seed in range(ROADS):
        for place, road, offset_m in _judged_roads(
            np.random.default_rng((seed, 77)), UNMARKED[seed % len(UNMARKED)]
        ):
            renderer = Renderer(road, camera, seed=seed)
            for station_m in STATIONS_M:
                x_m, y_m = road.position(station_m, offset_m)
                image = renderer.render(x_m, y_m, road.heading_at(station_m), t_s=0.0, station_m=station_m)
                for name, net in nets.items():
                    estimate = net.step(Frame(t_s=0.0, image=image), None, now_s=0.0)
                    sure[f"{name}_{place}"].append(estimate.confidence > SURE)
    return {"places_each": float(ROADS * len(STATIONS_M))} | {
        name: float(np.mean(places)) for name, places in sure.items()
    }


def _judged_roads(rng: np.random.Generator, kind: MarkingKind) -> Iterator[tuple[str, Road, float]]:
    """Name, road and offset of the car from the middle of its lane."""
    bare = drawn_road(rng, kinds=(kind,))
    both = add_other_half(bare, float(rng.uniform(*HALF_WIDTH_M)))
    yield "middle", both, both.settings.lane_width_m / 2
    yield "half", both, 0.0
    one_lane = {"lane_width_m": float(rng.uniform(*LANE_WIDTH_M))}
    yield "one_lane", Road(bare.settings.model_copy(update=one_lane)), 0.0
    yield "snow", snow_up(drawn_road(rng, kinds=LINED), rng), 0.0


def ship_scored(network: Path, record: SteerNetRecord, folder: Path) -> SteerNetRecord:
    """:func:`ship` with the scores of the estimator that the files make; returns the record with them."""
    ship(network, record, folder)
    scores = record.scores | {OUTPUT: middle_scores(folder / network.name)}
    record = record.model_copy(update={"scores": scores})
    ship(network, record, folder)
    return record


def renew(
    out: Annotated[Path, typer.Option(help="Folder for frames.")] = Path("out/train"),
    weights: WeightsFolder = SHIPPED,
    resume: Annotated[bool, typer.Option("--resume", help="Use the frames of an earlier call.")] = False,
) -> None:
    """Renew the branch of the carriageway in the weights of the CNN estimator."""
    (shipped, record), recipe = shipped_network(weights), load(CONFIG_DIR / "train.yaml", Recipe)
    camera = load(CONFIG_DIR / "camera.yaml", Camera)
    shot = TrainingShot(
        camera, record.camera, record.lane_lookahead_m, recipe.frames_per_road, mounts=recipe.mounts
    )
    with tempfile.TemporaryDirectory() as folder:
        fresh = Path(folder) / shipped.name
        fresh.write_bytes(shipped.read_bytes())
        count = add_carriageway(fresh, recipe, shot, folder=out, reuse=resume)
        changed = {
            **origin(fresh, record.command),
            "recipe": record.recipe | recipe.model_dump(include={"carriageway"}),
            "training": record.training | {PARAMETERS: float(count)},
        }
        record = ship_scored(fresh, record.model_copy(update=changed), weights)
    print(record.scores[OUTPUT])


if __name__ == "__main__":
    run_alone(renew)
