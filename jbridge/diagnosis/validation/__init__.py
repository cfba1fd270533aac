"""The hold-out, and what it says of a model whose structure is fixed."""
