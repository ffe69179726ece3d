"""What the materials of a scene need within one budget."""
