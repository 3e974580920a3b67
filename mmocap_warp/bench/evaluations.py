"""Each kernel of an evaluation alone; then the whole, from parameters to cost."""

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
import warp as wp

from mmocap_warp.bench.workload import Workload
from mmocap_warp.body.posing import make_body_arrays, make_joint_arrays
from mmocap_warp.kernels.benchmarks.timing import Case, Check
from mmocap_warp.kernels.block import batch_of
from mmocap_warp.kernels.body.skinning import pose_vertices
from mmocap_warp.kernels.silhouettes.cost import PAPER, cost_of_counts
from mmocap_warp.masks.observation import make_views
from mmocap_warp.silhouettes import RENDERERS
from mmocap_warp.silhouettes.objective import Objective
from mmocap_warp.silhouettes.silhouettes import Silhouettes

KERNELS, EVALUATION = "kernels", "whole evaluation"
_POSED_APART = 1e-5  # metres: how far a vertex may be from where other kernels put it
_COST_APART = 1e-6  # how far a cost may be from the one in double precision
_PIXELS_APART = 1e-4  # share of the pixels that a GPU may count differently from a CPU
_LEFT_ARM = 2  # of the six parts
_COMPARED = 64  # candidates with the CPU: one thread takes its time


def stages(load: Workload, candidates: int, device: str) -> Iterator[list[Case]]:
    """The kernels for so many candidates, those to be compared together."""
    yield [_posing(load, candidates, device)]
    posed, batch = load.posed(candidates, device), batch_of(0, candidates, candidates, device)
    drawn: dict[str, tuple[partial, wp.array]] = {}  # what draws and counts, and where the counts are
    for renderer in RENDERERS:
        silhouettes = _silhouettes(load, candidates, renderer, device)
        drawn[renderer] = partial(silhouettes.draw, posed, silhouettes.whole, batch), silhouettes.canvas.count
    sizes = {"candidates": candidates} | load.sizes
    check = partial(_same_counts, drawn)
    yield [Case(KERNELS, name, sizes, work, check, candidates) for name, (work, _count) in drawn.items()]
    yield _freezing(load, posed[:1], device)
    yield [_cost(load, drawn[RENDERERS[0]][1], device)]


def _posing(load: Workload, candidates: int, device: str) -> Case:
    mesh, poses = load.body.tracking, load.poses(candidates)
    vertices = len(mesh.rest)
    body = make_body_arrays(load.body, np.eye(3), mesh, device)
    joints = make_joint_arrays(candidates, len(load.body.joint_rest), device)
    posed = wp.zeros((candidates, vertices), dtype=wp.vec3, device=device)
    pose = wp.array(poses, dtype=wp.float32, device=device)
    vertex = wp.array(np.arange(vertices), dtype=wp.int32, device=device)
    work = partial(pose_vertices, body, pose, vertex, batch_of(0, candidates, candidates, device), joints, posed)

    def check() -> Check:
        apart = float(np.abs(posed.numpy() - load.vertices(poses)).max())
        return Check(f"within {apart * 1e6:.1f} µm of the viewers' kernels", apart <= _POSED_APART)

    sizes = {"candidates": candidates, "vertices": vertices}
    return Case(KERNELS, "posing and skinning", sizes, work, check, candidates)


def _silhouettes(load: Workload, candidates: int, renderer: str, device: str) -> Silhouettes:
    silhouettes = Silhouettes(load.body.tracking, load.rig, candidates, renderer, device)
    silhouettes.views.observed.assign(load.observation.words)
    return silhouettes


def all_alike(one: np.ndarray, *others: np.ndarray, words: str) -> Check:
    """Whether counts (candidate, camera, 2) are the same."""
    apart = sum(int((one != other).any(axis=-1).sum()) for other in others)
    return Check(f"{apart} of {one.shape[0] * one.shape[1]} counts differ {words}", apart == 0)


def _same_counts(drawn: dict[str, tuple[partial, wp.array]]) -> Check:
    for work, count in drawn.values():
        count.zero_()
        work()
    return all_alike(*(count.numpy() for _work, count in drawn.values()), words="between renderers")


def _freezing(load: Workload, posed: wp.array, device: str) -> list[Case]:
    """Drawing what an arm leaves alone, if anything; the arm over it gives the counts of the whole body."""
    silhouettes = _silhouettes(load, 1, "raster", device)
    name, index = [*load.body.skeleton.searched_by_part().items()][_LEFT_ARM]
    pieces = silhouettes.split(load.body.skeleton, index)
    if pieces is None:
        return []
    moving, resting = pieces
    frozen, batch, count = silhouettes.make_frozen(1), batch_of(0, 1, 1, device), silhouettes.canvas.count
    freeze = partial(silhouettes.freeze, posed, resting, batch, frozen)

    def check() -> Check:
        silhouettes.draw(posed, silhouettes.whole, batch)
        whole = count.numpy().copy()
        freeze()
        silhouettes.draw(posed, moving, batch, frozen)
        return all_alike(whole, count.numpy(), words="from the whole body's")

    return [Case(KERNELS, "freeze", {"runs": 1, "moving": name} | load.sizes, freeze, check)]


def _cost(load: Workload, count: wp.array, device: str) -> Case:
    candidates = count.shape[0]
    views = make_views(load.rig, device)
    views.foreground.assign(load.observation.foreground.astype(np.int32))
    pose = wp.zeros((candidates, load.body.skeleton.coordinates), dtype=wp.float32, device=device)
    prior = wp.zeros(pose.shape[1], dtype=wp.float32, device=device)
    batch = batch_of(0, candidates, candidates, device)
    cost = wp.zeros(candidates, dtype=wp.float32, device=device)

    def check() -> Check:
        model, overlap = np.moveaxis(count.numpy().astype(float), -1, 0)
        expected = np.mean(1 - overlap / 2 * (1 / model + 1 / load.observation.foreground), axis=1)
        apart = float(np.abs(cost.numpy() - expected).max())
        return Check(f"within {apart:.0e} of double precision", apart <= _COST_APART)

    work = partial(cost_of_counts, PAPER, views, count, pose, prior, batch, cost)
    return Case(KERNELS, "cost", {"candidates": candidates, "cameras": count.shape[1]}, work, check, candidates)


def evaluations(
    load: Workload, batches: Sequence[int], threads: Sequence[int], device: str, group: str = EVALUATION
) -> Iterator[list[Case]]:
    """Whole bodies, by both renderers: batches of candidates, each by some numbers of threads."""
    for candidates in batches:
        expected = partial(_counts, load, min(candidates, _COMPARED))
        yield [
            _evaluation(group, load, load.objective(candidates, renderer, device, number), renderer, number, expected)
            for renderer in RENDERERS
            for number in threads
        ]


def _evaluation(group: str, load: Workload, objective: Objective, renderer: str, threads: int, counts: partial) -> Case:
    candidates, device = objective.candidates, objective.device
    sizes = {"renderer": renderer, "candidates": candidates} | load.sizes_on(device, threads)

    def check() -> Check:
        objective.count.zero_()
        cost = objective.evaluate(candidates).numpy()
        reference = counts()
        count = objective.count.numpy()[: len(reference)].astype(int)
        apart, pixels = int(np.abs(count - reference).sum()), int(reference[..., 0].sum())
        allowed = 0 if device == "cpu" else _PIXELS_APART * pixels
        return Check(f"{apart} of {pixels:,} pixels off the CPU's raster", apart <= allowed and bool((cost < 1).all()))

    return Case(group, renderer, sizes, partial(objective.evaluate, candidates), check, candidates)


def _counts(load: Workload, candidates: int) -> np.ndarray:
    """What the CPU's raster counts with one thread, (candidate, camera, 2) int."""
    objective = load.objective(candidates, "raster", "cpu")
    objective.evaluate(candidates)
    return objective.count.numpy().astype(int)
