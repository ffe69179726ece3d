"""Files of any format: told apart, read, written, converted."""
