"""A cache of image features on disk, shared by all benchmarks, runs and processes.

One file holds the features of one image under one set of settings, as a NumPy .npz archive without
pickled objects. It holds arrays and the structure of the dataclasses that they came from, so that
the features of any method can be stored.

A file appears under its name only when it is complete, so a process may be killed at any time and
several may write the same features. Every part has a checksum; a damaged file counts as absent.
"""

import ast
import dataclasses
import functools
import hashlib
import importlib
import importlib.metadata
import io
import json
import logging
import math
import os
import shutil
import tempfile
import time
import zipfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.registry import outside_code
from nearfar.settings import Settings

Features = TypeVar("Features")

_PACKAGE = Path(__file__).parents[1]
_PARTS_WITHOUT_FEATURES = frozenset(
    {"adapters", "app", "bench", "cli", "constants.py", "estimators", "exports", "maps", "render"}
    | {"runtime", "storage", "train", "verification"}
)
"""Parts of the package that do not change features."""

_STRUCTURE = "structure"
_SUFFIX, _INCOMPLETE = ".npz", ".incomplete"
_ABANDONED_SECONDS = 3600.0
"""Age in seconds from which on an incomplete file counts as left by a process that was killed."""
_FREE_BYTES = 10**9
"""Least free space of the disk, in bytes; below it nothing is stored."""
_KEPT_SHARE = 0.9
_UNSEEN_SHARE = 0.01
"""Shares of the limit: the oldest files are removed down to the kept share. A process writes at
most the unseen share between two scans of the folder, so ten processes together keep the limit."""

_log = logging.getLogger(__name__)


class FeatureStore:
    """A folder of features with a limit on its size; the least recently used are removed first.

    Args:
        folder: the folder, made where missing; it should hold no other files.
        max_bytes: largest total size of the files, in bytes.

    Raises:
        OSError: the folder cannot be made.
    """

    def __init__(self, folder: Path, max_bytes: int = 20 * 10**9) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        self.max_bytes = max_bytes
        self._unseen = math.inf

    def of(self, settings: Settings) -> "SettingsFeatures":
        """Return the cache of features under some settings."""
        return SettingsFeatures(self, settings)

    def get_or_compute(self, key: str, compute: Callable[[], Features]) -> Features:
        """Return the stored features, or compute and store them.

        Features that cannot be stored, e.g. on a full disk, are still returned.

        Args:
            key: file name without suffix.
            compute: returns a dataclass of this package whose fields are arrays, plain values, or
                tuples or dataclasses of such.

        Raises:
            TypeError: the features hold anything else.
        """
        file = self.folder / (key + _SUFFIX)
        stored: Features | None = _read(file)
        if stored is not None:
            return stored
        features = compute()
        content = flattened(features)
        try:
            self._write(file, content)
        except OSError as error:
            _log.warning("features are not stored in %s: %s", self.folder, error.strerror)
        return features

    def _write(self, file: Path, content: Mapping[str, NDArray[Any]]) -> None:
        size = sum(array.nbytes for array in content.values())
        if not self._make_room(size):
            return
        descriptor, name = tempfile.mkstemp(_INCOMPLETE, dir=self.folder)
        incomplete = Path(name)
        try:
            with open(descriptor, "wb") as out:  # noqa: PTH123
                np.savez(out, allow_pickle=False, **content)
                out.flush()
                os.fsync(out.fileno())
            os.replace(incomplete, file)  # noqa: PTH105
        finally:
            incomplete.unlink(missing_ok=True)

    def _make_room(self, size: int) -> bool:
        """Remove the least recently used files; return whether `size` bytes can be added."""
        if size > _KEPT_SHARE * self.max_bytes:
            return False
        self._unseen += size
        if self._unseen > _UNSEEN_SHARE * self.max_bytes:
            self._evict(int(_KEPT_SHARE * self.max_bytes) - size)
            self._unseen = 0
        return shutil.disk_usage(self.folder).free >= size + _FREE_BYTES

    def _evict(self, allowed: int) -> None:
        """Remove the least recently used files until at most `allowed` bytes are left."""
        files = []
        for entry in os.scandir(self.folder):
            with suppress(FileNotFoundError):
                status = entry.stat()
                files.append((status.st_mtime_ns, entry.path, status.st_size))
        total = sum(size for _, _, size in files)
        abandoned = time.time_ns() - int(_ABANDONED_SECONDS * 1e9)
        for used, path, size in sorted(files):
            incomplete = path.endswith(_INCOMPLETE)
            if (incomplete and used < abandoned) or (total > allowed and not incomplete):
                Path(path).unlink(missing_ok=True)
                total -= size


class SettingsFeatures:
    """Features under one set of settings; see `FeatureStore.of`."""

    def __init__(self, store: FeatureStore, settings: Settings) -> None:
        self._store = store
        self._settings_hash = settings_hash(settings)

    def get_or_compute(self, content_hash: str, compute: Callable[[], Features]) -> Features:
        """Return the features of an image by the hash of its content; see `FeatureStore`."""
        key = hashlib.sha256(f"{content_hash} {self._settings_hash}".encode()).hexdigest()
        return self._store.get_or_compute(key, compute)


def settings_hash(settings: Settings) -> str:
    """Return the SHA-256 of all that features depend on besides the image.

    That is `Settings.for_features`, with the content of weights files in place of
    their names, the code and network of this package, the source of plug-ins from outside, and the
    versions of the libraries that compute features.

    Raises:
        OSError: a weights file cannot be read.
    """
    content = settings.for_features()
    content["weights"] = {
        name: _file_hash(Path(file).expanduser()) for name, file in sorted(settings.weights.items())
    }
    content["code"] = code_hash(), outside_code(settings)
    content["libraries"] = [
        cv2.__version__,
        np.__version__,
        importlib.metadata.version("onnxruntime"),
    ]
    return hashlib.sha256(json.dumps(content, sort_keys=True, default=str).encode()).hexdigest()


def flattened(features: object) -> dict[str, NDArray[Any]]:
    """Return the arrays of features by number, and their structure as JSON text.

    Raises:
        TypeError: the features hold something else than arrays, plain values, and tuples or
            dataclasses of them.
    """
    arrays: dict[str, NDArray[Any]] = {}
    structure = _structure(features, arrays)
    return {**arrays, _STRUCTURE: np.array(json.dumps(structure))}


def restored(content: Mapping[str, NDArray[Any]]) -> Any:
    """Return the features that `flattened` took apart.

    Raises:
        KeyError, TypeError, ValueError: the content is not that of any features.
    """
    return _value(json.loads(str(content[_STRUCTURE])), content)


def _structure(value: object, arrays: dict[str, NDArray[Any]]) -> dict[str, Any]:
    """Return the structure of a value, and add its arrays to `arrays`."""
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        name = str(len(arrays))
        arrays[name] = value
        return {"array": name}
    if isinstance(value, tuple) and type(value) is tuple:
        return {"tuple": [_structure(item, arrays) for item in value]}
    if value is None or type(value) in (bool, int, float, str):
        return {"value": value}
    kind = type(value)
    if dataclasses.is_dataclass(value) and _is_own(kind.__module__):
        fields = {
            item.name: _structure(getattr(value, item.name), arrays)
            for item in dataclasses.fields(value)
            if item.init
        }
        return {"class": [kind.__module__, kind.__qualname__], "fields": fields}
    raise TypeError(f"features that hold a {kind.__module__}.{kind.__qualname__} cannot be stored")


def _value(structure: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Any:
    match structure:
        case {"array": name}:
            return arrays[name]
        case {"tuple": items}:
            return tuple(_value(item, arrays) for item in items)
        case {"value": value}:
            return value
        case {"class": [module, name], "fields": fields} if _is_own(module):
            kind = getattr(importlib.import_module(module), name)
            if not (isinstance(kind, type) and dataclasses.is_dataclass(kind)):
                raise TypeError(f"{module}.{name} is not a dataclass")
            return kind(**{field: _value(item, arrays) for field, item in fields.items()})
    raise ValueError("the structure is not one of features")


def _is_own(module: str) -> bool:
    """Whether a module belongs to this package; files may name no others."""
    return module.startswith("nearfar.")


def _read(file: Path) -> Any | None:
    """Return the features in a file; None where it is missing or damaged."""
    try:
        with zipfile.ZipFile(file) as archive:
            # ZipFile.read checks a part as a whole before NumPy looks at it.
            content = {
                name.removesuffix(".npy"): np.lib.format.read_array(
                    io.BytesIO(archive.read(name)), allow_pickle=False
                )
                for name in archive.namelist()
            }
        features = restored(content)
    except Exception:  # Damage shows as almost any error; the features are computed again.
        return None
    with suppress(OSError):
        os.utime(file)
    return features


def _file_hash(file: Path) -> str:
    with file.open("rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()


@functools.cache
def code_hash() -> str:
    """Return the SHA-256 of the code and the network of the package that may change features.

    It leaves out comments, docstrings, log messages and the messages of exceptions.
    """
    digest = hashlib.sha256()
    for file in sorted([*_PACKAGE.rglob("*.py"), *_PACKAGE.rglob("*.onnx")]):
        name = file.relative_to(_PACKAGE)
        if name.parts[0] in _PARTS_WITHOUT_FEATURES:
            continue
        content = file.read_bytes()
        if file.suffix == ".py":
            content = ast.dump(_WithoutWords().visit(ast.parse(content))).encode()
        digest.update(f"{name.as_posix()} {hashlib.sha256(content).hexdigest()}\n".encode())
    return digest.hexdigest()


class _WithoutWords(ast.NodeTransformer):
    """Removes docstrings, calls of the logger and arguments of exceptions."""

    def visit_Expr(self, node: ast.Expr) -> ast.AST | None:
        """Drop constants, which are docstrings, and calls of `_log`."""
        value = node.value
        logs = (
            isinstance(value, ast.Call)
            and isinstance(value.func, ast.Attribute)
            and isinstance(value.func.value, ast.Name)
            and value.func.value.id == "_log"
        )
        return None if logs or isinstance(value, ast.Constant) else self.generic_visit(node)

    def visit_Raise(self, node: ast.Raise) -> ast.AST:
        """Keep the class of an exception alone."""
        if isinstance(node.exc, ast.Call):
            node.exc = node.exc.func
        return node
