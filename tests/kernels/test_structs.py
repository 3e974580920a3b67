import numpy as np
import pytest
import warp as wp

from mmocap_warp.kernels.structs import allocated, filled


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


@wp.struct
class Drawing:
    line: Line
    width: int
    matrix: wp.array3d[wp.float32]
    length: wp.array[wp.int32]
    point: wp.array[wp.vec3]
    spare: wp.array[wp.float32]


def test_arrays_are_made_of_shapes_and_of_values(device):
    line = filled(Line, length=3, points=wp.zeros(3, dtype=wp.vec3, device=device))
    spare = wp.zeros(2, dtype=wp.float32, device=device)
    drawing = allocated(
        Drawing, device, line=line, width=5, matrix=(2, 3, 4), length=[1, 2], point=np.ones((4, 3)), spare=spare
    )
    assert drawing.line.points is line.points
    assert drawing.width == 5
    assert drawing.spare is spare
    np.testing.assert_array_equal(drawing.matrix.numpy(), np.zeros((2, 3, 4), np.float32))
    np.testing.assert_array_equal(drawing.length.numpy(), np.array([1, 2], np.int32))
    np.testing.assert_array_equal(drawing.point.numpy(), np.ones((4, 3), np.float32))
    assert {str(array.device) for array in (drawing.matrix, drawing.length, drawing.point)} == {device}


def test_a_field_that_the_struct_lacks_is_not_made():
    with pytest.raises(ValueError, match=r"Line has the fields \['length', 'points'\], got"):
        allocated(Line, "cpu", length=3, points=4, point=1)
