"""How people walk, gesture, box or move as a clip does, as full pose vectors of a body; knows no camera."""
