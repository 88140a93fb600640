"""Windows, weights and augmented frames of a training."""

import math

import numpy as np
import pytest

pytest.importorskip("torch", reason="training needs the extra: pip install -e '.[train]'")

from learning.dataset.dataset import DATA, MEASURED, as_rows
from learning.models.catalogue import build
from learning.pixels import erase
from learning.training.augmentation import Augmenter
from learning.training.batches import Batches
from learning.training.frames import Frames, read_frames, share_of
from learning.training.recipe import Augmentation, load_recipe
from learning.training.run import batches_of
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, InputError, load

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
WHEELBASE_M = 2.0
NOTHING = dict.fromkeys(("flip", "brightness", "shadow", "blur", "noise", "erase"), 0.0)


def settings(**changes: float) -> Augmentation:
    return load_recipe("steer", None).augmentation.model_copy(update=NOTHING | changes)


def augmenter(camera: Camera = CAMERA, **changes: float) -> Augmenter:
    return Augmenter(settings(**changes), camera, wheelbase_m=WHEELBASE_M)


def frames(pieces: list[int]) -> Frames:
    count = len(pieces)
    images = np.random.default_rng(0).integers(60, 200, (count, 24, 32, 3)).astype(np.uint8)
    labels = np.linspace(-0.2, 0.3, count).astype(np.float32)
    return Frames(images, labels, np.zeros(count, np.int32), np.array(pieces), ("a",))


def test_a_window_takes_every_nth_frame_within_a_piece():
    windows = frames([0] * 6 + [1] * 5).windows(3, 2)
    assert windows.tolist() == [[0, 2, 4], [1, 3, 5], [6, 8, 10]]


def test_a_window_crosses_neither_rows_that_are_left_out_nor_a_pause_nor_the_end_of_a_route(tmp_path):
    columns = {name: [""] * 12 if kind == "str" else [0.0] * 12 for name, kind in (DATA | MEASURED).items()}
    columns["frame"] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 8, 9, 10]
    columns["stretch"] = [0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1]
    columns["route"] = ["a"] * 9 + ["b"] * 3
    columns["split"] = ["train", "train", "none", *["train"] * 9]
    columns["road_wheel_rad"] = [0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, np.nan, 0.1, 0.1, 0.1]
    index = as_rows({name: np.array(column) for name, column in columns.items()})

    class MadeSet:
        folder, sha256 = tmp_path, "made"

        def labelled_rows(self, split):
            rows = index[index["split"] == split]
            return rows[np.isfinite(rows["road_wheel_rad"])]

        def images(self, rows):
            return (np.full((4, 4, 3), 9, np.uint8) for _ in rows)

    read = read_frames(MadeSet(), "train", height=4, width=4, folder=tmp_path, report=lambda text: None)
    assert read.windows(2, 1).tolist() == [[0, 1], [2, 3], [3, 4], [5, 6], [7, 8], [8, 9]]
    assert read.windows(2, 2).tolist() == [[2, 4], [7, 9]]


@pytest.mark.parametrize("changes", [{"window": "3"}, {"stride": "2"}])
def test_the_shift_of_the_view_needs_each_of_four_frames(changes: dict[str, str]):
    network = build("steer-motion", height=24, width=32)
    assert len(batches_of(load_recipe("steer-motion", None), network, frames([0] * 9), print)) > 0
    with pytest.raises(InputError, match="needs a window of 4 frames at least, and a stride of 1"):
        batches_of(load_recipe("steer-motion", None, overrides=changes), network, frames([0] * 9), print)


def test_windows_of_one_frame_are_all_frames():
    assert frames([0, 0, 1]).windows(1, 4).tolist() == [[0], [1], [2]]


def test_a_share_of_the_frames_is_spread_over_the_drive():
    assert share_of(9, 0.34).tolist() == [0, 4, 8]


def test_an_epoch_continues_from_a_step_as_the_whole_one():
    data = frames([0] * 10)
    batches = Batches(
        data, data.windows(1, 1), np.ones(10, np.float32), 4, 3, augmenter(brightness=1.0), False
    )
    whole = list(batches.epoch(2))
    assert len(batches) == len(whole) == 3 and [len(b.images) for b in whole] == [4, 4, 2]
    for a, b in zip(whole[1:], batches.epoch(2, first=1), strict=True):
        for x, y in zip(a, b, strict=True):
            np.testing.assert_array_equal(x, y)  # an absent speed, NaN, equals itself
    assert not all((a.labels_rad == b.labels_rad).all() for a, b in zip(whole, batches.epoch(3), strict=True))


def test_a_flip_mirrors_the_frame_and_the_sign_of_the_angle():
    data = frames([0, 0])
    height, width = data.images.shape[1:3]
    middle = CAMERA.resize(width, height).model_copy(update={"cx_px": (width - 1) / 2})
    images, labels = augmenter(middle, flip=1.0)(data.images, data.labels_rad, np.random.default_rng(0))
    assert (images == data.images[:, :, ::-1]).all() and (labels == -data.labels_rad).all()


@pytest.mark.parametrize(("cx_px", "yaw_rad"), [(160.0, 0.0), (150.0, 0.0), (160.0, 0.03)])
def test_a_flip_shows_a_mark_on_the_road_at_the_other_side_of_the_car(cx_px: float, yaw_rad: float):
    camera = CAMERA.model_copy(update={"cx_px": cx_px, "yaw_rad": yaw_rad})
    left, right = camera.pixel_from_road([(60.0, 6.0), (60.0, -6.0)])
    rows, columns = np.indices((camera.height_px, camera.width_px))
    mark = np.exp(-0.5 * ((columns - left[0]) ** 2 + (rows - left[1]) ** 2) / 4.0)
    image = np.repeat((250 * mark)[..., None], 3, axis=2).astype(np.uint8)
    changed, _ = augmenter(camera, flip=1.0)(image[None], np.zeros(1, np.float32), np.random.default_rng(0))
    weight = changed[0, :, :, 0] / changed[0, :, :, 0].sum()
    assert (weight * columns).sum() == pytest.approx(right[0], abs=0.3)


@pytest.mark.parametrize(
    "name", ["brightness", "shadow", "blur", "noise", "erase", "shift", "rain", "snow", "fog"]
)
def test_changes_of_light_weather_and_pixels_keep_the_angle_and_change_the_frame(name):
    data = frames([0] * 6)
    images, labels = augmenter(**{name: 1.0})(data.images, data.labels_rad, np.random.default_rng(1))
    assert (labels == data.labels_rad).all()
    assert images.dtype == np.uint8 and images.shape == data.images.shape and (images != data.images).any()


def test_the_frames_of_a_sequence_are_changed_alike():
    data = frames([0, 0])
    same = np.stack([data.images[0]] * 2)
    images, _ = augmenter(brightness=1.0, noise=1.0, rain=1.0, flicker=0.0)(
        same, data.labels_rad, np.random.default_rng(2)
    )
    assert (images[0] == images[1]).all()


@pytest.mark.parametrize("name", ["brightness", "shadow", "blur", "noise", "rain", "snow", "fog"])
def test_in_a_flickering_sequence_each_frame_has_its_own_look(name):
    data = frames([0, 0])
    same = np.stack([data.images[0]] * 2)
    images, _ = augmenter(**{name: 1.0}, flicker=1.0)(same, data.labels_rad, np.random.default_rng(2))
    assert (images[0] != images[1]).any()


def test_the_frames_of_a_flickering_sequence_are_seen_from_one_place():
    data = frames([0, 0])
    same, labels_rad = np.stack([data.images[0]] * 2), np.full(2, 0.1, np.float32)
    for seed in range(4):
        images, labels = augmenter(flip=0.5, viewpoint=0.5, shift=0.5, flicker=1.0)(
            same, labels_rad, np.random.default_rng(seed)
        )
        assert (images[0] == images[1]).all() and labels[0] == labels[1]


def test_a_seed_gives_the_same_frames_again():
    data, change = frames([0] * 4), augmenter(brightness=0.5, shadow=0.5, snow=0.5, viewpoint=0.5)
    one, other = (change(data.images, data.labels_rad, np.random.default_rng(5)) for _ in range(2))
    assert (one[0] == other[0]).all() and (one[1] == other[1]).all()


def test_a_point_of_the_road_moves_in_the_image_as_the_camera_moves():
    image = np.zeros((CAMERA.height_px, CAMERA.width_px, 3), np.uint8)
    point_m, left_m, turned_rad = np.array([8.0, 0.6]), 0.4, 0.05
    u, v = CAMERA.pixel_from_road(point_m)[0].round().astype(int)
    image[v - 1 : v + 2, u - 1 : u + 2] = 255
    seen = augmenter().view_from(image, left_m, turned_rad)
    c, s = math.cos(turned_rad), math.sin(turned_rad)
    apart = point_m - (0.0, left_m)
    wanted = CAMERA.pixel_from_road([c * apart[0] + s * apart[1], -s * apart[0] + c * apart[1]])[0]
    rows, columns = np.nonzero(seen[..., 0] > 128)
    assert (columns.mean(), rows.mean()) == pytest.approx(tuple(wanted), abs=1.0)


def test_beside_the_recorded_path_the_angle_leads_back_to_it():
    image = np.full((1, 24, 32, 3), 90, np.uint8)
    change = augmenter(viewpoint=1.0, viewpoint_m=0.3, viewpoint_rad=0.0)
    found = [
        float(change(image, np.zeros(1, np.float32), np.random.default_rng(seed))[1][0])
        for seed in range(400)
    ]
    apart_m = -np.tan(found) / WHEELBASE_M * settings().viewpoint_ahead_m ** 2 / 2
    assert np.std(apart_m) == pytest.approx(0.3, rel=0.15) and abs(np.mean(apart_m)) < 0.05


@pytest.mark.parametrize(("offset_rad", "mirrored"), [(0.0, True), (0.2, False)])
def test_frames_are_mirrored_unless_their_labels_lie_to_one_side(offset_rad: float, mirrored: bool):
    recipe = load_recipe("steer", None, overrides={"augmentation.flip": "1.0", "batch": "9"})
    network = build("steer", height=24, width=32)
    images, labels_rad, *others = frames([0] * 9)
    train = Frames(images, labels_rad + np.float32(offset_rad), *others)
    reports: list[str] = []
    (batch,) = batches_of(recipe, network, train, reports.append).epoch(0)
    wanted_rad = np.sort(-train.labels_rad if mirrored else train.labels_rad)
    assert np.sort(batch.labels_rad.numpy()).tolist() == wanted_rad.tolist()
    assert reports == ([] if mirrored else ["no frame is mirrored: |mean|/rms of the labels is 0.84"])


def test_a_single_sequence_that_is_left_over_goes_into_the_batch_before():
    data = frames([0] * 9)
    batches = Batches(data, data.windows(1, 1), np.ones(9, np.float32), 4, 3, augmenter(), False)
    found = list(batches.epoch(0))
    assert len(batches) == 2 and [len(batch.images) for batch in found] == [4, 5]
    assert sorted(np.concatenate([batch.labels_rad for batch in found])) == sorted(data.labels_rad)


@pytest.mark.parametrize(("share", "count"), [(1.0, 17), (0.7, 12), (0.4, 7)])
def test_a_share_of_the_windows_of_a_memory_is_that_share(share: float, count: int):
    recipe = load_recipe("cnn-lstm", None, overrides={"window": "4", "frames_share": str(share)})
    places = batches_of(recipe, build("cnn-lstm"), frames([0] * 20), print).places
    assert len(places) == count and places[0].tolist() == [0, 1, 2, 3] and places[-1][-1] == 19


def test_the_greatest_erased_block_is_the_whole_frame():
    rng = np.random.default_rng(0)
    image = np.full((60, 80, 3), 7, np.uint8)
    assert {erase(image, 1.0, rng).shape for _ in range(300)} == {(60, 80, 3)}
