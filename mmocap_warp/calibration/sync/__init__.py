"""How far cameras lag one another, from the motion of the silhouettes."""
