"""Training of the landmark network: reproducible from a seed, and resumable."""

import contextlib
import dataclasses
import hashlib
import io
import json
import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import torch
from torch import Tensor, nn
from torch.utils.data import DataLoader

from nearfar.errors import SettingsError, TrainingError
from nearfar.storage.locations import replaced
from nearfar.storage.rows import Row, RowFile
from nearfar.train.batches import Batch, Batches, BatchShape
from nearfar.train.losses import contrastive_loss, counterparts, middle, template_loss
from nearfar.train.network import LandmarkNetwork
from nearfar.train.start import network_of
from nearfar.train.training_set import TrainingSet
from nearfar.train.validation import validated

CHECKPOINT, LOG, CONFIGURATION = "checkpoint.pt", "log.jsonl", "configuration.json"
WEIGHTS = {"landmark_loss": 1.0, "template_loss": 1.0, "cell_loss": 0.5}
"""Of the losses in their sum."""
WARM_UP = 0.05
"""Share of the steps in which the learning rate rises; after them it falls like a cosine."""
BFLOAT16 = ("avx512_bf16", "amx_bf16", "amx", "arm_bf16")
"""Names of torch for what a processor needs to compute with bfloat16."""


@dataclasses.dataclass(frozen=True)
class Configuration:
    """Everything that decides what is learned from a set of photographs.

    Attributes:
        steps: batches to train on.
        width: channels of the network's first layer.
        shapes: of the batches, in turns. Landmarks are learned from views of 64 pixels, cells from
            all.
        learning_rate: the greatest.
        weight_decay: of AdamW.
        cells: drawn from each view pair.
        held_out: one place in so many is kept for validation; most are a photograph each.
        real: share of the photographs in a batch that are seen with another one of their place.
        seed: of weights, regions and views.
        every: steps from one validation and checkpoint to the next.
    """

    steps: int = 14_000
    width: int = 32
    shapes: tuple[BatchShape, ...] = (BatchShape(64, 48, 8), BatchShape(128, 48, 4))
    learning_rate: float = 2e-3
    weight_decay: float = 1e-2
    cells: int = 16
    held_out: int = 8
    real: float = 0.3
    seed: int = 0
    every: int = 250

    def __post_init__(self) -> None:
        if self.steps < 1 or self.seed < 0:
            raise SettingsError("a training needs at least 1 step and a seed of at least 0")
        for name in ("width", "cells", "held_out", "every"):
            if getattr(self, name) < 1:
                raise SettingsError(f"{name} must be at least 1, not {getattr(self, name)}")
        if not 0 <= self.real <= 1:
            raise SettingsError(f"real must be from 0 to 1, not {self.real}")

    def with_batches_of(self, pairs: int) -> "Configuration":
        """Return the configuration with smaller or larger batches.

        Args:
            pairs: view pairs in a batch of the first shape; the others change in proportion.

        Raises:
            SettingsError: that is less than the regions of two photographs.
        """
        first = self.shapes[0]
        if pairs < 2 * first.regions:
            raise SettingsError(f"--batch-size must be at least {2 * first.regions}, not {pairs}")
        factor = pairs / (first.photographs * first.regions)
        shapes = tuple(
            dataclasses.replace(shape, photographs=max(2, round(shape.photographs * factor)))
            for shape in self.shapes
        )
        return dataclasses.replace(self, shapes=shapes)

    def further(self) -> "Configuration":
        """Return the configuration of a training that goes on from trained weights."""
        return dataclasses.replace(self, learning_rate=self.learning_rate / 4)


FULL = Configuration()
"""What the shipped descriptor was trained with, but for the steps: 15,971, stopped at 13,972."""

SMALL = Configuration(
    steps=40, width=8, shapes=(BatchShape(64, 4, 4), BatchShape(128, 2, 2)), every=20
)
"""To try a training."""


def train(
    training: TrainingSet,
    validation: TrainingSet,
    configuration: Configuration,
    out: Path,
    *,
    start: Path | None = None,
    jobs: int = 1,
    progress: Callable[[int, Row | None], None] | None = None,
) -> LandmarkNetwork:
    """Train the network, or go on where a training into `out` was stopped.

    Args:
        training: photographs to draw regions from, and those of one place.
        validation: the same, to measure recall on.
        configuration: what to do.
        out: folder of checkpoint and log.
        start: network to begin with; random weights where None.
        jobs: processes that make batches, beside the one that trains; 0: that one makes them.
        progress: called with each step and, where there is one, its line of the log.

    Raises:
        SettingsError: `jobs` is negative.
        TrainingError: there are too few photographs, or `out` holds a training with another
            configuration, start or other photographs, or a damaged one, or `start` is no network.
        OSError: the checkpoint or the log cannot be written; the checkpoint before is kept.
    """
    if jobs < 0:
        raise SettingsError(f"--jobs must be at least 0, not {jobs}")
    count = len(training.photographs)
    if count < 2:
        raise TrainingError(f"{count} photographs of at least 64x64 pixels are too few to train on")
    out.mkdir(parents=True, exist_ok=True)
    _check_configuration(configuration, training, validation, start, out)
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    with _deterministic(configuration.seed):
        network = _first_network(configuration, training, start)
        trained = _Training(configuration, network, device)
        first = trained.resume(out / CHECKPOINT)
        batches = Batches(
            training,
            configuration.shapes,
            real=configuration.real,
            seed=configuration.seed,
            first=first,
            steps=configuration.steps,
        )
        began = time.perf_counter()
        # Set before the processes are forked: those of a parent with threads of OpenCV would hang.
        with RowFile(out / LOG) as log, _opencv_on_one_core():
            loader = DataLoader(batches, batch_size=None, num_workers=jobs)
            for step, batch in enumerate(loader, start=first + 1):
                trained.step(batch, step)
                row = None
                if step % configuration.every == 0 or step == configuration.steps:
                    row = {"step": step, **trained.summary(validation)}
                    row["seconds"] = time.perf_counter() - began
                    trained.save(out / CHECKPOINT, step)
                    log.append(row)
                if progress is not None:
                    progress(step, row)
    result: LandmarkNetwork = trained.network.eval().cpu()
    return result


def _first_network(
    configuration: Configuration, training: TrainingSet, start: Path | None
) -> LandmarkNetwork:
    if start is None:
        return LandmarkNetwork(configuration.width)
    shapes, seed, real = configuration.shapes, configuration.seed, configuration.real
    return network_of(start, Batches(training, shapes, real=real, seed=seed, first=0, steps=1)[0])


class _Training:
    """The network, its optimizer and the losses since the last summary."""

    def __init__(
        self, configuration: Configuration, network: LandmarkNetwork, device: torch.device
    ) -> None:
        self._configuration = configuration
        self._device = device
        self.network = network.to(device).to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self._optimizer = torch.optim.AdamW(
            network.parameters(), weight_decay=configuration.weight_decay
        )
        self._losses: list[dict[str, float]] = []
        self._brief = device.type == "cuda" or _computes_bfloat16()

    def step(self, batch: Batch, step: int) -> None:
        """Take one step of the optimizer."""
        for group in self._optimizer.param_groups:
            group["lr"] = learning_rate(self._configuration, step)
        losses = self._batch_losses(batch, step)
        loss = torch.stack([WEIGHTS[name] * value for name, value in losses.items()]).sum()
        self._optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(self.network.parameters(), 1.0)
        self._optimizer.step()
        self._losses.append({name: value.item() for name, value in losses.items()})

    def _batch_losses(self, batch: Batch, step: int) -> dict[str, Tensor]:
        """Return the losses of `WEIGHTS`; that of landmarks only for views of a landmark's size."""
        self.network.train()
        views = torch.cat([batch.near, batch.far]).to(self._device).float()
        with torch.autocast(self._device.type, torch.bfloat16, enabled=self._brief):
            cells, landmarks = self.network(views.contiguous(memory_format=torch.channels_last))
        near, far = cells.float().chunk(2)
        same = batch.same.to(self._device)
        generator = torch.Generator().manual_seed(self._configuration.seed * 1_000_003 + step)
        far_from_near = batch.far_from_near.to(self._device)
        drawn = counterparts(near, far, far_from_near, self._configuration.cells, generator)
        losses = {
            "cell_loss": contrastive_loss(*drawn),
            "template_loss": template_loss(middle(near), middle(far), same),
        }
        if landmarks.shape[2:] == (1, 1):
            near, far = landmarks.float().flatten(1).chunk(2)
            losses["landmark_loss"] = contrastive_loss(near, far, same)
        return losses

    def summary(self, validation: TrainingSet) -> Row:
        """Return mean losses since the last call, and recall on what was held out."""
        row: Row = {}
        for name in WEIGHTS:
            own = [losses[name] for losses in self._losses if name in losses]
            row[name] = math.fsum(own) / len(own) if own else None
        self._losses.clear()
        return row | validated(self.network, validation, self._configuration.seed, self._device)

    def save(self, file: Path, step: int) -> None:
        """Write a checkpoint so that a crash leaves either the old or the new one."""
        network, optimizer = self.network.state_dict(), self._optimizer.state_dict()
        content = io.BytesIO()  # Torch itself raises a RuntimeError on a full disk.
        torch.save({"network": network, "optimizer": optimizer, "step": step}, content)
        with replaced(file) as incomplete:
            incomplete.write_bytes(content.getbuffer())

    def resume(self, file: Path) -> int:
        """Read the checkpoint, if there is one; returns the steps that are done."""
        if not file.exists():
            return 0
        try:
            state = torch.load(file, map_location="cpu", weights_only=True)
            self.network.load_state_dict(state["network"])
            self._optimizer.load_state_dict(state["optimizer"])
            return int(state["step"])
        except Exception as error:  # A damaged file makes torch raise whatever it likes.
            raise TrainingError(
                f"{file} cannot be read ({type(error).__name__}): remove it to start again"
            ) from error


def _computes_bfloat16() -> bool:
    """Return whether the processor does; torch is nine times slower with it where it does not."""
    capabilities = torch.cpu.get_capabilities() if hasattr(torch.cpu, "get_capabilities") else {}
    return any(capabilities.get(name) for name in BFLOAT16)


def learning_rate(configuration: Configuration, step: int) -> float:
    """Return the learning rate of a step, counted from 1."""
    done = step / configuration.steps
    rise = min(1.0, done / WARM_UP)
    fall = (1 + math.cos(math.pi * min(1.0, max(0.0, done - WARM_UP) / (1 - WARM_UP)))) / 2
    return configuration.learning_rate * rise * max(fall, 1e-3)


def _check_configuration(
    configuration: Configuration,
    training: TrainingSet,
    validation: TrainingSet,
    start: Path | None,
    out: Path,
) -> None:
    content: dict[str, Any] = dataclasses.asdict(configuration)
    for name, part in (("training", training), ("validation", validation)):
        content[name] = [photograph.name for photograph in part.photographs]
        content[f"{name} pairs"] = len(part.pairs)
    if start is not None:
        content["start"] = hashlib.sha256(start.read_bytes()).hexdigest()
    text = json.dumps(content, indent=1)
    file = out / CONFIGURATION
    if file.exists() and file.read_bytes() != text.encode():
        raise TrainingError(
            f"{out} holds a training with another configuration, start or other photographs: "
            "choose another folder"
        )
    file.write_text(text, encoding="utf-8")


@contextlib.contextmanager
def _opencv_on_one_core() -> Iterator[None]:
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


@contextlib.contextmanager
def _deterministic(seed: int) -> Iterator[None]:
    """Make torch deterministic for a seed as far as it can, and restore its state afterwards."""
    before = torch.are_deterministic_algorithms_enabled()
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        torch.use_deterministic_algorithms(True, warn_only=True)
        try:
            yield
        finally:
            torch.use_deterministic_algorithms(before)
