import numpy as np

from mmocap_warp.cameras.silhouette import silhouette


def test_a_silhouette_fills_whole_pixels():
    square = np.array([[2.0, 3.0], [6.0, 3.0], [6.0, 8.0], [2.0, 8.0], [np.nan, 0.0], [1e9, 0.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 1, 4], [0, 1, 5]])  # the last two cannot be drawn
    expected = np.zeros((12, 10), np.uint8)
    expected[3:9, 2:7] = 255
    np.testing.assert_array_equal(silhouette(square, faces, (10, 12)), expected)
