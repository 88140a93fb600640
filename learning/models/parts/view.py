"""From the pixels of a frame to the numbers that a network reads, as a part of its graph."""

from typing import Literal

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor, nn

Colour = Literal["rgb", "yuv", "grey"]
Scaling = Literal["unit", "signed", "contrast", "imagenet"]
Histogram = Literal["none", "equalise", "match"]
LEVELS = 256
FLOOR_GREY = 8.0  # added to the contrast [grey levels]: a black frame stays black
GREY = (0.114, 0.587, 0.299)  # of blue, green and red: luminance of ITU-R BT.601
YUV = ((0.299, 0.587, 0.114), (-0.147, -0.289, 0.436), (0.615, -0.515, -0.100))  # rows Y, U, V of R, G, B
GREY_YUV = (0.0, 128.0, 128.0)  # added to it: levels of U and V of what has no colour, as in 8 bits
IMAGENET_MEAN, IMAGENET_DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)


class InputView(nn.Module):
    """Uint8 BGR frames (n, H, W, 3) -> float32 (n, C, H − crop, W).

    In this order: rows above the crop are cut off; histogram (A20: grey levels mapped by the histogram of the
    luminance, equalised or matched to that of the training images, see :meth:`match`); colour space; scaling.
    ``unit``: 0 to 1. ``signed``: −1 to 1. ``contrast``: mean 0 and deviation 1 of each frame. ``imagenet``: the
    mean and deviation of ImageNet, as of the public weights.
    """

    reference: Tensor

    def __init__(
        self,
        *,
        crop_px: int = 0,
        colour: Colour = "rgb",
        scaling: Scaling = "unit",
        histogram: Histogram = "none",
    ) -> None:
        super().__init__()
        self.crop_px, self.colour, self.scaling, self.histogram = crop_px, colour, scaling, histogram
        self.register_buffer("reference", torch.arange(LEVELS, dtype=torch.float32))
        self.register_buffer("yuv", torch.tensor(YUV))
        self.register_buffer("mean", torch.tensor(IMAGENET_MEAN)[:, None, None])
        self.register_buffer("deviation", torch.tensor(IMAGENET_DEVIATION)[:, None, None])

    def forward(self, image: Tensor) -> Tensor:
        pixels = image[:, self.crop_px :].permute(0, 3, 1, 2).to(torch.float32)
        if self.histogram != "none":
            pixels = self._match_histogram(pixels)
        return self._scale(self._convert_colour(pixels.flip(1)))

    def match(self, counts: ArrayLike) -> None:
        """Match the histogram of each frame to the reference histogram ``counts`` (256,).

        With h(v) the share of the pixels at level v, M(v) = Σ_{u<v} h(u) + h(v)/2 of both; v -> M_ref⁻¹(M(v)),
        linear between levels. With Σ_{u≤v} h(u) instead of M, as in the paper, all saturated pixels would get the
        brightest level of the reference, however many they are.
        """
        counts = np.asarray(counts, float)
        middles = (np.cumsum(counts) - counts / 2) / counts.sum()
        quantiles = np.interp(np.linspace(0.0, 1.0, LEVELS), middles, np.arange(LEVELS))
        self.reference.copy_(torch.from_numpy(quantiles.astype(np.float32)))

    def _match_histogram(self, pixels: Tensor) -> Tensor:
        luminance = sum(pixels[:, i] * GREY[i] for i in range(3)).round().long().flatten(1)
        ones = torch.ones_like(luminance, dtype=torch.float32)
        counts = torch.zeros(luminance.shape[0], LEVELS, device=pixels.device).scatter_add(1, luminance, ones)
        place = (LEVELS - 1) * (counts.cumsum(1) - counts / 2) / luminance.shape[1]
        below = place.floor()
        index = below.long()
        lower, upper = self.reference[index], self.reference[(index + 1).clamp(max=LEVELS - 1)]
        table = lower + (place - below) * (upper - lower)
        levels = pixels.long().flatten(1)
        return torch.gather(table, 1, levels).reshape(pixels.shape)

    def _convert_colour(self, rgb: Tensor) -> Tensor:
        if self.colour == "grey":
            return (rgb * rgb.new_tensor(GREY[::-1])[:, None, None]).sum(1, keepdim=True)
        if self.colour == "yuv":
            return nn.functional.conv2d(rgb, self.yuv[:, :, None, None], rgb.new_tensor(GREY_YUV))
        return rgb

    def _scale(self, pixels: Tensor) -> Tensor:
        if self.scaling == "unit":
            return pixels / 255
        if self.scaling == "signed":
            return pixels / 127.5 - 1
        if self.scaling == "imagenet":
            return (pixels / 255 - self.mean) / self.deviation
        mean = pixels.mean(dim=(1, 2, 3), keepdim=True)
        spread = ((pixels - mean) ** 2).mean(dim=(1, 2, 3), keepdim=True).sqrt()
        return (pixels - mean) / (spread + FLOOR_GREY)
