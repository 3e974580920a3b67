"""The shipped walk from its mask files to a result, in stages, and how that grows: what a user waits for."""

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.formats.truth_file import read_truth
from mmocap_warp.formats.usd.usd_body import read_body
from mmocap_warp.formats.usd.usd_result import write_result
from mmocap_warp.kernels.benchmarks.timing import Case, Check
from mmocap_warp.masks.cleanup import clean_mask
from mmocap_warp.masks.mask_settings import ForegroundSettings
from mmocap_warp.result.result import FrameAnswer, Result
from mmocap_warp.scene.recording import Scene
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.scenes import ROOT
from mmocap_warp.tracking.frame_loop import collect, track, track_frames
from mmocap_warp.tracking.from_settings import make_fitter
from mmocap_warp.tracking.make_tracker import make_tracker
from mmocap_warp.tracking.smoothing import smoothed
from mmocap_warp.tracking.track_config import TrackConfig

END_TO_END, GROWTH = "files to result", "files to result, by size"
_FRAMES = 32
_OVERLAP = 0.75  # mean overlap with the masks that a body of another shape has where it is followed


@dataclass(frozen=True)
class Walk:
    """Frames of the shipped walk, seen by its first cameras, at a scale."""

    frames: int = _FRAMES
    cameras: int | None = None
    scale: float = 1.0

    @cached_property
    def scene(self) -> Scene:
        """The recording."""
        scene = load_scene(ROOT / "walk").of_frames(range(self.frames))
        rig = scene.calibrated.select(scene.calibrated.names[: self.cameras])
        return replace(scene, calibrated=rig, cameras=scene.cameras[: self.cameras])

    @cached_property
    def subject(self) -> Subject:
        """A body like the one that walks, where that really starts."""
        truth, body = read_truth(ROOT / "walk" / "truth.usdc"), read_body(ROOT / "bodies" / "adult_woman.usdc")
        return Subject(body, np.asarray(truth.root_base), np.asarray(truth.pose)[0], {})

    @property
    def rig(self) -> CameraRig:
        """Its cameras, at the scale."""
        return self.scene.rig(self.scale)

    @property
    def sizes(self) -> dict[str, int]:
        """Cameras, pixels of one of them, and triangles."""
        triangles = len(self.subject.body.tracking_face)
        return {"cameras": len(self.rig), "pixels": int(self.rig.size[0].prod()), "triangles": triangles}

    @property
    def height(self) -> float:
        """Of the body in the first frame's images, mean over the cameras [px]."""
        return float(np.mean([np.ptp(np.nonzero(mask)[0]) for mask in next(self.scene.masks(self.scale))]))

    def tracked(self, config: TrackConfig, file: Path) -> Result:
        """All that is done for a result, which is written."""
        result = track(self.scene, self.subject, replace(config, scale=self.scale))
        write_result(file, result)
        return result


def end_to_end(walk: Walk, device: str, threads: list[int]) -> Iterator[list[Case]]:
    """Each stage and the whole, by CPU threads of the tracker; then the whole by frames, views and rows of pixels.

    Masks are always read by as many threads as there are cores.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "result.usdc"
        for number in threads:
            config = TrackConfig(device=device, threads=number)
            sizes = {"frames": walk.frames} | ({"threads": number} if device == "cpu" else {})
            yield [_case(END_TO_END, *each, sizes, walk) for each in _stages(walk, config, file).items()]
        half, few = max(1, walk.frames // 2), max(2, len(walk.rig) // 2)
        grown = [walk, replace(walk, frames=half), replace(walk, cameras=few), replace(walk, scale=walk.scale / 2)]
        cases = []
        for one in grown:
            sizes = {"frames": one.frames, "views": len(one.rig), "rows": int(one.rig.size[0, 1])}
            cases.append(_case(GROWTH, "whole", partial(one.tracked, config, file), sizes, one))
        yield cases


def _stages(walk: Walk, config: TrackConfig, file: Path) -> dict[str, Callable[[], Any]]:
    """What is done one after the other, each with what the one before made."""
    scene, subject, rig, scale = walk.scene, walk.subject, walk.rig, walk.scale
    as_read = replace(scene, foreground=ForegroundSettings())
    raw, seen = list(as_read.masks(scale)), list(scene.observations(scale))
    fitter = make_fitter(subject, rig, config, 1, frames=walk.frames)

    def answers() -> list[FrameAnswer]:
        return list(track_frames(make_tracker(subject, rig, config, scene.rate), seen))

    followed = collect(subject, rig, scene.fps, config, answers())
    return {
        "decode": lambda: list(as_read.masks(scale)),
        "clean": lambda: [[clean_mask(mask, scene.foreground, scale) for mask in views] for views in raw],
        "fields": partial(fitter.observe_all, seen),
        "track": answers,
        "solve": lambda: smoothed(followed, config, seen),
        "write": lambda: write_result(file, followed),
        "whole": lambda: walk.tracked(config, file),
    }


def _case(group: str, name: str, work: Callable[[], Any], sizes: dict[str, int], walk: Walk) -> Case:
    def check() -> Check:
        """The walk is followed; what the stages do is a part of that."""
        overlap = float(np.nanmean(work().iou)) if name == "whole" else 1.0
        return Check(f"overlap {overlap:.3f}" if name == "whole" else "as in the whole", overlap >= _OVERLAP)

    return Case(group, name, sizes | walk.sizes, work, check, walk.frames, captured=False)
