"""What a BRDF is worth: checks of its physics, named repairs, gloss. Each works for anything that can be evaluated."""
