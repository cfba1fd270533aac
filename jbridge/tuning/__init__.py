"""Controllers made better by optimisation through simulated moves."""
