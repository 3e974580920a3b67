"""Background subtraction: per-pixel colour statistics, and OpenCV's adaptive mixtures behind the same two verbs."""

from __future__ import annotations

import math
from collections.abc import Iterable

import cv2
import numpy as np

from mmocap_warp.masks.frames import evenly_spread
from mmocap_warp.masks.mask_settings import ForegroundSettings

_GAUSSIAN_SAMPLES = 31  # images whose median and spread are taken; bounds the memory
_MIXTURE_SAMPLES = 300
_MIXTURE_LEAST = 10  # images shown: KNN compares with several samples per pixel
_FROZEN = {"mog2": 0.0, "knn": 1e-6}  # learning rates; KNN takes 0 for "learn at every frame" (an overflow in OpenCV)
_GAIN_PIXELS = 50_000  # about so many tell the exposure
_MAD_TO_SD = 1.4826  # of a normal distribution


def learn_background(images: Iterable[np.ndarray], count: int, settings: ForegroundSettings) -> Background:
    """Learn from an even selection of the ``count`` BGR images of one camera; 1 is enough.

    Judging an image changes nothing in what is learnt, except that KNN takes samples of it.
    """
    gaussian = settings.model == "gaussian"
    chosen = set(evenly_spread(count, min(count, _GAUSSIAN_SAMPLES if gaussian else _MIXTURE_SAMPLES)))
    some = (image for i, image in enumerate(images) if i in chosen)
    return GaussianBackground(some, settings) if gaussian else MixtureBackground(some, settings)


class GaussianBackground:
    """Independent normal distributions per pixel and channel, as in HumanEva's baseline, learnt robustly.

    The image's exposure is matched first, by one gain per channel (the median ratio). A pixel is foreground if its
    Mahalanobis distance exceeds the threshold, unless it is a shadow: the background's colour, only darker (brightness
    and colour distortion of Horprasert et al. 1999).

    What is learnt is median and median absolute deviation, which a passer-by in a few images does not move.
    """

    def __init__(self, images: Iterable[np.ndarray], settings: ForegroundSettings) -> None:
        stack = np.stack(list(images))
        mean, deviation = (np.empty(stack.shape[1:], np.float32) for _ in range(2))
        for row in range(len(mean)):  # a row at a time: the whole in floating point would fill the memory
            mean[row] = np.median(stack[:, row], axis=0)
            deviation[row] = _MAD_TO_SD * np.median(np.abs(stack[:, row] - mean[row]), axis=0)
        self._mean, self._deviation = mean, np.maximum(deviation, np.float32(settings.noise))  # [gray levels]
        self._settings = settings

    def foreground(self, image: np.ndarray) -> np.ndarray:
        """(height, width) bool: the pixels of a BGR image that are not background."""
        step = max(1, int(np.sqrt(image.shape[0] * image.shape[1] / _GAIN_PIXELS)))
        some = (slice(None, None, step), slice(None, None, step))
        gain = np.median((image[some].astype(np.float32) + 1) / (self._mean[some] + 1), axis=(0, 1))
        # Most pixels differ from the background, in whole gray levels, by less than any that are far can.
        least = math.floor(self._settings.threshold * self._settings.noise / math.sqrt(3) - 1)
        background = cv2.multiply(self._mean, np.append(gain, 0.0), dtype=cv2.CV_16S)
        far = cv2.inRange(cv2.subtract(image, background, dtype=cv2.CV_16S), (-least,) * 3, (least,) * 3) == 0
        far[far] = self._far(image[far], self._mean[far] * gain, self._deviation[far])
        return far

    def _far(self, image: np.ndarray, background: np.ndarray, deviation: np.ndarray) -> np.ndarray:
        """(pixel,) bool: which pixels (pixel, 3) are neither background nor in a shadow."""
        seen = image.astype(np.float32)
        far = np.square((seen - background) / deviation).sum(axis=-1) > self._settings.threshold**2
        brightness = (seen * background).sum(axis=-1) / np.maximum(np.square(background).sum(axis=-1), 1)
        off_colour = np.square((seen - brightness[..., None] * background) / deviation).sum(axis=-1)
        darker = (brightness > self._settings.shadow_brightness) & (brightness < 1)
        return far & ~(darker & (off_colour < self._settings.shadow_chroma**2))


class MixtureBackground:
    """OpenCV's MOG2 (Zivkovic 2004) or KNN (Zivkovic and van der Heijden 2006), frozen once it has seen the images."""

    def __init__(self, images: Iterable[np.ndarray], settings: ForegroundSettings) -> None:
        subtractor: cv2.BackgroundSubtractor
        if settings.model == "mog2":
            subtractor = cv2.createBackgroundSubtractorMOG2(history=_MIXTURE_SAMPLES, detectShadows=True)
            subtractor.setVarMin(settings.noise**2)
        else:
            subtractor = cv2.createBackgroundSubtractorKNN(history=_MIXTURE_SAMPLES, detectShadows=True)
        shown = 0
        for image in images:
            subtractor.apply(image)
            shown += 1
        for _ in range(shown, _MIXTURE_LEAST):
            subtractor.apply(image)
        self._subtractor, self._frozen = subtractor, _FROZEN[settings.model]

    def foreground(self, image: np.ndarray) -> np.ndarray:
        """As of :class:`GaussianBackground`; shadows, which OpenCV marks with 127, are background."""
        return self._subtractor.apply(image, learningRate=self._frozen) == 255


Background = GaussianBackground | MixtureBackground

_DEPTH, _DISTANCE = 0.03, 0.03  # [m]: what is deeper in the body is surely subject, what is further from it is not
_ROUNDS = 3  # of GrabCut
_MARGIN = 2.0  # in units of _DISTANCE, around the body: the background's colours are learnt there


def mask_around_body(image: np.ndarray, body: np.ndarray, pixels_per_metre: float) -> np.ndarray:
    """(height, width) bool: the subject in a BGR image without a background to subtract, near the tracked body.

    GrabCut (Rother, Kolmogorov and Blake 2004) learns the colours of what is surely the subject and surely not, and
    draws the contour between them where the image has an edge. It is the silhouette ``body`` (height, width) bool
    itself where that is too small to learn colours from. Lengths are measured by ``pixels_per_metre`` at the body.
    """
    rows, columns = (np.flatnonzero(body.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return body.copy()
    inside = cv2.distanceTransform(body.astype(np.uint8), cv2.DIST_L2, 5)
    outside = cv2.distanceTransform(1 - body.astype(np.uint8), cv2.DIST_L2, 5)
    known = np.where(body, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    known[inside > min(_DEPTH * pixels_per_metre, 0.5 * float(inside.max()))] = cv2.GC_FGD
    known[outside > _DISTANCE * pixels_per_metre] = cv2.GC_BGD
    reach = int(np.ceil((1 + _MARGIN) * _DISTANCE * pixels_per_metre))
    window = tuple(slice(max(int(at[0]) - reach, 0), int(at[-1]) + reach + 1) for at in (rows, columns))
    part = np.ascontiguousarray(known[window])
    if not (part == cv2.GC_BGD).any():
        return body.copy()
    cv2.setRNGSeed(0)  # it starts from random clusters of colours
    models = np.zeros((2, 1, 65))
    whole = (0, 0, *part.shape[::-1])
    cv2.grabCut(np.ascontiguousarray(image[window]), part, whole, models[0], models[1], _ROUNDS, cv2.GC_INIT_WITH_MASK)
    mask = np.zeros_like(body)
    mask[window] = (part == cv2.GC_FGD) | (part == cv2.GC_PR_FGD)
    return mask
