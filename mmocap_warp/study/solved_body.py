"""The body that tracking starts with, solved from a clip instead of taken as given."""

from __future__ import annotations

from collections.abc import Sequence

from mmocap_warp.body.model import Subject
from mmocap_warp.fitting.clip_body import frames_to_follow, solve_body_in_clip
from mmocap_warp.fitting.subject_fit import FitConfig
from mmocap_warp.masks.observation import Observation
from mmocap_warp.rigging.shipped import DEFAULT_BODY, load_body
from mmocap_warp.study.source import OpenClip
from mmocap_warp.tracking.track_config import TrackConfig


def solved_subject(
    clip: OpenClip, masks: Sequence[Observation], seed: int, device: str, threads: int | None
) -> Subject:
    """A clip's subject in its first pose, with the body that frames of the clip's beginning show.

    Args:
        clip: whose subject, cameras and frame rate count.
        masks: of the clip's frames.
        seed: of what follows the subject through these frames.
        device: a Warp device.
        threads: CPU threads; None for all that this process may use.
    """
    numbers = frames_to_follow(clip.fps, len(masks))
    followed = [masks[number] for number in numbers]
    following = TrackConfig(seed=seed, device=device, threads=threads)
    generic, fps = load_body(DEFAULT_BODY), clip.fps / numbers.step
    return solve_body_in_clip(clip.subject, generic, clip.rig, followed, fps, FitConfig().frames, following)[0]
