"""Answers for people: the speed-against-error report of materials as a page, a picture, Markdown or JSON."""
