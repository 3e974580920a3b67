"""Who is tracked: one person at a time, and it is said where masks show two."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from mmocap_warp.cli.console import Console

if TYPE_CHECKING:
    from mmocap_warp.scene.recording import CameraSource, Scene

Identity = Annotated[
    int | None,
    Parameter(
        name="--identity",
        help="Of the person that is meant, where the masks show several: the index in their palette, or their gray "
        "level.",
    ),
]
"""A flag of all commands that look at a scene's masks."""

_LOOKED_AT = 5  # frames of a camera


def note_others(scene: Scene, console: Console) -> None:
    """Say where given masks show more than one person, and how to choose."""
    if scene.foreground.source != "masks" or scene.foreground.identity:
        return
    for source in scene.cameras:
        if (line := _others(scene, source)) is not None:
            console.note(f"{source.name} {line}")
            return  # the other cameras see the same people


def _others(scene: Scene, source: CameraSource) -> str | None:
    from mmocap_warp.masks.cleanup import clean_mask, rivals
    from mmocap_warp.masks.mask_image import Labels, decode_mask

    if source.masks is None:
        return None
    images = list(source.masks.sample(_LOOKED_AT))
    labels = sorted({identity for image in images if isinstance(image, Labels) for identity in image.identities})
    if len(labels) > 1:
        listed = ", ".join(map(str, labels[:8]))
        return f"shows {len(labels)} objects ({listed}), which are taken for one person; choose one with --identity"
    scale = source.mask_mark.scale if source.mask_mark else source.recorded_scale
    whole = replace(scene.foreground, keep="all")
    masks = [clean_mask(decode_mask(image, soft=source.masks.soft), whole, scale) for image in images]
    found = [areas for mask in masks if (areas := rivals(mask, scene.foreground.join * scale)) is not None]
    if 2 * len(found) < len(images):
        return None
    remedy = {
        "all": 'set [foreground] keep = "nearest" to follow one',
        "largest": 'the larger one is kept in each frame: set [foreground] keep = "nearest" to follow one',
        "nearest": "the larger one in the first frame is followed",
    }[scene.foreground.keep]
    larger, smaller = found[0]
    return (
        f"shows two blobs of about equal size ({larger} and {smaller} px), and one person is tracked at a time:"
        f" {remedy}, or make masks of one person (docs/masks.md)"
    )
