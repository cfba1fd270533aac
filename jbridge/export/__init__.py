"""Controllers and models in the languages of other programs."""
