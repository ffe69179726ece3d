"""The data folder: materials by name and id, loaded and kept, and changes to it."""
