"""What checking and refining share: cameras and body as one least-squares problem over the outlines."""
