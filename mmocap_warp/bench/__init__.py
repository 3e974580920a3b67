"""How fast the program is: what ``mmocap bench`` measures, with what, and how it is told."""
