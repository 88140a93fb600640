import numpy as np

from perception.lane.light import brighten_road


def plain(grey: int) -> np.ndarray:
    return np.full((240, 320, 3), grey, np.uint8)


def test_a_dark_street_is_brightened_and_a_light_one_is_not() -> None:
    light = plain(120)
    assert brighten_road(plain(30), grey=80, max_gain=4)[200, 160, 1] == 80
    assert brighten_road(light, grey=80, max_gain=4) is light


def test_black_is_brightened_by_the_greatest_gain_at_most() -> None:
    assert brighten_road(plain(5), grey=80, max_gain=4)[200, 160, 1] == 20


def test_the_road_right_ahead_decides_and_not_the_sky_or_what_is_beside() -> None:
    image = plain(250)
    image[168:, 100:220] = 20
    seen = brighten_road(image, grey=40, max_gain=4)
    assert seen[200, 160, 1] == 40 and seen[10, 10, 1] == 255
