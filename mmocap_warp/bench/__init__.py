"""How fast the program is: what ``mmocap bench`` measures, with what, and its report."""
