"""How JAX computes, and compiled programs that are kept from one run to the next."""
