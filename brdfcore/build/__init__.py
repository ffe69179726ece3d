"""Tables and expansions made of any `Brdf`: choose, build, measure."""
