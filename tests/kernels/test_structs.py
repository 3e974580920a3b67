import pytest
import warp as wp

from mmocap_warp.kernels.structs import filled


@wp.struct
class Line:
    length: int
    points: wp.array[wp.vec3]


def test_a_struct_has_what_it_was_given():
    points = wp.zeros(3, dtype=wp.vec3, device="cpu")
    line = filled(Line, length=3, points=points)
    assert line.length == 3
    assert line.points is points


@pytest.mark.parametrize("fields", [{"length": 3}, {"length": 3, "points": None, "point": 1}, {}])
def test_a_field_too_few_or_too_many_is_refused(fields):
    with pytest.raises(ValueError, match=r"Line has the fields \['length', 'points'\], got"):
        filled(Line, **fields)
