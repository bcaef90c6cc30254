"""Sessions of ONNX Runtime."""

import os
from typing import TYPE_CHECKING

from nearfar.errors import SettingsError, WeightsError

if TYPE_CHECKING:
    import onnxruntime

PROVIDERS = {
    "cuda": "CUDAExecutionProvider",
    "mps": "CoreMLExecutionProvider",
    "cpu": "CPUExecutionProvider",
}
"""Names of devices in ONNX Runtime."""


def session(model: bytes, device: str = "cpu") -> "onnxruntime.InferenceSession":
    """Return an ONNX Runtime session; on the CPU results do not depend on the number of threads.

    The environment variable OMP_NUM_THREADS limits the threads. Workers that share a machine set
    it.

    Args:
        model: the ONNX model.
        device: "cpu", "cuda", "mps", or "auto" for the first of cuda and cpu that is there.

    Raises:
        SettingsError: the installed ONNX Runtime has no provider for the device.
        WeightsError: ONNX Runtime cannot run the model.
    """
    # Without this, its official builds write to the user's home and send usage data.
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    import onnxruntime

    available = onnxruntime.get_available_providers()
    if device == "auto":
        device = "cuda" if PROVIDERS["cuda"] in available else "cpu"
    if PROVIDERS[device] not in available:
        raise SettingsError(
            f"the installed ONNX Runtime does not run on {device!r}: choose --device cpu, or "
            "install its build for that device"
        )
    options = onnxruntime.SessionOptions()
    threads = os.environ.get("OMP_NUM_THREADS", "")
    options.intra_op_num_threads = int(threads) if threads.isdigit() else 0
    options.use_deterministic_compute = True
    # Waiting threads would take the cores that other work of the same pair needs.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.log_severity_level = 3
    try:
        return onnxruntime.InferenceSession(
            model, options, providers=[PROVIDERS[device]], enable_fallback=0
        )
    except Exception as error:  # Each status has its own type.
        raise WeightsError(f"these weights are no network that can be run: {error}") from error
