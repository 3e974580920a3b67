"""Live frames in and poses out: where images come from while they are recorded, and who is told of what is found.

May import: device, body, cameras, masks, result, formats, scene, tracking, display.
"""
