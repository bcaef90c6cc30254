"""The network that ships with nearfar: it describes landmarks and cells by unit vectors."""

from importlib import resources

from nearfar.errors import WeightsError
from nearfar.networks.graph import INPUT
from nearfar.runtime.weight_files import weights_file
from nearfar.settings import Settings

FILE = "landmark_network.onnx"
"""File of the model in the package `nearfar.networks`; docs/descriptor.md is its model card."""

CELLS, LANDMARKS = "cells", "landmarks"
"""Names of the outputs. `cells` is (N, 64, height/8, width/8), a vector every 8 pixels.
`landmarks` is (N, 256, height/16 - 3, width/16 - 3), a vector for each window of 64x64 pixels."""

CROP, STRIDE, GRANULE = 64, 8, 16
"""Side of the window of a landmark, distance of cells, and divisor of the sides of an image; all in
pixels."""


def landmark_network(settings: Settings) -> bytes:
    """Return the ONNX model that `weights["nearfar"]` names, or the one that ships with nearfar.

    Raises:
        WeightsError: the file cannot be read.
    """
    if "nearfar" not in settings.weights:
        return resources.files("nearfar.networks").joinpath(FILE).read_bytes()
    file = weights_file("nearfar", settings)
    try:
        return file.read_bytes()
    except OSError as error:
        raise WeightsError(f"cannot read the weights file {file}: {error.strerror}") from error


def part(model: bytes, output: str, size: int | None) -> bytes:
    """Return the part of the model that computes one of its outputs.

    Args:
        model: the whole model.
        output: `CELLS` or `LANDMARKS`.
        size: side of the images in pixels; None takes images of any size.

    Raises:
        WeightsError: the file is not an ONNX model, or the model has no such output.
    """
    import onnx
    from google.protobuf.message import DecodeError

    try:
        extractor = onnx.utils.Extractor(onnx.load_model_from_string(model))
        extracted = extractor.extract_model([INPUT], [output])
    except (DecodeError, ValueError, KeyError, onnx.checker.ValidationError) as error:
        raise WeightsError(
            f"these weights are no landmark network made by `nearfar train descriptor`: {error}"
        ) from error
    if size is not None:
        sides = extracted.graph.input[0].type.tensor_type.shape.dim[1:3]
        for side in sides:
            side.dim_value = size
    return bytes(extracted.SerializeToString())
