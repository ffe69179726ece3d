"""What goes in and out, as types: they make the OpenAPI true and the tests hold every answer to them.

Bodies of numbers are not run through them: a validator that touches each of a million floats would cost more than the
look-ups.
"""
