"""The network that describes landmarks, as torch trains it."""

from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils.fusion import fuse_conv_bn_eval

CROP = 64
"""Side of the crop that one landmark vector describes, in pixels."""
STRIDE, COARSE_STRIDE = 8, 16
"""Distance of neighbouring cells and of neighbouring landmark vectors, in pixels."""
CELL_VALUES, LANDMARK_VALUES = 64, 256
"""Values of the vector of one cell and of one landmark."""


class LandmarkNetwork(nn.Module):
    """Describes every cell of 8x8 pixels, and every window of 64x64 pixels, of an image.

    Fully convolutional, so that one pass serves a single crop as well as a whole image.

    Args:
        width: channels of the first layer; the others are multiples of it.
    """

    def __init__(self, width: int = 32) -> None:
        super().__init__()
        middle, fine, coarse = width * 3 // 2, 2 * width, 4 * width
        self.stem = nn.Sequential(
            Convolution(3, width, stride=2),
            Convolution(width, middle, stride=2),
            Convolution(middle, fine, stride=2),
        )
        self.fine = Residual(fine)
        self.reduce = Convolution(fine, coarse, stride=2)
        self.coarse = Residual(coarse)
        self.cells = nn.Conv2d(fine, CELL_VALUES, 1)
        self.context = nn.Conv2d(coarse, CELL_VALUES, 1)
        self.narrow = Convolution(coarse, CELL_VALUES, size=1)
        self.landmark = nn.Conv2d(CELL_VALUES, LANDMARK_VALUES, CROP // COARSE_STRIDE)

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor]:
        """Return vectors of unit length for every cell and every window.

        Args:
            images: (N, 3, H, W) RGB in 0 to 255, H and W multiples of 16 and at least 64.

        Returns:
            (N, 64, H/8, W/8) cells and (N, 256, H/16 - 3, W/16 - 3) landmarks.
        """
        fine = self.fine(self.stem(images / 64 - 2))
        coarse = self.coarse(self.reduce(fine))
        context = functional.interpolate(self.context(coarse), scale_factor=2.0, mode="nearest")
        cells = functional.normalize(self.cells(fine) + context, dim=1)
        landmarks = functional.normalize(self.landmark(self.narrow(coarse)), dim=1)
        return cells, landmarks


class Convolution(nn.Module):
    """Convolution, batch normalization, ReLU."""

    def __init__(self, into: int, out: int, *, size: int = 3, stride: int = 1) -> None:
        super().__init__()
        self.convolution = nn.Conv2d(into, out, size, stride, size // 2, bias=False)
        self.norm = nn.BatchNorm2d(out)

    def forward(self, source: Tensor) -> Tensor:
        """Convert (N, into, H, W) to (N, out, H / stride, W / stride)."""
        return functional.relu(self.norm(self.convolution(source)))

    def folded(self) -> nn.Conv2d:
        """Return one convolution that does both steps before the ReLU."""
        return fuse_conv_bn_eval(self.convolution, self.norm)


class Residual(nn.Module):
    """Two convolutions whose result is added to the input."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = Convolution(channels, channels)
        self.second = Convolution(channels, channels)

    def forward(self, source: Tensor) -> Tensor:
        """Convert (N, channels, H, W) to the same shape."""
        result: Tensor = source + self.second(self.first(source))
        return result
