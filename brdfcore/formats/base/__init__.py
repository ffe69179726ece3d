"""What formats share: their class, rows of text, scattered measurements, reports of an import."""
