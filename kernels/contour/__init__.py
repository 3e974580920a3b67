"""From posed bodies to the normal equations of their outlines against the masks' contours."""
