"""Complete-data factorization, camera basis constraints, affine polish, Euclidean upgrade."""
