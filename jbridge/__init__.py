"""jbridge: a differentiable simulator of a laboratory loading bridge, and why a rig and its model differ."""
