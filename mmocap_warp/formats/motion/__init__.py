"""Motion clips and marker paths of other programs, a file each."""
