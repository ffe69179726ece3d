"""What representations share: their class, the angles they are made for, lattices."""
