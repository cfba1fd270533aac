"""From recordings and a model to parameters with their uncertainty."""
