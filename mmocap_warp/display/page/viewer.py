"""The page: one HTML file that holds a result and all that shows it.

Its head allows its own script and style by their hashes, and nothing else.
"""

import base64
import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from mmocap_warp.body.joint_sets import JointSet
from mmocap_warp.display.chart import colour_rules
from mmocap_warp.display.overlay import Look
from mmocap_warp.display.page.page_content import Views, content, pose_step, sentence, small_images, small_masks
from mmocap_warp.display.result_video import check_same_recording
from mmocap_warp.result.result import Result
from mmocap_warp.result.truth import Truth
from mmocap_warp.scene.recording import Scene
from mmocap_warp.tracking.body_masks import images_of, tracked_masks
from mmocap_warp.version import __version__
from mmocap_warp.whole_file import write_whole

_HERE = "mmocap_warp.display.page"
_SCRIPTS = ("data.js", "pinhole.js", "stage.js", "curves.js", "layers.js", "pins.js", "page.js")
_IMAGE_SIDE = 320  # larger images are read with this longer side [px]


@dataclass(frozen=True)
class Page:
    """A page that shows a result; a notebook shows it below the cell that ends with it."""

    html: str  # the whole file
    frames: int  # how many frames the result has

    def write(self, path: str | Path) -> None:
        """Write it as a file, whole or not at all; an InputError if the folder cannot be written."""
        write_whole(Path(path), self.html.encode())

    def _repr_html_(self) -> str:
        return f'<iframe srcdoc="{escape(self.html)}" width="100%" height="720" style="border: 0"></iframe>'


def view(
    result: Result,
    scene: Scene | None = None,
    *,
    truth: Truth | None = None,
    images: bool = False,
    joint_set: JointSet | None = None,
    name: str = "Tracked motion",
    people: Sequence[tuple[Look, Result, Scene | None]] = (),
    progress: Callable[[int, int], None] | None = None,
) -> Page:
    """A page to look at a result with: body, cameras, what they saw, and curves, at any time and from any side.

    Without a scene it shows no masks, without truth no errors. ``progress`` is called after each frame whose masks were
    read with how many are done, of how many. Where several ``people`` are shown, the result's own is the first; the
    others' have the same frames, and each has the scene of that person. Raises an InputError for a scene or a truth of
    another recording, or an image that cannot be read.
    """
    step = pose_step(result, [other for _, other, _ in people[1:]])
    positions = range(0, len(result.frame_numbers), step)
    shown = result.at(positions)
    masks = pictures = None
    if scene is not None:
        check_same_recording(result, scene)
        cameras = len(result.cameras)
        others = [tracked_masks(of, other, positions) for _, other, of in people[1:] if of is not None]
        of_people = zip(tracked_masks(scene, result, positions), *others, strict=True)
        together = ([np.logical_or.reduce(each) for each in zip(*views, strict=True)] for views in of_people)
        masks = small_masks(_with_progress(together, len(positions), progress), cameras)
        if images:
            scale = min(1.0, _IMAGE_SIDE / int(scene.calibrated.size.max()))
            pictures = small_images(images_of(scene, shown.frame_numbers.tolist(), scale), cameras)
    calibrated = None if scene is None else scene.calibrated
    shown_people = [(look, each.at(positions)) for look, each, _ in people]
    html = filled(
        resource(_HERE, "page.html"),
        title=name,
        script="\n".join(resource(_HERE, part) for part in _SCRIPTS),
        style=colour_rules(":root") + resource(_HERE, "page.css"),
        summary=escape(_summary(result)),
        holds=escape(sentence(shown.rate, step, masks, pictures)),
        version=escape(__version__),
        content=embedded(content(shown, truth, masks, pictures, joint_set, calibrated, shown_people)),
    )
    return Page(html, len(result.frame_numbers))


def _with_progress(views: Views, count: int, progress: Callable[[int, int], None] | None) -> Iterator[Any]:
    """The same ``count`` views; ``progress`` is called after each."""
    for done, view in enumerate(views, 1):
        yield view
        if progress is not None:
            progress(done, count)


def _summary(result: Result) -> str:
    frames, cameras, runs = len(result.frame_numbers), len(result.cameras), len(result.pose)
    parts = [f"{frames} frames, {frames / result.rate:.1f} s at {result.rate:g} a second", f"{cameras} cameras"]
    parts += [f"{runs} runs"] if runs > 1 else []
    return ", ".join([*parts, f"tracked by {result.config.get('algorithm', 'an unknown tracker')}"])


def resource(package: str, name: str) -> str:
    """A text file of a package."""
    return files(package).joinpath(name).read_text(encoding="utf-8").strip()


def filled(template: str, *, title: str, script: str, style: str, connects: str = "'none'", **parts: str) -> str:
    """A page of a template that begins with ``$head`` and has its one script in ``$script``.

    The title is plain text; ``parts`` are what else the template names, as markup; ``connects`` says where to the
    script may connect, as in a content security policy.
    """
    digests = (hashlib.sha256(text.encode()).digest() for text in (style, script))
    style_hash, script_hash = (base64.b64encode(digest).decode() for digest in digests)  # which the policy allows
    head = Template(resource("mmocap_warp.display.page", "head.html")).substitute(
        title=escape(title), connects=connects, style=style, style_hash=style_hash, script_hash=script_hash
    )
    return Template(template).substitute(parts, head=head, title=escape(title), script=script)


def embedded(data: dict[str, Any]) -> str:
    """JSON that no browser takes for markup, whatever names it holds."""
    return json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
