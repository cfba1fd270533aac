"""The effects: what a bridge may have beyond the rigid body with viscous damping."""
