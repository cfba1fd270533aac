"""How well a fixed model meets recordings: errors of windows that begin where rig and model are by then."""
