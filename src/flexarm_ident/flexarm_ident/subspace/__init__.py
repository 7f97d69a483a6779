"""Subspace estimators: Gram matrix, range spaces, order, and the choice between them."""
