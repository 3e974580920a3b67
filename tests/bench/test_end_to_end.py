"""``mmocap bench end-to-end``: the stages make what the next ones take, and the whole is right."""

from __future__ import annotations

from mmocap_warp.bench.end_to_end import END_TO_END, GROWTH, Walk, end_to_end

SMALL = Walk(frames=2, cameras=3, scale=0.5)


def test_stages_add_up_to_the_whole_and_the_whole_follows_the_walk() -> None:
    stages = next(measured := end_to_end(SMALL, "cpu", [1]))
    assert [case.name for case in stages] == ["decode", "clean", "fields", "track", "solve", "write", "whole"]
    assert {case.group for case in stages} == {END_TO_END}
    assert all(case.evaluations == 2 and case.sizes["threads"] == 1 for case in stages)
    assert stages[-1].check().ok
    measured.close()
    decoded, cleaned, *_ = (case.work() for case in stages[:2])
    assert [view.shape for view in decoded[0]] == [view.shape for view in cleaned[0]] == [(240, 320)] * 3


def test_what_grows_is_tracked_alike() -> None:
    *_, grown = end_to_end(SMALL, "cpu", [1])
    sizes = [{name: case.sizes[name] for name in ("frames", "views", "rows")} for case in grown]
    assert {case.group for case in grown} == {GROWTH}
    assert sizes == [
        {"frames": 2, "views": 3, "rows": 240},
        {"frames": 1, "views": 3, "rows": 240},
        {"frames": 2, "views": 2, "rows": 240},
        {"frames": 2, "views": 3, "rows": 120},
    ]
