"""Live frames in and poses out: where images come from while they are recorded, and who is told of what is found.

May import: cameras, body, device, masks, result, formats, scene, tracking, display.
"""
