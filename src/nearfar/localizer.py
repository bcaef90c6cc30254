"""Localizing pairs of images with one set of settings."""

import dataclasses
import math
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from cachetools import LRUCache

from nearfar.arrays import Matrix3
from nearfar.coordinates import (
    alternative_in_original_pixels,
    candidate_in_original_pixels,
    excluded_in_original_pixels,
    landmarks_in_original_pixels,
    model_in_original_pixels,
)
from nearfar.descriptors import DESCRIPTORS
from nearfar.errors import IntrinsicsError, SettingsError
from nearfar.estimated_cameras import estimated_cameras, without_focal_length
from nearfar.estimators import ESTIMATORS
from nearfar.features import DETECTORS, MATCHERS
from nearfar.geometry.camera_files import GivenCameras, IntrinsicsSource, read_cameras
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.homography import footprint, scale_change, transform
from nearfar.geometry.intrinsics import Intrinsics
from nearfar.imaging.exif import cameras_of
from nearfar.imaging.image import Image, ImageSource, read_image
from nearfar.imaging.mask import MaskSource
from nearfar.imaging.undistorted import View, view_of
from nearfar.landmarks import NO_LANDMARKS
from nearfar.localization import Localization, PointMatches
from nearfar.methods import METHODS, Method
from nearfar.mirroring import mirrored, of_the_original, with_hint
from nearfar.models import MODEL_KINDS, Answer, ModelKind, Task
from nearfar.proposals import PROPOSERS
from nearfar.runtime.threads import blas_on_one_thread
from nearfar.runtime.timing import StageTimer, Watcher
from nearfar.settings import Settings
from nearfar.storage.feature_store import FeatureStore
from nearfar.undistortion import in_original_pixels
from nearfar.verification.acceptance import accepted
from nearfar.verification.expected_error import ExpectedError, with_expected_error
from nearfar.verification.failures import reason_of
from nearfar.verification.significance import log10_nfa

REDUCED = 3.0
"""Reduction of the far image from which on a failure names the way to search it less reduced."""


class Localizer:
    """Localize many pairs of images; the features of an image are computed once.

    Not to be used by several threads at once; give each its own.

    Args:
        settings: the settings; the defaults where None.
        cache_bytes: memory for the features of the images used last.
        store: features on disk, where those not in memory are looked up and kept.
        engine: the method itself, where it is not to be made from the settings.
        same_place: accept poses between cameras at one place, whose direction means nothing.
        mirror_hints: after a failure, match the points of the mirrored near image, to say so in
            the reason where they agree; only the method `adaptive` does.
        **options: settings to change, by name.

    Raises:
        SettingsError: an option is unknown or out of range.
        WeightsError: the descriptor needs weights that are missing or do not fit.
    """

    def __init__(
        self,
        settings: Settings | None = None,
        *,
        cache_bytes: int = 10**9,
        store: FeatureStore | None = None,
        engine: Method[Any] | None = None,
        same_place: bool = False,
        mirror_hints: bool = True,
        **options: Any,
    ) -> None:
        self.settings = (settings or Settings()).replace(**options)
        PROPOSERS.factory(self.settings.proposer)
        for name in self.settings.descriptor.split("+"):
            DESCRIPTORS.factory(name)
        DETECTORS.factory(self.settings.detector)
        MATCHERS.factory(self.settings.matcher)
        ESTIMATORS.factory(self.settings.estimator)
        self._same_place, self._mirror_hints = same_place, mirror_hints
        self._method = engine or METHODS.create(self.settings.method, self.settings)
        quick = engine is None and self.settings.method == "adaptive"
        points_only = self.settings.replace(max_effort="points")
        self._quick = METHODS.create("adaptive", points_only) if quick else None
        self._stored = None if store is None else store.of(self.settings)
        self._features: LRUCache[str, Any] = LRUCache(cache_bytes, lambda value: value.nbytes)

    @property
    def descriptor(self) -> str | None:
        """Return name of the landmark descriptor; None for a method without landmarks."""
        return self.settings.descriptor if self._method.uses_landmarks else None

    def localize(
        self,
        far: ImageSource | Image,
        near: ImageSource | Image,
        *,
        model: ModelKind | None = None,
        intrinsics: IntrinsicsSource | GivenCameras | None = None,
        expected: Sequence[Matrix3] = (),
        far_mask: MaskSource | None = None,
        near_mask: MaskSource | None = None,
        watcher: Watcher | None = None,
        budget: float = math.inf,
    ) -> Localization:
        """Find where the near image lies in the far image.

        Args:
            far: path or array (RGB, see the setting `channels`) of the image that shows more of the
                scene, smaller; or an image that was read and reduced already.
            near: path or array of the image that shows the scene larger, or an image.
            model: kind of model; where None, pose with the intrinsics of both cameras, and
                homography without.
            intrinsics: cameras, see `read_intrinsics`; their distortion is undone for every model.
                "exif" in the place of a camera reads its focal length from the EXIF tags of the
                image; "estimate" estimates one that both images share, for a pose.
            expected: approximate `far_from_near`, homographies between the original images, that
                are tried before any other guess; only the method `adaptive` uses them. Those that
                a preview in a small frame speaks against are not zoomed in on.
            far_mask: file or array as large as the far image, 0 where it must not be used, as on
                overlays, cars or the sky; nothing is detected, described or compared there. An
                image that was read already has its own mask.
            near_mask: the same for the near image.
            watcher: is told of each stage as it begins and, by the method `adaptive`, of each
                attempt.
            budget: seconds for this call, where they are fewer than those of the settings.

        Returns:
            The localization; its status is "failed" where none was found.

        Raises:
            ImageError: an image or a mask cannot be read, or a mask has another size.
            IntrinsicsError: the intrinsics are not valid, a pose is asked for without any, or an
                image names no focal length.
            SettingsError: the method takes no masks, the model is unknown, `expected` holds what is
                no homography, or a plug-in returned another number of inlier flags than of
                matches.
        """
        given = GivenCameras(None, None) if intrinsics is None else read_cameras(intrinsics)
        kind = _model_kind(model, given)
        timer = StageTimer(watcher)
        with timer.stage("reading"):
            far_image, near_image = self._read(far, far_mask), self._read(near, near_mask)
            known = cameras_of(given, far_image, near_image)
        if given.estimated:
            with_points = self._found(
                self._method, Task("fundamental"), far_image, near_image, timer
            )
            estimated = estimated_cameras(with_points, self.settings)
            if estimated is None:
                return without_focal_length(with_points)
            known = estimated
        with timer.stage("reading"):
            far_view, near_view = self._views(known, far_image, near_image)
        timer.deadline = time.perf_counter() + min(budget, self.settings.budget)
        task = _task(kind, far_view, near_view, expected)
        found = self._found(self._method, task, far_view.image, near_view.image, timer)
        points = sum(timer.seconds.get(stage, 0.0) for stage in ("points", "point matching"))
        if not found.localized and kind != "pose" and timer.remaining > points:
            found = self._mirrored(found, task, far_view.image, near_view.image, timer)
        found = in_original_pixels(found, far_view, near_view, (far_image.info, near_image.info))
        return found if found.localized else _with_size(found)

    def _found(
        self, method: Method[Any], task: Task, far: Image, near: Image, timer: StageTimer
    ) -> Localization:
        with blas_on_one_thread():
            features = self._extract(far, timer), self._extract(near, timer)
            answer = method.localize(*features, task, timer)
        return self._localization(task, answer, far, near, timer)

    def _mirrored(
        self, failed: Localization, task: Task, far: Image, near: Image, timer: StageTimer
    ) -> Localization:
        """Return the answer for the mirrored near image if it is allowed, else a hint at it.

        For the hint, the points alone are matched again, by the method `adaptive` alone.
        """
        allowed = self.settings.allow_mirrored
        if not allowed and (self._quick is None or not self._mirror_hints):
            return failed
        method = self._method if allowed or self._quick is None else self._quick
        flipped = dataclasses.replace(task, expected=())
        found = self._found(method, flipped, far, mirrored(near), timer)
        if not found.localized:
            return failed
        return of_the_original(found) if allowed else with_hint(failed)

    def remember(self, image: Image, features: Any) -> None:
        """Take the features of an image as known, so that they need not be computed.

        Args:
            image: at its working size.
            features: what the method of the settings computes for it.
        """
        self._keep(image.content_hash, features)

    def _keep(self, key: str, features: Any) -> None:
        if features.nbytes <= self._features.maxsize:
            self._features[key] = features

    def _read(self, source: ImageSource | Image, mask: MaskSource | None) -> Image:
        if isinstance(source, Image):
            return source
        settings = self.settings
        return read_image(
            source,
            max_size=settings.max_size,
            max_pixels=settings.max_pixels,
            mask=mask,
            bands=settings.bands,
            channels=settings.channels,
        )

    def _views(self, cameras: Intrinsics, far: Image, near: Image) -> tuple[View, View]:
        """Return both images without distortion, where their cameras are known."""
        masked = hasattr(self._method, "masked")
        pairs = (("far", cameras.far, far), ("near", cameras.near, near))
        far_view, near_view = (
            view_of(
                image,
                None if camera is None else camera.of_size(image.width, image.height, name),
                masked=masked,
            )
            for name, camera, image in pairs
        )
        return far_view, near_view

    def _extract(self, image: Image, timer: StageTimer) -> Any:
        key = image.content_hash
        if key in self._features:
            return self._features[key]
        if self._stored is None:
            features = self._computed(image, timer)
        else:
            features = self._stored.get_or_compute(key, lambda: self._computed(image, timer))
        self._keep(key, features)
        return features

    def _computed(self, image: Image, timer: StageTimer) -> Any:
        features = self._method.extract(image.pixels, timer)
        if image.mask is None:
            return features
        masked = getattr(self._method, "masked", None)
        if masked is None:
            raise SettingsError(
                f"the method {self.settings.method!r} takes no masks or transparent images: use "
                f"adaptive or a method of keypoints"
            )
        return masked(features, image.mask)

    def _localization(
        self, task: Task, answer: Answer, far: Image, near: Image, timer: StageTimer
    ) -> Localization:
        """Return the answer in pixels of the original images."""
        kind = task.model
        _check_lengths(answer, self.settings.method)
        exponent = answer.log10_nfa
        if exponent is None:
            exponent = _false_alarms(answer, kind, far)
        near_size, far_size = (each.pixels.shape[1::-1] for each in (near, far))
        answer = accepted(
            answer, task, exponent, near_size, far_size, self.settings, same_place=self._same_place
        )
        estimate = answer.estimate
        model = model_in_original_pixels(estimate.far_from_near, kind, far, near)
        points = PointMatches(
            transform(far.original_from_working, answer.far),
            transform(near.original_from_working, answer.near),
            estimate.inliers,
        )
        expected: ExpectedError | None = None
        if model is not None:
            with timer.stage("verification"):
                model, expected = self._with_expected_error(model, points, task, far, near)
        landmarks = NO_LANDMARKS
        if answer.landmarks is not None:
            landmarks = landmarks_in_original_pixels(answer.landmarks, far, near)
        outline = None
        if kind == "homography" and model is not None:
            outline = footprint(np.asarray(model), near.width, near.height)
        return Localization(
            status="failed" if model is None else "localized",
            reason=reason_of(answer),
            failure=answer.estimate.failure,
            model=kind,
            far_from_near=model,
            scale_change=scale_change(points.far[points.inliers], points.near[points.inliers]),
            confidence=answer.confidence,
            log10_nfa=exponent if math.isfinite(exponent) else None,
            footprint=outline,
            points=points,
            landmarks=landmarks,
            seconds=timer.seconds,
            method=self.settings.method,
            step=answer.step,
            agreement=None if answer.agreement is None else answer.agreement.share,
            excluded=None
            if answer.excluded is None
            else excluded_in_original_pixels(answer.excluded, far, near),
            alternatives=tuple(
                alternative_in_original_pixels(each, far, near) for each in answer.alternatives
            ),
            candidates=tuple(
                candidate_in_original_pixels(each, far, near) for each in answer.candidates
            ),
            descriptor=self.descriptor,
            far=far.info,
            near=near.info,
            expected_error=expected,
        )

    def _with_expected_error(
        self,
        model: Matrix3 | RelativePose,
        points: PointMatches,
        task: Task,
        far: Image,
        near: Image,
    ) -> tuple[Matrix3 | RelativePose, ExpectedError | None]:
        """Return a model in original pixels, a pose with its covariance, and its expected error."""
        cameras = None
        if task.model == "pose":
            both = zip((far, near), task.cameras, strict=True)
            first, second = (image.original_from_working @ camera for image, camera in both)
            cameras = first, second
        return with_expected_error(
            model,
            task.model,
            points.far[points.inliers],
            points.near[points.inliers],
            (near.width, near.height),
            far.width / far.pixels.shape[1],
            self.settings.constants.uncertainty,
            cameras,
        )


def localize(
    far: ImageSource,
    near: ImageSource,
    *,
    model: ModelKind | None = None,
    intrinsics: IntrinsicsSource | GivenCameras | None = None,
    method: str | None = None,
    **options: Any,
) -> Localization:
    """Find where the near image lies in the far image.

    For many pairs make one `Localizer`, which computes the features of each image once.

    Args:
        far: path or array (RGB) of the image that shows more of the scene, smaller.
        near: path or array of the image that shows the scene larger.
        model: "homography", "fundamental" or "pose"; where None, pose with intrinsics and
            homography without.
        intrinsics: file, mapping {"far": [fx, fy, cx, cy], "near": [...]} or `Intrinsics`, in
            pixels of the original images; "exif" or "estimate", see `Localizer.localize`.
        method: name of the method; where None, the default of `Settings`.
        **options: further `Settings` by name.

    Returns:
        The localization; its status is "failed" where none was found.

    Raises:
        NearfarError: an image, the intrinsics, the settings or the weights are not valid.
    """
    if method is not None:
        options["method"] = method
    return Localizer(**options).localize(far, near, model=model, intrinsics=intrinsics)


def _with_size(failed: Localization) -> Localization:
    """Return a failure whose reason says that the far image was reduced much."""
    far = failed.far
    columns, rows = far.working_size
    if far.width < REDUCED * columns or failed.model != "homography":
        return failed
    hint = (
        f"the far image was reduced from {far.width}x{far.height} to {columns}x{rows} pixels: "
        f"search windows of it (--far-tiles), or raise --max-size"
    )
    return dataclasses.replace(failed, reason=f"{failed.reason}; {hint}")


def _check_lengths(answer: Answer, method: str) -> None:
    """Raise a SettingsError where matches and inlier flags of a plug-in differ in number."""
    far, near, flags = len(answer.far), len(answer.near), len(answer.estimate.inliers)
    if not far == near == flags:
        raise SettingsError(
            f"the method {method!r} or its estimator returned {far} far points, {near} near points "
            f"and {flags} inlier flags: return one flag for each pair of points"
        )


def _false_alarms(answer: Answer, kind: ModelKind, far: Image) -> float:
    """Return the decimal logarithm of the number of false alarms of an answer."""
    height, width = far.pixels.shape[:2]
    return log10_nfa(
        kind,
        answer.far[answer.estimate.inliers],
        answer.near[answer.estimate.inliers],
        len(answer.far),
        threshold=answer.estimate.threshold,
        far_size=(width, height),
    )


def _model_kind(model: ModelKind | None, cameras: GivenCameras) -> ModelKind:
    if model is None:
        return "pose" if cameras.both else "homography"
    if model not in MODEL_KINDS:
        raise SettingsError(f"model must be one of {', '.join(MODEL_KINDS)}, not {model!r}")
    if model == "pose" and not cameras.both:
        raise IntrinsicsError(
            "a pose needs intrinsics of both cameras (--intrinsics FILE, exif or estimate)"
        )
    if model != "pose" and cameras.estimated:
        raise IntrinsicsError("a focal length is estimated for a pose alone (--model pose)")
    return model


def _task(kind: ModelKind, far: View, near: View, expected: Sequence[Matrix3]) -> Task:
    far_working, near_working = (_working_from_undistorted(view) for view in (far, near))
    guesses = tuple(far_working @ _guess(each) @ np.linalg.inv(near_working) for each in expected)
    pixel = far.image.width / far.image.pixels.shape[1]
    if kind != "pose" or far.camera is None or near.camera is None:
        return Task(kind, expected=guesses, pixel=pixel)
    return Task(
        kind, far_working @ far.camera.matrix, near_working @ near.camera.matrix, guesses, pixel
    )


def _working_from_undistorted(view: View) -> Matrix3:
    return np.asarray(np.linalg.inv(view.undistorted_from_frame @ view.image.original_from_working))


def _guess(matrix: Matrix3) -> Matrix3:
    try:
        guess = np.asarray(matrix, np.float64)
    except (TypeError, ValueError):
        guess = np.empty(0)
    if guess.shape != (3, 3) or not np.isfinite(guess).all() or not np.linalg.det(guess):
        raise SettingsError("expected must hold invertible 3x3 matrices")
    return guess
